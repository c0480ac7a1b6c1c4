# SPDX-License-Identifier: Apache-2.0
"""The pass over measured points: against finite differences, and compiled against numpy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated_calibration import iiwa, kr5, on_a_rail, stanford, turned_kr5
from simulated_joint_errors import LINKS
from simulated_points import tracked

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import JointTerms, ParameterTable
from calib_model.transforms import RigidTransform
from calib_solver.points import FLANGE, Flange, Places, PointProblem, point_slopes
from calib_solver.points.identification import identify_points
from calib_solver.points.point_sums import (
    BLOCK,
    accumulate_points,
    accumulate_points_compiled,
    accumulate_points_numpy,
    columns_of,
)
from calib_solver.problem import kernel

pytestmark = pytest.mark.timeout(60)


def off_base_and_flange(arm: Arm) -> Arm:
    base = RigidTransform(np.array([0.3, -0.2, 0.5]), np.array([0.4, -1.0, 0.7]))
    flange = RigidTransform(np.array([-0.02, 0.05, 0.03]), np.array([-1.2, 0.3, 0.9]))
    return replace(arm, base_T_dh=base, dh_T_flange=flange)


def backwards(arm: Arm) -> Arm:
    return replace(arm, joints=tuple(replace(each, direction=-1) for each in arm.joints))


#: an arm, targets, stations, whether with orientations, and joint errors
CASES = {
    'one target': (kr5(), 1, 1, False, None),
    'three of each': (kr5(), 3, 3, True, None),
    'off the base and the flange': (off_base_and_flange(kr5()), 2, 1, True, JointTerms(2)),
    'directions of -1': (turned_kr5(), 1, 2, True, JointTerms(1)),
    'a rail and a coupled axis': (on_a_rail(), 2, 2, True, JointTerms(2)),
    'seven joints': (iiwa(), 1, 1, True, None),
    'a rail that tells too little': (backwards(stanford()), 2, 1, True, JointTerms(1, scale=True)),
    'joints that bend': (kr5(), 1, 2, True, JointTerms(1, LINKS)),
    'such a rail and joints that bend': (stanford(), 1, 1, True, JointTerms(1, LINKS, True)),
}


@cache
def at(case: str) -> tuple[PointProblem, ParameterTable, Array, Places]:
    """A problem away from its minimum; beta is set in every joint so that its column is tried."""
    arm, targets, stations, oriented, terms = CASES[case]
    geometry = arm.geometry.copy()
    geometry[4] = np.linspace(-0.2, 0.3, arm.n)
    scene = tracked(
        11, 31, targets, stations, oriented, 3e-4, 3e-4, arm=arm.with_geometry(geometry)
    )
    generator = np.random.default_rng(6)
    problem = PointProblem.of(scene.measured)
    trust = generator.uniform(0.1, 1.0, 31)
    trust[5] = 0.0
    problem = replace(problem, weight=generator.uniform(0.5, 2.0, 31)).trusting(trust)
    if oriented:
        some = problem.oriented.copy()
        some[::7] = 0.0
        problem = replace(problem, oriented=some)
    table = ParameterTable.of(problem.arm, FLANGE)
    if terms is not None:
        table = table.with_joint_terms(terms)
    table = table.frozen_at(table.matching('probe_*'), 'a target').frozen_at([2, 9], 'a gap')
    full = table.nominal + 1e-3 * generator.normal(size=len(table.nominal))
    full[table.mount] = 0.0
    places = Places(scene.station_rotation, scene.station, scene.target_rotation, scene.target)
    # T_tracker_base is the other way about the base
    return problem, table, full, places.moved(1e-3 * generator.normal(size=problem.places))


def without_residuals(problem: PointProblem, flange: Flange, places: Places) -> PointProblem:
    """Measured as it is predicted: there the Jacobian of Gauss and Newton is that of residuals."""
    base = places.station_rotation[problem.station]
    seen = np.einsum('nij,nj->ni', base, flange.points(problem, places))
    turned = base @ flange.rotation @ places.target_rotation[problem.target]
    return replace(problem, position=seen + places.station[problem.station], rotation=turned)


def own_steps(problem: PointProblem, free: int, column: int, step: float) -> list[Array]:
    """The step of all columns for each part by which its own `column` moves."""
    found = []
    for part in range(len(problem.parts) - 1):
        own = np.concatenate([np.arange(free), free + columns_of(problem, part)])
        moved = np.zeros(free + problem.places)
        moved[own[column]] = step
        found.append(moved)
    return found


@pytest.mark.parametrize('case', [name for name in CASES if 'joints that bend' not in name])
def test_every_column_is_the_finite_difference_of_the_residuals(case: str):
    problem, table, full, places = at(case)
    problem = without_residuals(problem, Flange.of(problem, table, full), places)
    free = len(table.free_columns)
    slopes = point_slopes(problem, table, full, places, np.arange(len(problem)))

    def residuals(moved: Array) -> tuple[Array, Array]:
        there = full.copy()
        there[table.free_columns] += moved[:free]
        flange = Flange.of(problem, table, there)
        return flange.residuals(problem, places.moved(moved[free:]))

    for column in range(free + 12):
        steps = own_steps(problem, free, column, 1e-5)
        for part, step in enumerate(steps):
            rows = problem.part == part
            after, before = residuals(step), residuals(-step)
            for kind in (0, 1) if problem.has_orientation else (0,):
                seen = rows & (problem.oriented > 0) if kind else rows
                slope = (after[kind] - before[kind])[seen] / 2e-5
                np.testing.assert_allclose(
                    slopes[kind][seen][:, :, column], slope, atol=1e-8, err_msg=str(column)
                )


needs_kernel = pytest.mark.skipif(kernel._kernel is None, reason='the kernel is not compiled here')


@needs_kernel
@pytest.mark.parametrize('folded', [False, True])
@pytest.mark.parametrize('case', CASES)
def test_the_compiled_pass_adds_up_what_numpy_does(case: str, folded: bool):
    problem, table, full, places = at(case)
    folds = np.arange(len(problem)) % 3 if folded else None
    residuals = Flange.of(problem, table, full).residuals(problem, places)
    given = (problem, table, full, places, residuals, folds)
    compiled, twin = accumulate_points_compiled(*given), accumulate_points_numpy(*given)
    assert len(compiled) == len(twin) == (3 if folded else 1)
    for one, other in zip(compiled, twin, strict=True):
        for name, values in vars(other).items():
            found = getattr(one, name)
            scale = np.abs(values).max()
            np.testing.assert_allclose(found, values, atol=1e-13 * scale, err_msg=name)


@needs_kernel
def test_many_points_add_up_the_same_on_any_number_of_threads(monkeypatch):
    scene = tracked(12, 3 * BLOCK, 1, 2, True, 3e-4, 3e-4)
    problem = PointProblem.of(scene.measured)
    table = ParameterTable.of(problem.arm, FLANGE)
    places = Places(scene.station_rotation, scene.station, scene.target_rotation, scene.target)
    residuals = Flange.of(problem, table, table.nominal).residuals(problem, places)
    given = (problem, table, table.nominal, places, residuals)
    found = []
    for threads in (1, 2):
        monkeypatch.setattr(kernel, 'threads', lambda threads=threads: threads)
        monkeypatch.setattr(kernel, 'POSES_PER_THREAD', 500)
        found.append(accumulate_points_compiled(*given)[0])
    (twin,) = accumulate_points_numpy(*given)
    for name, values in vars(twin).items():
        np.testing.assert_array_equal(*(getattr(one, name) for one in found))
        np.testing.assert_allclose(getattr(found[0], name), values, rtol=1e-9, atol=1e-9)


@needs_kernel
def test_an_identification_ends_where_it_does_without_the_kernel(monkeypatch):
    measured = tracked(13, 80, 2, 2, True, 4e-5, 9e-5).measured
    here = identify_points(measured)
    monkeypatch.setattr(kernel, '_kernel', None)
    there = identify_points(measured)
    np.testing.assert_allclose(here.full, there.full, rtol=0, atol=1e-9)
    assert here.identified.phi == pytest.approx(there.identified.phi, rel=1e-9)


@needs_kernel
def test_arrays_that_do_not_go_together_are_refused():
    problem, table, full, places = at('three of each')
    residuals = Flange.of(problem, table, full).residuals(problem, places)
    short = (residuals[0][:-1], residuals[1])
    with pytest.raises((ValueError, IndexError)):
        accumulate_points_compiled(problem, table, full, places, short)
    with pytest.raises(ValueError, match='expected 16 inputs and 2 outputs'):
        kernel._kernel.accumulate_points((), (), 0, 0)
    assert accumulate_points(problem, table, full, places)[0].phi.all()
