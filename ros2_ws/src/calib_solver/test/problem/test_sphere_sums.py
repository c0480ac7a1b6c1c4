# SPDX-License-Identifier: Apache-2.0
"""One pass over the poses: its Jacobian against finite differences, its sums against each pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import (
    iiwa,
    kr5,
    on_a_rail,
    passive,
    random_arm,
    simulate,
    turned_kr5,
)
from simulated_joint_errors import LINKS

from calib_model.instruments import Arm, trihedron
from calib_model.kinematics import Correction, JointTerms, ParameterTable, points
from calib_model.transforms import RigidTransform
from calib_solver.problem import kernel as compiled, sphere_sums as sums
from calib_solver.problem.problem import Problem

pytestmark = pytest.mark.timeout(60)

FAR_TURNED = trihedron(RigidTransform(np.array([0.03, -0.02, 0.1]), np.array([1.4, -1.1, 1.9])))


def scene_of(arm, probe, poses=6):
    """A few poses of an arm; beta is set in every joint so that its column is tried."""
    geometry = arm.geometry.copy()
    geometry[4] = np.linspace(-0.2, 0.3, arm.n)
    return simulate(arm.with_geometry(geometry), probe, 5, locations=2, poses=poses)


def off_base_and_flange(arm: Arm) -> Arm:
    """The arm with transforms before its first joint and behind its last."""
    base = RigidTransform(np.array([0.3, -0.2, 0.5]), np.array([0.4, -1.0, 0.7]))
    flange = RigidTransform(np.array([-0.02, 0.05, 0.03]), np.array([-1.2, 0.3, 0.9]))
    return replace(arm, base_T_dh=base, dh_T_flange=flange)


CASES = {
    'off the base and the flange': (off_base_and_flange(kr5()), FAR_TURNED),
    'kr5, probe turned far': (kr5(), FAR_TURNED),
    'directions of -1': (turned_kr5(), FAR_TURNED),
    'seven joints': (iiwa(), FAR_TURNED),
    'passive': (kr5(), passive()),
    'a rail and a coupled axis': (on_a_rail(), FAR_TURNED),
}


def point_at(problem, table, full):
    """Every pose's point by the plain forward model."""
    arm, probe = table.apply(full, problem.measured.arm, problem.measured.probe)
    there = Correction(arm.joint_names, table.joint_errors(full)).joints(arm, problem.joints)
    return points(arm, there, probe.flange_T_probe.apply(problem.centers))


def with_encoders(table, size=0.0):
    """The table with encoders' harmonics, that are off by `size` (rad) and not by nothing."""
    wider = table.with_joint_terms(JointTerms(2))
    off = size * np.random.default_rng(4).normal(size=len(wider.names) - len(table.names))
    full = np.append(table.nominal, off)
    rows = [replace(p, nominal=float(x)) for p, x in zip(wider.parameters, full, strict=True)]
    return replace(wider, parameters=tuple(rows))


@pytest.mark.parametrize('case', CASES)
def test_every_column_of_the_jacobian_is_the_finite_difference(case):
    problem = Problem.of(scene_of(*CASES[case]).measured)
    measured = problem.measured
    table = with_encoders(ParameterTable.of(measured.arm, measured.probe), 1e-2)
    assert len(table.names) == (5 + 4) * measured.arm.n + 6
    point, jacobian = sums.point_jacobian(
        problem, table, table.nominal, np.arange(len(problem.joints))
    )
    np.testing.assert_allclose(point, point_at(problem, table, table.nominal), atol=1e-14)
    step = 1e-5
    for column, name in enumerate(table.names):
        moved = np.zeros(len(table.names))
        moved[column] = step
        # fourth order: the error is below 1e-10 where the step's own rounding is 1e-11
        near = point_at(problem, table, table.nominal + moved)
        near = near - point_at(problem, table, table.nominal - moved)
        far = point_at(problem, table, table.nominal + 2 * moved)
        far = far - point_at(problem, table, table.nominal - 2 * moved)
        slope = (8 * near - far) / (12 * step)
        np.testing.assert_allclose(jacobian[:, :, column], slope, atol=2e-10, err_msg=name)


