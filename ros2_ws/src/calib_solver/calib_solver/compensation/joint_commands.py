# SPDX-License-Identifier: Apache-2.0
"""Joint commands that really get there: the identified arm's inverse, started from the nominal's.

What no probing shows, d1 and theta_0_1, is as nominal in the identified arm: positions are told
in the base frame that these two fix. Where that frame stands in the room is for the user to say, by
touching points that are known there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import tool_motion
from calib_solver.compensation.calibrated_arm import Calibrated
from calib_solver.compensation.inverse_kinematics import (
    AT_LIMIT,
    EXACT,
    Reached,
    Rows,
    Targets,
    reach,
)
from calib_solver.compensation.singularity import jumps, left_over, near_singular, reach_near

ROUNDS = 6  # between encoder readings and joints
TRIES = 15  # postures a nominal answer is looked for from
APART = 0.3  # rad between answers of neighbouring rows, beyond which the branch is looked at
FELT = 1e-8  # m or rad: less is left by rounding


class CompensationError(CalibrationError):
    """A target that the arm does not reach."""


@dataclass(frozen=True)
class Compensated:
    """`nominal` (N, n) are the joint commands of the nominal arm, `joints` (N, n) those that get
    there, rad, NaN in rows that the arm does not reach: `unreached` says why, by row. `miss` (N,),
    m, is how far off the nominal ones are by the identified arm; `held` are rows near a
    singularity, whose tool stays `left` (N,), m, and `left_turn` (N,), rad, away from its target
    so that the joints go on as in the program."""

    nominal: Array
    joints: Array
    miss: Array
    left: Array
    left_turn: Array
    unreached: Mapping[int, str] = field(default_factory=dict)

    @property
    def held(self) -> Rows:
        """Rows, from 0, that are not brought to their target altogether."""
        return np.flatnonzero((self.left > FELT) | (self.left_turn > FELT))


def row_number(row: int) -> str:
    """What an error calls a row, counted from 1."""
    return f'row {row + 1}'


def compensate_joints(
    calibrated: Calibrated,
    q: Array,
    position_only: bool = False,
    place: Callable[[int], str] = row_number,
) -> Compensated:
    """The joint commands that really bring the tool where `q` (N, n), rad, nominally does.

    Arms with joints to spare change the least; with `position_only` the tool may turn. Near a
    singularity the program's branch is kept, and what that leaves is told.

    Raises:
        DataError: the number of joints is not the arm's.
        CompensationError: the arm reaches none of the rows; names the first (by `place`).
    """
    q = calibrated.nominal.check_joints(q)
    wanted = tool_motion(calibrated.nominal, q, calibrated.nominal_tool)
    targets = Targets(wanted.position, None if position_only else wanted.rotation)
    found = _really_reach(calibrated, targets, q)
    if jumps(q, found.q).any():
        found = _really_reach(calibrated, targets, q, near=True)
    why = {
        int(row): _obstacle(calibrated, found, int(row)) for row in np.flatnonzero(~found.arrived)
    }
    return _finished(calibrated, targets, q, found.q, why, place)


def compensate_targets(
    calibrated: Calibrated,
    targets: Targets,
    start: Array | None = None,
    place: Callable[[int], str] = row_number,
) -> Compensated:
    """The joint commands that really bring the tool to Cartesian targets in the base frame.

    The nominal answers are looked for from `start` (N, n), rad, or the middle of the joints'
    ranges, and then from anywhere; without `start`, a row whose answer is far from that of the row
    before is looked for from there too, so that a path stays in its branch where it can.

    Raises:
        DataError: the number of joints is not the arm's.
        CompensationError: the arm reaches none of the rows; names the first (by `place`).
    """
    arm, count = calibrated.nominal, len(targets.position)
    lower, upper = arm.ranges.T
    generator = np.random.default_rng(0)
    tried = np.tile((lower + upper) / 2, (count, 1))
    if start is not None:
        tried = np.array(arm.check_joints(start))
    nominal, joints = np.full((2, count, arm.n), np.nan)
    left: Rows = np.arange(count)
    why = dict.fromkeys(range(count), 'not even nominally')
    for _ in range(TRIES):
        answered, answers = _nominal_answers(calibrated, targets.take(left), tried[left])
        rows = left[answered]
        found = _really_reach(calibrated, targets.take(rows), answers)
        why |= {int(row): _obstacle(calibrated, found, i) for i, row in enumerate(rows)}
        nominal[rows], joints[rows] = answers, found.q
        left = np.setdiff1d(left, rows[found.arrived])
        if not len(left):
            break
        tried[left] = generator.uniform(lower, upper, (len(left), arm.n))
    why = {row: why[row] for row in map(int, left)}
    if start is None:
        _follow(calibrated, targets, nominal, joints, why)
    rows = np.setdiff1d(np.arange(count), list(why))
    if jumps(nominal[rows], joints[rows]).any():
        found = _really_reach(calibrated, targets.take(rows), nominal[rows], near=True)
        joints[rows] = np.where(found.arrived[:, None], found.q, joints[rows])
    return _finished(calibrated, targets, nominal, joints, why, place)


def _follow(
    calibrated: Calibrated,
    targets: Targets,
    nominal: Array,
    joints: Array,
    unreached: Mapping[int, str],
) -> None:
    """Answer rows anew from the row before where that is nearer to it: in place."""
    for row in range(1, len(joints)):
        away = np.abs(nominal[row] - nominal[row - 1]).max()
        if not away > APART or row in unreached or row - 1 in unreached:
            continue
        here = targets.take(np.array([row]))
        answered, answers = _nominal_answers(calibrated, here, nominal[row - 1 : row])
        if not answered[0] or np.abs(answers[0] - nominal[row - 1]).max() >= away:
            continue
        found = _really_reach(calibrated, here, answers)
        if found.arrived[0]:
            nominal[row], joints[row] = answers[0], found.q[0]


def _nominal_answers(
    calibrated: Calibrated, targets: Targets, start: Array
) -> tuple[NDArrayBool, Array]:
    """Which targets (N,) the nominal arm reaches from there within its limits, and how (K, n)."""
    arm = calibrated.nominal
    found = reach(arm, calibrated.nominal_tool, targets, start, stay=False)
    # by full turns nearest to the middle of each joint's range
    middle = arm.ranges.mean(axis=1)
    turned = found.q - 2 * np.pi * np.round((found.q - middle) / (2 * np.pi))
    turned = np.where(_turns_freely(arm), turned, found.q)
    answered = (found.miss < EXACT) & arm.within_limits(turned)
    return answered, turned[answered]


def _turns_freely(arm: Arm) -> NDArrayBool:
    """Which joints (n,) a full turn brings back to where they were, and nothing else with them."""
    free: NDArrayBool = np.isfinite(arm.limits).all(axis=1) & ~arm.prismatic
    for joint in arm.joints:
        if joint.coupling is not None:
            free[arm.joint_names.index(joint.coupling.joint)] = False
    return free


def _really_reach(
    calibrated: Calibrated, targets: Targets, start: Array, near: bool = False
) -> Reached:
    """The joint commands of the identified arm, what is beyond its D-H parameters included.

    Joint errors and shifts are small and smooth, so going to and fro between what the encoders
    read and where the joints are settles by their slope, a thousandth, each time. With `near`, what
    singular postures miss is not said.
    """
    arm, correction = calibrated.identified, calibrated.correction
    if correction is None:
        return _reached(calibrated, targets, start, start, near)
    q, there = start, correction.joints(arm, start)
    program = there
    for _ in range(ROUNDS):
        unshifted = Targets(targets.position - correction.shifts(arm, q), targets.rotation)
        found = _reached(calibrated, unshifted, there, program, near)
        q = q + found.q - correction.joints(arm, q)
    beyond = _beyond(arm, q)
    worst = np.where(beyond.max(axis=1) > 0, beyond.argmax(axis=1), -1)
    left = np.linalg.norm(calibrated.tool_at(q) - targets.position, axis=1)
    miss = found.miss if near else np.maximum(found.miss, left)
    return Reached(q, miss, np.where(found.limit < 0, worst, found.limit))


def _reached(
    calibrated: Calibrated, targets: Targets, start: Array, program: Array, near: bool
) -> Reached:
    """Postures from `start` (N, n) at the targets; if `near`, in the branch of `program` (N, n)
    where that is singular."""
    arm, tool = calibrated.identified, calibrated.identified_tool
    found = reach(arm, tool, targets, start)
    if not near:
        return found
    singular, least = near_singular(arm, tool, targets, program)
    rows = np.flatnonzero(singular)
    q, miss, limit = np.array(found.q), np.array(found.miss), np.array(found.limit)
    q[rows] = reach_near(arm, tool, targets.take(rows), program[rows], least)
    miss[rows] = 0.0
    beyond = _beyond(arm, q[rows])
    limit[rows] = np.where(beyond.max(axis=1) > AT_LIMIT, beyond.argmax(axis=1), -1)
    return Reached(q, miss, limit)


def _beyond(arm: Arm, q: Array) -> Array:
    """By how much each joint of q (N, n) is beyond its limits, rad; below zero within them."""
    beyond: Array = np.maximum(arm.limits[:, 0] - q, q - arm.limits[:, 1])
    return beyond


def _finished(
    calibrated: Calibrated,
    targets: Targets,
    q: Array,
    joints: Array,
    why: Mapping[int, str],
    place: Callable[[int], str],
) -> Compensated:
    unreached = {
        row: f'{place(row)}: {_unreached(calibrated, targets, row)}: {reason}'
        for row, reason in sorted(why.items())
    }
    if len(unreached) == len(joints):
        raise CompensationError(next(iter(unreached.values())))
    joints = np.array(joints)
    joints[list(unreached)] = np.nan
    left, turn = left_over(
        calibrated.identified,
        calibrated.identified_tool,
        *_where_it_is(calibrated, targets, joints),
    )
    missed = np.linalg.norm(calibrated.tool_at(q) - targets.position, axis=1)
    return Compensated(
        frozen(q), frozen(joints), frozen(missed), frozen(left), frozen(turn), unreached
    )


def _where_it_is(calibrated: Calibrated, targets: Targets, q: Array) -> tuple[Targets, Array]:
    """Targets and joints (N, n) of the D-H model alone, for the encoders' readings q (N, n)."""
    arm, correction = calibrated.identified, calibrated.correction
    if correction is None:
        return targets, q
    unshifted = Targets(targets.position - correction.shifts(arm, q), targets.rotation)
    return unshifted, correction.joints(arm, q)


def _unreached(calibrated: Calibrated, targets: Targets, row: int) -> str:
    x, y, z = targets.position[row]
    return f'{calibrated.identified.name} does not get to ({x:.4f}, {y:.4f}, {z:.4f}) m'


def _obstacle(calibrated: Calibrated, found: Reached, row: int) -> str:
    arm, joint = calibrated.identified, int(found.limit[row])
    if joint < 0:
        return f'{1e3 * found.miss[row]:.3g} mm are left, it is stretched out or singular there'
    lower, upper = arm.limits[joint]
    moved = arm.joints[joint]
    return f'{moved.name} would pass its limits [{lower:.4f}, {upper:.4f}] {moved.unit}'
