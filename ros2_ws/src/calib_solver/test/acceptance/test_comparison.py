# SPDX-License-Identifier: Apache-2.0
"""What changed is told from chance: as often wrong as is stated, and right where it is large."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from simulated_calibration import GAUGE, kr5, passive, perturbed, simulate

from calib_model.bags import write_measurement
from calib_model.errors import CalibrationError, DataError
from calib_model.instruments import Expansion
from calib_model.transforms import RigidTransform
from calib_solver.acceptance import compare, history_lines
from calib_solver.acceptance.certificate import same_certificate
from calib_solver.acceptance.comparison import difference
from calib_solver.acceptance.history import NO_CHANGE
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.calibration import Sources, calibrate
from calib_solver.compensation import Calibrated, tip
from calib_solver.fitting import Options, certificate_covariance
from calib_solver.identification import identify
from calib_solver.results import StatedErrors

pytestmark = [pytest.mark.timeout(120), pytest.mark.slow]
QUICK = Options(quick=True)
DAY = 86_400 * 10**9
BEGIN = 1_791_000_000 * 10**9


class Bench:
    """One true arm with one seat on one bar whose certificate is off, measured again and again."""

    def __init__(self, seed: int) -> None:
        generator = np.random.default_rng(seed)
        self.nominal, self.seat = kr5(), passive()
        self.true = perturbed(self.nominal, generator)
        mount = self.seat.flange_T_probe
        self.mounted = self.seat.mounted(
            RigidTransform(mount.translation + 1e-3 * generator.normal(size=3))
        )
        spread = certificate_covariance(GAUGE)
        off = np.linalg.cholesky(spread + 1e-22 * np.eye(len(spread))) @ generator.normal(
            size=len(spread)
        )
        self.gauge = replace(
            GAUGE,
            spheres=tuple(
                (number, tuple(np.array(center) + by))
                for (number, center), by in zip(GAUGE.spheres, off.reshape(-1, 3), strict=True)
            ),
        )

    def postures(self, seed, true=None, mounted=None):
        """Poses without noise, to be measured with noise many times."""
        arm, seat = true or self.true, mounted or self.mounted
        return simulate(arm, seat, seed, locations=4, poses=10, errors=0.0).measured

    def measured(self, postures, seed, noise=3e-5, day=0):
        """What somebody records who knows nothing of the truth."""
        poses, generator = postures.poses, np.random.default_rng(seed)
        joints = poses.joints + noise * generator.normal(size=poses.joints.shape)
        stamp = BEGIN + day * DAY + np.arange(len(joints)) * 10**9
        return replace(
            postures,
            arm=self.nominal,
            probe=self.seat,
            gauge=self.gauge,
            poses=replace(poses, joints=joints, stamp=stamp),
        )


def stored(measured, name='result'):
    """The calibration of a measurement as it would be read back."""
    done = identify(measured, QUICK)
    record = {
        'parameters': [
            {'name': one.parameter.name, 'initial': one.parameter.nominal} for one in done.estimates
        ],
        'readings': {'last': None},
    }
    both = Calibrated(measured.arm, done.arm, tip(measured.probe), tip(done.probe))
    names = tuple(parameter.name for parameter in done.table.free)
    stated = StatedErrors(names, done.error_shares, measured.gauge)
    return StoredResult(name, record, both, done.probe, stated)


@pytest.fixture(scope='module')
def bench():
    return Bench(17)


@pytest.fixture(scope='module')
def unchanged(bench):
    """Calibrations of an arm that stays as it is, by three programs in turn."""
    programs = [bench.postures(200 + k) for k in range(3)]
    return [stored(bench.measured(programs[k % 3], 400 + k)) for k in range(36)]


def test_where_nothing_changed_five_in_a_hundred_comparisons_say_so(unchanged):
    chances = np.array([difference(a, b).chance() for a, b in combinations(unchanged, 2)])
    # pairs share calibrations: their share scatters by about 0.02
    assert 0.01 < np.mean(chances < 0.05) < 0.10
    assert np.mean(chances < 0.01) < 0.04
    assert 0.35 < np.median(chances) < 0.65


def test_joint_uncertainties_of_single_parameters_are_what_the_differences_scatter_by(unchanged):
    pairs = [difference(a, b) for a, b in combinations(unchanged, 2)]
    ratio = np.array([one.size / one.standard for one in pairs])
    scatter = np.sqrt(np.mean(ratio**2, axis=0))
    assert 0.9 < np.median(scatter) < 1.1
    assert (scatter < 1.5).all()


def test_an_axis_that_slipped_is_found_and_named(bench, unchanged):
    geometry = bench.true.geometry.copy()
    geometry[3, 2] += 4e-4
    postures = bench.postures(301, bench.true.with_geometry(geometry))
    found = difference(unchanged[0], stored(bench.measured(postures, 71)))
    assert found.chance() < 1e-4
    over = [n for n, yes in zip(found.names, found.beyond(0.05), strict=True) if yes]
    assert 'theta_0_3' in over
    at = found.names.index('theta_0_3')
    assert abs(found.size[at] - 4e-4) < 4 * found.standard[at]


def test_what_the_certificate_has_wrong_is_no_uncertainty_of_a_difference(bench, unchanged):
    first, second = unchanged[0], unchanged[1]
    scale = replace(first.stated.gauge, proportional=2e-4)  # a bar that nobody measured well
    vague = [replace(one, stated=replace(one.stated, gauge=scale)) for one in (first, second)]
    other = replace(scale, name='another bar')
    together = difference(*vague)
    apart = difference(vague[0], replace(second, stated=replace(second.stated, gauge=other)))
    alone = difference(first, second)
    row = together.names.index('a2')
    assert together.standard[row] < 1.05 * alone.standard[row]
    assert apart.standard[row] > 5 * alone.standard[row]


def test_a_gauge_at_two_temperatures_is_one_gauge():
    bar = replace(GAUGE, expansion=Expansion(1.15e-5, 1e-6, 20.0))
    assert same_certificate(bar.at(17.0, 0.2), bar.at(26.0, 0.5))
    assert not same_certificate(bar, replace(bar, constant=2e-6))
    warm = bar.at(26.0, 0.5)
    assert warm.temperature_uncertainty == pytest.approx(0.5)
    assert warm.as_certified().proportional == pytest.approx(bar.proportional)


@pytest.fixture(scope='module')
def folders(bench, tmp_path_factory):
    """Results on disk: two of one arm, one with its probe mounted anew, by day."""
    folder = tmp_path_factory.mktemp('compared')
    mounted = bench.mounted.mounted(
        RigidTransform(bench.mounted.flange_T_probe.translation + [4e-4, 0.0, -3e-4])
    )
    made = {
        'spring': bench.measured(bench.postures(310), 1, day=0),
        'autumn': bench.measured(bench.postures(311), 2, day=180),
        'remounted': bench.measured(bench.postures(312, mounted=mounted), 3, day=190),
    }
    for name, measured in made.items():
        write_measurement(folder / f'{name}_bag', measured)
        calibrate(Sources((str(folder / f'{name}_bag'),)), QUICK, (), str(folder / name))
    return folder


def paths(folder, *names):
    return [str(folder / name) for name in names]


def test_results_are_compared_in_the_order_of_their_dates(folders):
    found = compare(paths(folders, 'autumn', 'spring'))
    assert [one.folder for one in found.results] == paths(folders, 'spring', 'autumn')
    assert found.verdict == NO_CHANGE
    assert found.record()['steps'][0]['verdict'] == NO_CHANGE
    assert history_lines(found)[-1] == 'no change beyond uncertainty'


def test_a_probe_that_was_mounted_anew_is_no_change_of_the_arm(folders):
    found = compare(paths(folders, 'spring', 'autumn', 'remounted'))
    assert len(found.steps) == 3
    last = found.record()['steps'][1]
    assert (last['verdict'], last['probe']['changed']) == ('changed', True)
    assert not last['arm']['changed']
    moved = {one['name']: one for one in last['parameters']}['probe_x']
    assert moved['beyond']
    assert moved['difference'] == pytest.approx(4e-4, abs=4 * moved['standard_uncertainty'])


def test_a_result_compared_with_itself_has_not_changed(folders):
    found = compare(paths(folders, 'spring', 'spring'))
    step = found.record()['steps'][0]
    assert (step['verdict'], step['chance']) == (NO_CHANGE, 1.0)
    assert step['positions']['max'] == 0


def test_one_result_other_arms_and_mixtures_are_refused_by_name(folders, tmp_path):
    with pytest.raises(DataError, match='two results or more'):
        compare(paths(folders, 'spring'))
    measured = simulate(kr5(), passive(), 5, locations=2, poses=8, noise=1e-4).measured
    other = replace(measured, arm=replace(measured.arm, name='other_arm'))
    write_measurement(tmp_path / 'bag', other)
    calibrate(Sources((str(tmp_path / 'bag'),)), QUICK, (), str(tmp_path / 'other'))
    with pytest.raises(DataError, match='other_arm'):
        compare([str(folders / 'spring'), str(tmp_path / 'other')])
    text = (folders / 'autumn' / 'arm.yaml').read_text()
    (tmp_path / 'other' / 'arm.yaml').write_text(text)
    with pytest.raises(CalibrationError, match='arm.yaml: not the file'):
        compare([str(folders / 'spring'), str(tmp_path / 'other')])


def test_what_differs_for_another_nominal_value_is_no_change(bench, unchanged):
    postures = bench.postures(200)
    geometry = bench.nominal.geometry.copy()
    geometry[0, 1] += 3e-4
    measured = replace(bench.measured(postures, 77), arm=bench.nominal.with_geometry(geometry))
    found = difference(unchanged[0], stored(measured))
    assert found.chance() > 1e-3
