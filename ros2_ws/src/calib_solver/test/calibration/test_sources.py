# SPDX-License-Identifier: Apache-2.0
"""Bags become one measurement where they belong together; where they do not, they are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate

from calib_model.bags import write_measurement
from calib_model.descriptions import probe_yaml
from calib_model.errors import DataError
from calib_model.instruments import ActiveProbe
from calib_model.transforms import RigidTransform
from calib_solver.calibration import Sources, calibrate, load
from calib_solver.fitting import Options

pytestmark = pytest.mark.timeout(60)


def longer(probe: ActiveProbe) -> ActiveProbe:
    """The probe with one stylus 3 mm farther out."""
    first, *others = probe.styli
    origin = tuple(np.add(first.origin, (0.0, 0.0, 0.003)))
    return replace(probe, styli=(replace(first, origin=origin), *others))


def moved(probe: ActiveProbe) -> ActiveProbe:
    return probe.mounted(RigidTransform(np.array([0.0, 0.03, 0.11]), np.zeros(3)))


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """One measurement, as of the probe that it is of and as of others."""
    folder = tmp_path_factory.mktemp('probes')
    measured = simulate(kr5(), active(), 12, locations=2, poses=6).measured
    probe = measured.probe
    probes = {
        'ours': probe,
        'again': replace(probe, simulated=True),
        'spare': replace(probe, name='spare_probe'),
        'longer': longer(probe),
        'moved': moved(probe),
    }
    for number, (name, each) in enumerate(probes.items()):
        poses = replace(measured.poses, joints=measured.poses.joints + 1e-9 * number)
        write_measurement(folder / name, replace(measured, probe=each, poses=poses))
    (folder / 'probe.yaml').write_text(probe_yaml(probe))
    return {name: str(folder / name) for name in (*probes, 'probe.yaml')}


@pytest.mark.parametrize(
    ('other', 'expected'),
    [
        ('spare', '/spare: another probe, spare_probe, than in .*/ours, '),
        ('longer', '/longer: the probe .* is described in another way than in .*/ours'),
        ('moved', '/moved: the probe .* is described in another way than in .*/ours'),
    ],
)
def test_bags_of_another_probe_are_not_joined_with_the_firsts(
    bags: dict[str, str], other: str, expected: str
) -> None:
    with pytest.raises(DataError, match=expected):
        load(Sources((bags['ours'], bags[other])))


def test_bags_of_one_probe_are_joined_and_what_is_given_holds_for_all(bags: dict[str, str]) -> None:
    both = load(Sources((bags['ours'], bags['again'])))
    given = load(Sources((bags['ours'], bags['moved']), probe=bags['probe.yaml']))
    assert both.probe.simulated
    assert len(both.poses) == len(given.poses) == 2 * len(load(Sources((bags['ours'],))).poses)
    assert probe_yaml(given.probe) == Path(bags['probe.yaml']).read_text()


@pytest.mark.parametrize('other', ['spare', 'longer'])
def test_another_probe_holds_nothing_out(bags: dict[str, str], other: str) -> None:
    with pytest.raises(DataError, match=f'/{other}: .*probe'):
        calibrate(Sources((bags['ours'],)), Options(quick=True), (bags[other],))
