# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated_calibration import kr5, on_a_rail, stanford
from simulated_points import Tracked, tracked

from calib_model.arrays import Array
from calib_model.errors import DataError, RankError
from calib_model.instruments import Arm
from calib_model.kinematics import (
    Correction,
    JointErrors,
    JointTerms,
    forward_kinematics,
    points,
)
from calib_model.measured_points import PointMeasurement
from calib_model.transforms import rotation_matrix, rotation_vectors
from calib_model.urdf import arm_from_urdf, arm_urdf
from calib_solver.error_models import table_with
from calib_solver.fitting import DEFAULT_PRIOR, NO_PRIOR, Options
from calib_solver.points import (
    PointIdentification,
    fitted_quality,
    held_out_points,
    identify_points,
)
from calib_solver.points.problem import PointProblem, points_table
from calib_solver.resampling import Plan, in_processes, resample_points

NOISE, TURN_NOISE = 4e-5, 9e-5
PLAIN = Options('position', prior=NO_PRIOR, loss='plain', joint_errors=(), quick=True)


def cost_by_scipy(done: PointIdentification) -> float:
    """The least that scipy finds for the same residuals, from the nominal arm and the identified
    places on."""
    problem, table = done.problem, done.table
    free, targets = len(table.free_columns), len(problem.targets)

    def residuals(values: Array) -> Array:
        arm = problem.arm.with_geometry(
            table.full(table.nominal[table.free_columns] + values[:free])[: 5 * table.n].reshape(
                5, -1
            )
        )
        flange = forward_kinematics(arm, problem.joints)
        of_target = values[free : free + 6 * targets].reshape(-1, 6)
        of_station = values[free + 6 * targets :].reshape(-1, 6)
        base = np.array([rotation_matrix(v) for v in of_station[:, 3:]])[problem.station]
        point = flange[:, :3, 3] + np.einsum(
            'nij,nj->ni', flange[:, :3, :3], of_target[problem.target, :3]
        )
        seen = np.einsum('nij,nj->ni', base, point) + of_station[problem.station, :3]
        found = [(seen - problem.position).ravel()]
        if problem.has_orientation:
            turn = np.array([rotation_matrix(v) for v in of_target[:, 3:]])[problem.target]
            off = base @ flange[:, :3, :3] @ turn @ np.swapaxes(problem.rotation, 1, 2)
            found.append(np.sqrt(problem.turn_weight) * rotation_vectors(off).ravel())
        return np.concatenate(found)

    stations, flanges = done.places.transforms()
    places = [np.r_[at.translation, at.rotation_vector] for at in (*flanges, *stations)]
    start = np.concatenate([np.zeros(free), *places])
    found = least_squares(residuals, start, x_scale='jac', xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return float(2 * found.cost)


EVERY = [(kr5(), k, s, o) for k in (1, 3) for s in (1, 3) for o in (False, True)]
RAILED = [(on_a_rail(), 1, 3, False), (on_a_rail(), 3, 1, True)]


@pytest.mark.slow
@pytest.mark.parametrize(('arm', 'targets', 'stations', 'oriented'), [*EVERY, *RAILED])
def test_without_a_prior_it_is_what_scipy_finds(
    arm: Arm, targets: int, stations: int, oriented: bool
):
    seed = 20 + targets + stations
    scene = tracked(seed, 70, targets, stations, oriented, NOISE, TURN_NOISE, arm)
    done = identify_points(scene.measured, PLAIN)
    assert done.fit.converged
    assert done.fit.quadratic.phi == pytest.approx(cost_by_scipy(done), rel=1e-7)


ARMS = {'kr5': kr5(), 'on a rail, with a coupled axis': on_a_rail(), 'stanford': stanford()}


@pytest.mark.parametrize('arm', ARMS.values(), ids=ARMS)
@pytest.mark.parametrize('oriented', [False, True])
def test_without_noise_unseen_points_are_met_by_the_arm_and_by_its_urdf(arm: Arm, oriented: bool):
    done = identify_points(tracked(31, 150, 2, 2, oriented, arm=arm).measured)
    assert not done.warnings
    unseen = tracked(32, 50, 2, 2, oriented, arm=arm, world=31)
    held_out = held_out_points(unseen.measured, done)
    assert held_out.initial.distance.max() > 1e-3
    assert held_out.identified.distance.max() < 1e-9
    assert not oriented or held_out.identified.angle.max() < 1e-9
    q, at = unseen.measured.points.joints, done.places.target[0]
    read_back = arm_from_urdf(arm_urdf(done.arm))
    turned = done.arm.uncoupled(q)  # URDF cannot say what moves with what
    np.testing.assert_allclose(points(read_back, turned, at), points(done.arm, q, at), atol=1e-9)


def with_gross_errors(scene: Tracked, share: float) -> tuple[PointMeasurement, set[int]]:
    """Some points 2, 10 or 50 mm away, and their numbers from 1."""
    generator = np.random.default_rng(8)
    measured = scene.measured
    position = measured.points.position.copy()
    bad = generator.permutation(len(position))[: round(share * len(position))]
    away = generator.normal(size=(len(bad), 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    position[bad] += np.resize([2e-3, 1e-2, 5e-2], len(bad))[:, None] * away
    spoilt = replace(measured, points=replace(measured.points, position=position))
    return spoilt, {int(row) + 1 for row in bad}


def test_gross_errors_are_left_out_and_listed():
    measured, bad = with_gross_errors(tracked(41, 300, 3, 1, False, NOISE), 0.03)
    done = identify_points(measured)
    assert {one.pose for one in done.rejected} == bad
    assert done.identified.distance.max() < 6 * NOISE
    sizes = sorted(one.size for one in done.rejected)
    assert sizes[0] == pytest.approx(2e-3, rel=0.1)
    assert sizes[-1] == pytest.approx(5e-2, rel=0.01)
    row = measured.points.take(np.array([done.rejected[0].pose - 1]))
    assert (done.rejected[0].target, done.rejected[0].station) == (row.target[0], row.station[0])


def test_nothing_is_left_out_where_nothing_is_wrong():
    assert not identify_points(tracked(42, 400, noise=NOISE).measured).rejected


def test_gross_errors_bend_no_evaluation():
    scene = tracked(43, 200, noise=NOISE)
    measured, bad = with_gross_errors(scene, 0.03)
    problem = PointProblem.of(measured)
    distance = np.sort(fitted_quality(problem, scene.truth).distance)
    assert distance[: -len(bad)].max() < 6 * NOISE


def test_a_misread_orientation_is_left_out_with_its_point():
    scene = tracked(44, 200, 1, 1, True, NOISE, TURN_NOISE)
    turned = scene.measured.points.orientation.copy()
    turned[17] = turned[91]
    measured = replace(scene.measured, points=replace(scene.measured.points, orientation=turned))
    (one,) = identify_points(measured).rejected
    assert one.pose == 18
    assert one.angle > 0.1
    assert 'orientation' in one.reason


def test_targets_far_off_the_flange_and_stations_anywhere_start_right():
    scene = tracked(45, 120, 1, 2, False, NOISE)
    points_set = scene.measured.points
    # a tool of 0.6 m, seen from 40 m away
    arm = scene.truth
    flange = forward_kinematics(arm, points_set.joints)
    point = flange[:, :3, 3] + flange[:, :3, :3] @ np.array([0.35, -0.3, 0.4])
    generator = np.random.default_rng(3)
    base = [rotation_matrix(v) for v in ([0.1, 3.1, 0.2], [2.0, -0.4, 1.5])]
    place = np.array([[40.0, 3.0, -7.0], [-0.5, 12.0, 2.0]])
    which = points_set.station - 1
    seen = np.einsum('nij,nj->ni', np.array(base)[which], point) + place[which]
    seen += NOISE * generator.normal(size=seen.shape)
    measured = replace(scene.measured, points=replace(points_set, position=seen))
    done = identify_points(measured)
    assert done.fit.converged
    assert done.uncertainty.noise == pytest.approx(NOISE, rel=0.15)
    for station, there in zip(done.stations, place, strict=True):
        np.testing.assert_allclose(station.transform.translation, there, atol=0.02)


def test_orientations_weigh_by_what_they_scatter():
    done = identify_points(tracked(46, 300, 1, 1, True, NOISE, 8e-4).measured)
    assert done.uncertainty.noise == pytest.approx(NOISE, rel=0.08)
    assert done.turn_noise == pytest.approx(8e-4, rel=0.08)


@pytest.mark.slow
@pytest.mark.parametrize('prior', [NO_PRIOR, DEFAULT_PRIOR])
def test_stated_uncertainties_are_the_scatter_of_repeated_measurements(prior):
    found: dict[str, list[Array]] = {}
    stated: dict[str, list[Array]] = {}
    options = replace(PLAIN, prior=prior)
    for repetition in range(25):
        scene = tracked(500 + repetition, 80, 2, 2, True, NOISE, TURN_NOISE, world=50)
        done = identify_points(scene.measured, options)
        values = {
            'parameters': (done.full[done.table.free_columns], done.uncertainty.standard),
            'noise': (done.uncertainty.noise, NOISE),
        }
        for name, places in (('target', done.targets), ('station', done.stations)):
            values[name] = (
                np.ravel([one.transform.translation for one in places]),
                np.ravel([one.translation_uncertainty for one in places]),
            )
            values[f'{name} rotation'] = (
                np.ravel([one.transform.rotation_vector for one in places]),
                np.ravel([one.rotation_uncertainty for one in places]),
            )
        for name, (value, sure) in values.items():
            found.setdefault(name, []).append(np.atleast_1d(value))
            stated.setdefault(name, []).append(np.atleast_1d(sure))
    assert np.mean(found.pop('noise')) == pytest.approx(NOISE, rel=0.04)
    for name in found:
        scatter = np.std(found[name], axis=0, ddof=1)
        ratio = np.sqrt(np.mean(np.square(stated[name]), axis=0)) / scatter
        # 25 repetitions tell one scatter to 14 %, all of a kind together to a few
        assert 0.8 < np.sqrt(np.mean(ratio**2)) < 1.25, name
        assert ratio.min() > 0.6, name


def test_a_station_that_is_new_is_placed_by_its_own_points():
    done = identify_points(tracked(61, 150, 1, 1, False, NOISE).measured)
    unseen = tracked(62, 40, 1, 1, False, NOISE, world=61).measured
    moved = replace(
        unseen,
        points=replace(
            unseen.points, station=unseen.points.station + 4, position=unseen.points.position + 1.0
        ),
    )
    assert held_out_points(moved, done).identified.distance.mean() < 2.5 * NOISE
    knocked = replace(unseen, points=replace(moved.points, station=unseen.points.station))
    assert held_out_points(knocked, done).identified.distance.mean() > 1.0


def test_a_target_that_was_not_identified_is_refused():
    done = identify_points(tracked(63, 60, noise=NOISE).measured, PLAIN)
    unseen = tracked(64, 40, 2, 1, noise=NOISE, world=63).measured
    with pytest.raises(DataError, match='target 2 was not identified'):
        held_out_points(unseen, done)


def test_encoders_that_sit_eccentric_are_identified_where_groups_left_out_want_it():
    generator = np.random.default_rng(9)
    errors = JointErrors(JointTerms(2), 4e-4 * generator.normal(size=(4, 6)))
    arm = tracked(71, 3).measured.arm
    bent_encoders = Correction(arm.joint_names, errors)
    done = identify_points(tracked(71, 400, noise=2e-5, correction=bent_encoders).measured)
    assert done.joint_error_choice.accepted == ('encoder',)
    unseen = tracked(72, 60, noise=2e-5, correction=bent_encoders, world=71)
    assert held_out_points(unseen.measured, done).identified.distance.mean() < 6e-5


@pytest.mark.parametrize('oriented', [False, True], ids=['points', 'orientations'])
@pytest.mark.parametrize('noise', [0.0, NOISE], ids=['exact', 'noisy'])
def test_a_rail_that_goes_farther_than_it_tells_has_its_scale_identified(noise, oriented):
    arm = on_a_rail()
    values = np.where(arm.prismatic, -1.7e-4, 0.0)
    correction = Correction(arm.joint_names, JointErrors(JointTerms(scale=True), values[None]))
    given = (160, 1, 2, oriented, noise, 2 * noise, arm, correction)
    done = identify_points(tracked(72, *given).measured)
    assert done.joint_error_choice.accepted == ('scale',)
    assert done.joint_error_choice.lines[0].endswith('correction.yaml has it: no URDF can')
    found = {one.parameter.name: one for one in done.estimates}
    assert found['scale_1'].identifiable
    assert found['scale_2'].reason == 'scale_2: joint 2 does not slide'
    within = 4 * found['scale_1'].standard_uncertainty + 1e-10
    assert found['scale_1'].identified == pytest.approx(-1.7e-4, abs=within)
    unseen = tracked(73, 40, 1, 2, oriented, arm=arm, correction=correction, world=72)
    judged = held_out_points(unseen.measured, done)
    assert judged.identified.distance.max() < (6 * noise or 1e-9)


def test_a_rail_that_stands_still_has_no_scale_to_tell():
    arm = on_a_rail()
    joints = tracked(74, 30, arm=arm).measured.points.joints.copy()
    joints[:, 0] = 0.4
    table = table_with(points_table(arm), arm, joints, ('scale', 'encoder'), None)
    assert table.parameters[table.column('scale_1')].reason == 'scale_1: joint 1 stands still'
    reason = table.parameters[table.column('encoder_cos2_1')].reason
    assert reason == 'joint 1 slides: it has no angle'
    assert table.parameters[table.column('encoder_cos2_2')].free


def test_what_the_base_and_the_target_take_up_is_not_freed():
    done = identify_points(tracked(81, 100, 1, 1, True, NOISE, TURN_NOISE).measured, PLAIN)
    free = {one.parameter.name for one in done.estimates if one.parameter.free}
    assert free.isdisjoint({'d1', 'theta_0_1', 'a6', 'alpha6', 'd6', 'theta_0_6'})
    assert done.observability.rank == len(done.fit.x) == 18


def test_sigmas_weigh_the_points():
    scene = tracked(82, 120, noise=NOISE)
    generator = np.random.default_rng(5)
    sigma = np.where(np.arange(120) % 2, NOISE, 40 * NOISE)
    position = scene.measured.points.position
    position = position + (sigma > NOISE)[:, None] * 40 * NOISE * generator.normal(size=(120, 3))
    given = replace(scene.measured.points, position=position, sigma=sigma)
    plain = replace(given, sigma=np.zeros(120))
    unseen = tracked(83, 60, world=82).measured
    missed = [
        held_out_points(unseen, identify_points(replace(scene.measured, points=one), PLAIN))
        for one in (given, plain)
    ]
    weighed, equal = (one.identified.distance.mean() for one in missed)
    assert weighed < 0.3 * equal


def test_what_only_a_gauge_has_is_refused():
    with pytest.raises(DataError, match='have no distances'):
        identify_points(tracked(91, 40).measured, Options('distance'))


def test_a_station_of_two_points_is_named():
    measured = tracked(92, 40).measured
    station = measured.points.station.copy()
    station[:2] = 7
    with pytest.raises(DataError, match='station 7 has 2 points'):
        identify_points(replace(measured, points=replace(measured.points, station=station)))


def test_too_few_points_without_a_prior_are_refused():
    with pytest.raises(RankError, match='cannot tell'):
        identify_points(tracked(93, 8).measured, PLAIN)


def test_a_monte_carlo_and_a_bootstrap_say_what_is_stated():
    scene = tracked(95, 90, 2, 1, True, NOISE, TURN_NOISE)
    done = identify_points(scene.measured, Options('position', quick=True))
    resampled = resample_points(done, Plan(12, 12, 4), in_processes(1))
    stated = done.position_uncertainty.mean()
    for repeated in (resampled.monte_carlo, resampled.bootstrap):
        assert repeated.converged == 12
        found = done.workspace.uncertainty(repeated.covariance).mean()
        # twelve repetitions tell it to a fifth or so
        assert 0.6 < found / stated < 1.6
