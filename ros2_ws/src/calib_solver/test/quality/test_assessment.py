# SPDX-License-Identifier: Apache-2.0
"""Quality as in Fig. 6 and as a measuring arm, against plain loops over the poses."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate

from calib_model.bags import write_measurement
from calib_model.kinematics import points
from calib_solver.calibration import Sources, evaluation_record
from calib_solver.problem import Problem
from calib_solver.quality.assessment import assess
from calib_solver.quality.measuring_arm import articulation, lengths
from calib_solver.results import quality_record

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def measured():
    """Spheres with 3 to 9 poses, one of them with a single one."""
    whole = simulate(kr5(), active(), 12, locations=3, poses=9, noise=1e-4).measured
    poses = whole.poses
    rank = np.arange(len(poses)) % 9
    most = {(1, 1): 1, (1, 6): 3, (2, 14): 5}
    keys = zip(poses.location.tolist(), poses.sphere.tolist(), strict=True)
    wanted = np.array([most.get(key, 9) for key in keys])
    return replace(whole, poses=poses.take(rank < wanted))


@pytest.fixture(scope='module')
def quality(measured):
    return assess(Problem.of(measured), measured.arm, measured.probe)


@pytest.fixture(scope='module')
def clouds(measured):
    """The points (n, 3) of each probed sphere, by location and sphere, in captured order."""
    poses = measured.poses
    p = points(measured.arm, poses.joints, measured.probe.flange_T_probe.apply(measured.centers()))
    keys = list(zip(poses.location.tolist(), poses.sphere.tolist(), strict=True))
    return {key: p[[k == key for k in keys]] for key in dict.fromkeys(keys)}


def pairs(clouds):
    return [(a, b) for a, b in combinations(sorted(clouds), 2) if a[0] == b[0]]


def test_the_smallest_and_largest_errors_are_named_with_what_causes_them(measured, quality, clouds):
    record = quality_record(quality)
    error = {}
    for a, b in pairs(clouds):
        apart = np.linalg.norm(clouds[a].mean(axis=0) - clouds[b].mean(axis=0))
        error[a[0], a[1], b[1]] = abs(apart - measured.gauge.distance(a[1], b[1]))
    spread = {
        (*key, 'xyz'[i]): 2 * cloud[:, i].std(ddof=1)
        for key, cloud in clouds.items()
        if len(cloud) > 1
        for i in range(3)
    }
    for end, extreme in (('max', max), ('min', min)):
        found = record['distance']
        place = extreme(error, key=error.get)
        assert (found[f'{end}_location'], *found[f'{end}_pair']) == place
        assert found[end] == pytest.approx(error[place], rel=1e-6)
        found = record['two_sigma']
        names = ('location', 'sphere', 'coordinate')
        place = extreme(spread, key=spread.get)
        assert tuple(found[f'{end}_{name}'] for name in names) == place
        assert found[end] == pytest.approx(spread[place], rel=1e-6)
    for i, mean in enumerate(record['two_sigma']['mean_xyz']):
        own = [value for key, value in spread.items() if key[2] == 'xyz'[i]]
        assert mean == pytest.approx(np.mean(own))


def test_deviations_are_those_from_each_sphere_s_mean(quality, clouds):
    expected = np.concatenate([clouds[key] - clouds[key].mean(axis=0) for key in sorted(clouds)])
    np.testing.assert_allclose(quality.deviation, expected, atol=1e-12)


def test_single_point_articulation_is_the_distance_of_points_from_their_mean(quality, clouds):
    found = articulation(quality)
    seats = [key for key in sorted(clouds) if len(clouds[key]) > 1]
    assert quality.spheres.keys[found.sphere].tolist() == [list(key) for key in seats]
    for i, key in enumerate(seats):
        size = np.linalg.norm(clouds[key] - clouds[key].mean(axis=0), axis=1)
        assert found.points[i] == len(size)
        assert found.max_deviation[i] == pytest.approx(size.max())
        assert found.two_s[i] == pytest.approx(2 * np.sqrt((size**2).sum() / (len(size) - 1)))
    record = quality_record(quality)['measuring_arm']['single_point']
    assert record['points'] == sum(len(clouds[key]) for key in seats)
    assert record['max_deviation'] == found.max_deviation.max()
    assert record['two_s_max'] == found.two_s.max()
    worst = (record['two_s_location'], record['two_s_sphere'])
    assert worst == seats[int(np.argmax(found.two_s))]


def test_2_s_of_a_point_is_2_sigma_of_its_coordinates_together(quality):
    known = np.isfinite(quality.spheres.two_sigma).all(axis=1)
    together = np.sqrt((quality.spheres.two_sigma[known] ** 2).sum(axis=1))
    np.testing.assert_allclose(articulation(quality).two_s, together, rtol=1e-9)


def test_lengths_are_between_single_probings_and_keep_their_sign(measured, quality, clouds):
    expected = []
    for a, b in pairs(clouds):
        nominal = measured.gauge.distance(a[1], b[1])
        for one, other in zip(clouds[a], clouds[b], strict=False):
            expected.append(np.linalg.norm(one - other) - nominal)
    found = lengths(quality)
    np.testing.assert_allclose(found.deviation, expected, atol=1e-12)
    assert min(expected) < 0 < max(expected)
    record = quality_record(quality)['measuring_arm']['length']
    assert record['count'] == len(expected)
    assert record['max_deviation'] == pytest.approx(max(expected, key=abs))
    assert record['two_rms'] == pytest.approx(2 * np.sqrt(np.mean(np.square(expected))))
    assert record['span'] == pytest.approx(np.ptp(expected))
    assert record['max_length'] == measured.gauge.distance(*record['max_pair'])


def test_a_perfect_arm_has_no_deviation_as_a_measuring_arm():
    scene = simulate(kr5(), active(), 5, locations=2, poses=4, errors=0.0)
    quality = assess(Problem.of(scene.measured), scene.true, scene.measured.probe)
    assert articulation(quality).two_s.max() < 1e-12
    assert np.abs(lengths(quality).deviation).max() < 1e-12


def test_one_pose_of_one_sphere_says_nothing_of_the_arm(measured):
    alone = replace(measured, poses=measured.poses.take(np.array([0])))
    record = quality_record(assess(Problem.of(alone), alone.arm, alone.probe))['measuring_arm']
    assert record['single_point'] is None
    assert record['length'] is None


def test_evaluate_says_what_the_arm_is_as_a_measuring_arm(measured, quality, tmp_path):
    write_measurement(tmp_path / 'bag', measured)
    record = evaluation_record(Sources((str(tmp_path / 'bag'),)))
    assert record['measuring_arm'] == quality_record(quality)['measuring_arm']
    assert 'not a test by the standard' in record['measuring_arm']['basis']
