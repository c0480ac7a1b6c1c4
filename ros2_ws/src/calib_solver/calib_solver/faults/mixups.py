# SPDX-License-Identifier: Apache-2.0
"""Mix-ups: what a measurement would be if something had been wired, counted or named otherwise.

A calibration that leaves large residuals is asked whether its poses would fit far better with two
styli exchanged, a joint counted the other way, degrees for radians, without an encoder's jump. What
does is named to the user and never put right behind his back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import ActiveProbe, Arm
from calib_model.kinematics import ParameterTable
from calib_model.measurement import Measurement, ProbingSet
from calib_solver.faults.encoder_jumps import large_jumps
from calib_solver.faults.mirror import mirroring_joints
from calib_solver.faults.residual_projection import rough_spread
from calib_solver.fitting import Solver, try_probe_fit
from calib_solver.problem import IntArray, Problem
from calib_solver.quality import assess

#: so many poses are enough to tell a mix-up
POSES = 280
#: a mix-up is named when the poses fit so many times better with it
FACTOR = 4.0
#: and no better than this (m) it explains nothing
EXPLAINED = 1e-3
#: another that comes so near the best cannot be told from it
NEARLY = 1.2
#: so many that fit best after one rough step are solved for
TRIED = 6
#: a parameter so many times further off than is usual is not the work of makers or mastering
MIXED_UP = 25.0
#: with fewer poses than this a jump explains anything
FEWEST_TO_JUMP = 30
DEGREES = 180 / np.pi

Change = Callable[[ProbingSet], ProbingSet]


@dataclass(frozen=True)
class Mixup:
    """Something that may have been done otherwise than the descriptions say."""

    text: str
    change: Change


def named_mixups(
    measured: Measurement, spread: float, solver: Solver, far: bool = False
) -> tuple[str, ...]:
    """A line for what would make the poses fit FACTOR times better than their `spread` (m); where
    they fit by parameters that are `far` from nominal, as well without that.

    The likeliest are solved for; the solver's prior keeps those that fit nothing from wandering,
    and what fits near nominal.
    """
    places = _places(len(measured.poses))
    few = replace(measured, poses=measured.poses.take(places))
    if far and spread <= EXPLAINED:
        size, near = _solved(Problem.of(few), solver)
        if near and size <= NEARLY * spread:
            return ()  # they are far for want of a prior, not of an explanation
    simple = _likely(few, mixups(measured), spread, solver, far)
    return simple or _likely(few, _jumps(few, solver, places), spread, solver, far)


def _likely(
    few: Measurement, what: Iterable[Mixup], spread: float, solver: Solver, far: bool
) -> tuple[str, ...]:
    tried: list[tuple[float, str, Problem]] = []
    for mixup in what:
        try:
            problem = Problem.of(replace(few, poses=mixup.change(few.poses)))
        except CalibrationError:
            continue  # poses that fit no probe or no arm explain nothing
        tried.append((rough_spread(problem, solver.table, solver.scale), mixup.text, problem))
    found: list[tuple[float, str]] = []
    for _, text, problem in sorted(tried, key=lambda one: one[0])[:TRIED]:
        try:
            size, near = _solved(problem, solver)
        except CalibrationError:
            continue  # nor do these
        if near or not far:
            found.append((size, text))
    best = min((size for size, _ in found), default=np.inf)
    likely = [text for size, text in sorted(found) if size <= NEARLY * best]
    better = best <= min(EXPLAINED, spread / FACTOR)
    if far and not better and best <= min(EXPLAINED, NEARLY * spread):
        return (
            f'the poses fit as well, {best * 1e3:.4f} mm from pose to pose, with parameters near '
            f'nominal and {" or ".join(likely)}: nothing was changed; is the count of the joints '
            "and readings the description's?",
        )
    if not better:
        return ()
    return (
        f'the poses would fit {spread / best:.0f} times better with {" or ".join(likely)} '
        f'({best * 1e3:.4f} mm instead of {spread * 1e3:.4f} mm from pose to pose): '
        'nothing was changed, this result is not to be used',
    )


def _solved(problem: Problem, solver: Solver) -> tuple[float, bool]:
    """The usual distance (m) of a pose from its sphere's centre, when the problem is solved, and
    whether the arm is near nominal then."""
    solver.refuse_too_little(problem)
    _, descent = solver.solve(problem, solver.start(problem, try_probe_fit(problem)))
    size = assess(problem, *solver.arm_and_probe(problem, descent)).spread
    return size, not far_from_nominal(solver.table, solver.full(descent.x), solver.scale)


def far_from_nominal(table: ParameterTable, full: Array, sigma: Array) -> bool:
    """Whether a D-H parameter is further from nominal than errors of make or mastering take it;
    `full` (C,) are all parameters, `sigma` (F,) what the free ones usually are off by."""
    times = np.abs((full - table.nominal)[table.free_columns]) / sigma
    return bool((times[table.of_arm] > MIXED_UP).any())


def named_joints(arm: Arm, joints: Sequence[int]) -> str:
    """Some of the joints (from 0) in words."""
    names = [arm.joint_names[joint] for joint in joints]
    return f'joints {", ".join(names[:-1])} and {names[-1]}' if names[1:] else f'joint {names[0]}'


def beyond_belief(spread: float) -> tuple[str, ...]:
    """Poses that no arm worth calibrating would leave so far apart."""
    if spread < EXPLAINED:
        return ()
    return (
        f'the poses of one sphere still lie {spread * 1e3:.3f} mm apart (rms) after the fit: this '
        'is not the arm, the probe or the numbering that the descriptions tell of (order, signs '
        'and units of joints and readings; two places under one location number); not to be used',
    )


def mixups(measured: Measurement) -> Iterator[Mixup]:
    """What can be mixed up in this arm and probe."""
    names = measured.arm.joint_names
    every = range(len(names))
    yield Mixup('joint positions taken as degrees', _scaled('joints', every, np.pi / 180))
    twice = 'joint positions taken as turned to radians twice'
    yield Mixup(twice, _scaled('joints', every, DEGREES))
    for i, name in enumerate(names):
        yield Mixup(f'joint {name} taken as degrees', _scaled('joints', [i], np.pi / 180))
        yield Mixup(f'joint {name} counted the other way', _scaled('joints', [i], -1.0))
        for degrees in (90, -90, 180):
            yield Mixup(f'{degrees} deg added to joint {name}', _turned_joint(i, degrees))
    if mirroring := mirroring_joints(measured.arm):
        joints = named_joints(measured.arm, mirroring)
        yield Mixup(f'{joints} counted the other way', _scaled('joints', mirroring, -1.0))
    for i, j in combinations(range(len(names)), 2):
        yield Mixup(f'joints {names[i]} and {names[j]} exchanged', _swapped('joints', i, j))
    if isinstance(measured.probe, ActiveProbe):
        for i, j in combinations(range(3), 2):
            yield Mixup(f'styli {i + 1} and {j + 1} exchanged', _swapped('displacement', i, j))
        for i in range(3):
            yield Mixup(f'the sign of stylus {i + 1} reversed', _scaled('displacement', [i], -1.0))


def _swapped(column: str, i: int, j: int) -> Change:
    def exchange(values: Array) -> None:
        values[:, [i, j]] = values[:, [j, i]]

    return _changed(column, exchange)


def _scaled(column: str, places: Iterable[int], factor: float) -> Change:
    def scale(values: Array) -> None:
        values[:, list(places)] *= factor

    return _changed(column, scale)


def _turned_joint(joint: int, degrees: float) -> Change:
    def turn(values: Array) -> None:
        values[:, joint] += np.radians(degrees)

    return _changed('joints', turn)


def _changed(column: str, change: Callable[[Array], None]) -> Change:
    """`change` done to a copy of the joints or the displacements."""

    def changed(poses: ProbingSet) -> ProbingSet:
        values: Any = np.array(getattr(poses, column))
        change(values)
        return replace(poses, **{column: values})

    return changed


def _jumps(few: Measurement, solver: Solver, places: IntArray) -> Iterator[Mixup]:
    """Encoders that may have jumped; `places` (N,) are those of `few` in the whole measurement."""
    if len(few.poses) < FEWEST_TO_JUMP:
        return
    for jump in large_jumps(few, solver.table, solver.scale):
        name = few.arm.joint_names[jump.joint]
        yield Mixup(f'joint {name} put right where it {jump.text(few.arm, places)}', jump.removed)


def _places(count: int) -> IntArray:
    """At most POSES of the poses, the same share of every stretch of the measurement."""
    return np.unique(np.linspace(0, count - 1, POSES).astype(np.int64))