def brute_force(problem, table, full):
    """Each sphere's sums as their definitions say, pose by pose."""
    every = np.arange(len(problem.joints))
    point, jacobian = sums.point_jacobian(problem, table, full, every)
    jacobian = jacobian[:, :, table.free_columns]
    for sphere in range(len(problem.keys)):
        rows = problem.rows(sphere)
        weight, p, j = problem.weight[rows], point[rows], jacobian[rows]
        center = np.average(p, axis=0, weights=weight)
        mean = np.average(j, axis=0, weights=weight)
        gradient, normal = np.zeros(j.shape[2]), np.zeros((j.shape[2],) * 2)
        for w, one, slope in zip(weight, p - center, j - mean, strict=True):
            gradient += w * slope.T @ one
            normal += w * slope.T @ slope
        yield weight.sum(), center, mean, weight @ (p - center) ** 2, gradient, normal


def passes():
    """The public pass, and the two that may stand behind it."""
    names = ['accumulate', 'accumulate_numpy']
    return [*names, 'accumulate_compiled'] if compiled._kernel is not None else names


@pytest.mark.slow
@pytest.mark.parametrize('name', passes())
@pytest.mark.parametrize('kind', ['equal', 'weighted', 'encoders'])
@pytest.mark.parametrize('case', CASES)
def test_the_sums_are_what_each_pose_adds_up_to(case, kind, name):
    problem = Problem.of(scene_of(*CASES[case], poses=7).measured)
    if kind == 'weighted':
        generator = np.random.default_rng(8)
        problem = replace(problem, weight=generator.uniform(0.01, 1.0, len(problem.joints)))
    table = ParameterTable.of(problem.measured.arm, problem.measured.probe)
    if kind == 'encoders':
        table = with_encoders(table, 1e-2)
    table = table.frozen_at([0, 7, 13, len(table.names) - 3], 'a gap between the free columns')
    full = table.nominal + 1e-3 * np.random.default_rng(3).normal(size=len(table.nominal))
    found = getattr(sums, name)(problem, table, full)
    for s, (count, center, mean, spread, gradient, normal) in enumerate(
        brute_force(problem, table, full)
    ):
        assert found.count[s] == pytest.approx(count, rel=1e-14)
        np.testing.assert_allclose(found.center[s], center, atol=1e-14)
        np.testing.assert_allclose(found.jacobian[s], mean, atol=1e-13)
        np.testing.assert_allclose(found.spread[s], spread, rtol=1e-9)
        np.testing.assert_allclose(found.gradient[s], gradient, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.normal[s], normal, rtol=1e-9, atol=1e-11)


def test_spheres_with_more_poses_than_a_block_add_up_the_same():
    scene = simulate(kr5(), passive(), 6, locations=1, spheres=(1, 14), poses=25)
    poses = scene.measured.poses
    many = np.tile(np.arange(len(poses)), 90)
    problem = Problem.of(replace(scene.measured, poses=poses.take(many)))
    assert problem.counts.min() > 2 * sums.BLOCK
    once = Problem.of(scene.measured)
    table = ParameterTable.of(scene.measured.arm, scene.measured.probe)
    long = sums.accumulate(problem, table, table.nominal)
    short = sums.accumulate(once, table, table.nominal)
    np.testing.assert_allclose(long.center, short.center, atol=1e-14)
    np.testing.assert_allclose(long.spread, 90 * short.spread, rtol=1e-9)
    np.testing.assert_allclose(long.gradient, 90 * short.gradient, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(long.normal, 90 * short.normal, rtol=1e-9, atol=1e-9)


def test_compliance_has_the_same_sums_in_both_passes():
    problem = Problem.of(scene_of(turned_kr5(), FAR_TURNED).measured)
    table = ParameterTable.of(problem.measured.arm, problem.measured.probe)
    table = table.with_joint_terms(JointTerms(3, LINKS))
    full = table.nominal + 1e-4 * np.random.default_rng(6).normal(size=len(table.nominal))
    usual = sums.accumulate(problem, table, full)
    twin = sums.accumulate_numpy(problem, table, full)
    for field in ('center', 'jacobian', 'spread', 'gradient', 'normal'):
        one, other = getattr(usual, field), getattr(twin, field)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


@pytest.mark.parametrize('seed', range(3))
def test_random_arms_have_the_same_sums_in_both_passes(seed):
    generator = np.random.default_rng(seed)
    scene = simulate(random_arm(generator), passive(), seed, locations=1, poses=9)
    problem = Problem.of(scene.measured)
    table = ParameterTable.of(scene.measured.arm, scene.measured.probe)
    usual = sums.accumulate(problem, table, table.nominal)
    twin = sums.accumulate_numpy(problem, table, table.nominal)
    for field in ('count', 'center', 'jacobian', 'spread', 'gradient', 'normal'):
        np.testing.assert_allclose(
            getattr(usual, field), getattr(twin, field), rtol=1e-9, atol=1e-12, err_msg=field
        )
