# SPDX-License-Identifier: Apache-2.0
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calib_model.instruments import PassiveProbe, trihedron
from calib_model.transforms import RigidTransform
from selfcenter_probe.sensing.contact import Status, seat, touch

DIAMETER = 0.022
PROBE = trihedron(RigidTransform())
LOWER, UPPER = PROBE.stroke.T
DIRECTION = np.array([stylus.direction for stylus in PROBE.styli])
ORIGIN = np.array([stylus.origin for stylus in PROBE.styli])
RHO = DIAMETER / 2 + 0.003


def points(span):
    return st.tuples(*[st.floats(-span, span)] * 3).map(np.array)


@given(points(0.0015))
def test_a_sphere_within_the_stroke_is_found_where_it_is(center):
    contact = touch(PROBE, center[None, :], DIAMETER)
    assert (contact.status == Status.OK).all()
    found = PROBE.centers(contact.displacement, DIAMETER)
    np.testing.assert_allclose(found[0], center, atol=1e-12)


@given(points(0.012) | points(0.2) | points(3.0))
def test_ok_means_that_this_tip_touches_this_sphere_within_its_stroke(center):
    contact = touch(PROBE, center[None, :], DIAMETER)
    displacement, status = contact.displacement[0], contact.status[0]
    tips = ORIGIN + displacement[:, None] * DIRECTION
    gap = np.linalg.norm(tips - center, axis=1) - RHO
    for i in range(3):
        if status[i] == Status.OK:
            assert abs(gap[i]) < 1e-9
            assert LOWER[i] < displacement[i] < UPPER[i]
        elif status[i] == Status.NO_CONTACT:
            assert displacement[i] == LOWER[i]
            # a free stylus stands clear of the sphere, unless the sphere went into the housing
            assert gap[i] > -1e-9 or np.linalg.norm(center) > 0.005
        else:
            assert status[i] == Status.OVER_TRAVEL
            assert displacement[i] == UPPER[i]
            assert gap[i] < 1e-9 or np.linalg.norm(center) > 0.005


@given(points(0.030))
def test_three_times_ok_is_enough_to_find_the_sphere(center):
    contact = touch(PROBE, center[None, :], DIAMETER)
    if (contact.status == Status.OK).all():
        found = PROBE.centers(contact.displacement, DIAMETER)
        np.testing.assert_allclose(found[0], center, atol=1e-9)


@given(points(0.0006))
def test_a_sphere_pulled_away_frees_every_stylus(center):
    outward = np.array([[center[0], center[1], 0.010]])
    assert (touch(PROBE, outward, DIAMETER).status == Status.NO_CONTACT).all()


@given(points(0.0006), st.floats(-0.1, -0.0105))
def test_a_sphere_that_went_through_between_the_tips_is_not_ok(center, depth):
    inside = np.array([[center[0], center[1], depth]])
    assert (touch(PROBE, inside, DIAMETER).status != Status.OK).all()


def test_each_stylus_tells_of_itself():
    toward_first = touch(PROBE, DIRECTION[:1] * 0.0035, DIAMETER)
    assert toward_first.status[0].tolist() == [Status.OVER_TRAVEL, Status.OK, Status.OK]
    off_first = touch(PROBE, -DIRECTION[:1] * 0.0035, DIAMETER)
    assert off_first.status[0].tolist() == [Status.NO_CONTACT, Status.OK, Status.OK]


@given(st.floats(0.04, 3.0), points(1.0))
def test_a_far_sphere_pushes_nothing_in_not_even_behind_the_housing(distance, direction):
    length = np.linalg.norm(direction)
    along = direction / length if length > 1e-3 else DIRECTION[0]
    for center in (distance * along, distance * DIRECTION[1]):
        contact = touch(PROBE, center[None, :], DIAMETER)
        assert (contact.status == Status.NO_CONTACT).all()
        np.testing.assert_array_equal(contact.displacement[0], LOWER)


@pytest.mark.parametrize(('off', 'status'), [(0.0019, Status.OK), (0.0021, Status.NO_CONTACT)])
def test_a_seat_holds_the_sphere_that_is_near_it(off, status):
    probe = PassiveProbe('seat', RigidTransform(), np.array([0.0, 0.0, 0.05]))
    contact = seat(probe, np.array([[0.0, off, 0.05]]), reach=0.002)
    assert contact.status.tolist() == [[status] * 3]
    assert not contact.displacement.any()


def test_the_statuses_are_those_of_the_message():
    source = Path(__file__).resolve().parents[3]
    text = (source / 'calib_interfaces' / 'msg' / 'StylusDisplacements.msg').read_text()
    constants = dict(re.findall(r'^uint8 ([A-Z_]+)=(\d+)', text, re.MULTILINE))
    assert {name: int(value) for name, value in constants.items()} == {
        status.name: status.value for status in Status
    }
