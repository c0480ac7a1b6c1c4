# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_model.errors import DataError
from calib_model.instruments import WHOLE_ROOM, ActiveProbe, Stylus, refuse_misfit
from calib_model.transforms import RigidTransform


@pytest.mark.parametrize('diameter', [0.0175, 0.022, 0.0265])
def test_spheres_that_leave_styli_some_stroke_are_taken(probe, gauge, diameter):
    refuse_misfit(probe, replace(gauge, sphere_diameter=diameter))


@pytest.mark.parametrize('diameter', [0.0127, 0.0165, 0.0275, 0.05])
def test_spheres_for_another_probe_are_refused_and_both_diameters_said(probe, gauge, diameter):
    said = f'made for spheres of about 22 mm, those of .* have {diameter * 1e3:.4g} mm'
    with pytest.raises(DataError, match=said):
        refuse_misfit(probe, replace(gauge, sphere_diameter=diameter))


def test_what_was_measured_at_the_ends_of_strokes_is_read(probe, gauge):
    refuse_misfit(probe, replace(gauge, sphere_diameter=0.0279), WHOLE_ROOM)
    with pytest.raises(DataError):
        refuse_misfit(probe, replace(gauge, sphere_diameter=0.0285), WHOLE_ROOM)


def test_styli_that_meet_nowhere_are_made_for_no_one_diameter(gauge):
    places = np.array([[0.008, 0, 0], [-0.004, 0.007, 0], [-0.004, -0.007, 0]]).tolist()
    one, two, three = (
        Stylus((x, y, z), (0.0, 0.0, -1.0), 0.003, (0.0, 0.006)) for x, y, z in places
    )
    probe = ActiveProbe('three dials', RigidTransform(), (one, two, three))
    refuse_misfit(probe, replace(gauge, sphere_diameter=0.04))
