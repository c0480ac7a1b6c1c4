# SPDX-License-Identifier: Apache-2.0
"""Joint commands that really get there: the identified arm's inverse, started from the nominal's.

What no probing shows, d1 and theta_0_1, is as nominal in the identified arm: positions are told
in the base frame that these two fix. Where that frame stands in the room is for the user to say, by
touching points that are known there.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.descriptions import parse_arm, parse_correction, parse_probe, read_description
from calib_model.errors import CalibrationError, DataError
from calib_model.files import file_content
from calib_model.instruments import Arm, NDArrayBool, PassiveProbe, Probe
from calib_model.kinematics import Correction, ParameterTable, tool_motion
from calib_model.transforms import RigidTransform
from calib_solver.compensation.inverse_kinematics import EXACT, Reached, Rows, Targets, reach

ROUNDS = 6  # between encoder readings and joints
TRIES = 15  # postures a nominal answer is looked for from


class CompensationError(CalibrationError):
    """A target that the arm does not reach."""


@dataclass(frozen=True)
class Calibrated:
    """An arm with its tool as its controller has them (nominal) and as they are (identified), and
    what was found beyond the D-H parameters."""

    nominal: Arm
    identified: Arm
    nominal_tool: RigidTransform
    identified_tool: RigidTransform
    correction: Correction | None = None

    def with_tool(self, flange_T_tool: RigidTransform) -> Calibrated:
        """The same arm with another tool, whose place on the flange is known."""
        return replace(self, nominal_tool=flange_T_tool, identified_tool=flange_T_tool)

    def tool_at(self, q: Array) -> Array:
        """Where the identified tool is (N, 3), m, when the encoders read q (N, n), rad."""
        arm = self.identified
        there = self.correction.joints(arm, q) if self.correction else q
        position = tool_motion(arm, there, self.identified_tool).position
        return position + self.correction.shifts(arm, q) if self.correction else position


@dataclass(frozen=True)
class Compensated:
    """`nominal` (N, n) are the joint commands of the nominal arm, `joints` (N, n) those that get
    there, rad; `miss` (N,), m, is how far off the nominal ones are by the identified arm."""

    nominal: Array
    joints: Array
    miss: Array


def read_calibrated(folder: str | Path) -> Calibrated:
    """The calibration that `identify --output` wrote, the probe's tip as the tool.

    Raises:
        CalibrationError: a file is missing or is not what `identify` writes.
    """
    folder = Path(folder)
    arm = read_description(folder / 'arm.yaml', parse_arm)
    probe = read_description(folder / 'probe.yaml', parse_probe)
    path = folder / 'result.json'
    table = ParameterTable.of(arm, probe)
    full = table.nominal.copy()
    try:
        for row in json.loads(file_content(path).decode('utf-8'))['parameters']:
            full[table.column(row['name'])] = float(row['initial'])
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be read: {error.strerror}') from error
    except (ValueError, KeyError, TypeError, RecursionError, DataError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error
    nominal, nominal_probe = table.apply(full, arm, probe)
    correction = None
    if (folder / 'correction.yaml').exists():
        correction = read_description(folder / 'correction.yaml', parse_correction).checked(arm)
    return Calibrated(nominal, arm, tip(nominal_probe), tip(probe), correction)


def tip(probe: Probe) -> RigidTransform:
    """`flange_T_tool` of a probe: its frame, at the seated sphere's centre where it has a seat."""
    mount = probe.flange_T_probe
    if not isinstance(probe, PassiveProbe):
        return mount
    return RigidTransform(mount.apply(probe.center), mount.rotation_vector)


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

    Arms with joints to spare change the least; with `position_only` the tool may turn.

    Raises:
        DataError: the number of joints is not the arm's.
        CompensationError: names the row (by `place`) that the arm does not reach.
    """
    q = calibrated.nominal.check_joints(q)
    wanted = tool_motion(calibrated.nominal, q, calibrated.nominal_tool)
    targets = Targets(wanted.position, None if position_only else wanted.rotation)
    return _from_nominal(calibrated, targets, q, place)


def compensate_targets(
    calibrated: Calibrated,
    targets: Targets,
    start: Array | None = None,
    place: Callable[[int], str] = row_number,
) -> Compensated:
    """The joint commands that really bring the tool to Cartesian targets in the base frame.

    The nominal answers are looked for from `start` (N, n), rad, or the middle of the joints'
    ranges, and then from anywhere; each row by itself.

    Raises:
        DataError: the number of joints is not the arm's.
        CompensationError: names the row (by `place`) that the arm does not reach.
    """
    arm, count = calibrated.nominal, len(targets.position)
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    generator = np.random.default_rng(0)
    tried = np.tile((lower + upper) / 2, (count, 1))
    if start is not None:
        tried = np.array(arm.check_joints(start))
    nominal, joints = np.empty((2, count, arm.n))
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
            return _finished(calibrated, targets, nominal, joints)
        tried[left] = generator.uniform(lower, upper, (len(left), arm.n))
    row = int(left[0])
    raise CompensationError(f'{place(row)}: {_unreached(calibrated, targets, row)}: {why[row]}')


def _nominal_answers(
    calibrated: Calibrated, targets: Targets, start: Array
) -> tuple[NDArrayBool, Array]:
    """Which targets (N,) the nominal arm reaches from there within its limits, and how (K, n)."""
    arm = calibrated.nominal
    found = reach(arm, calibrated.nominal_tool, targets, start, stay=False)
    # by full turns nearest to the middle of each joint's range
    middle = np.clip(arm.limits, -np.pi, np.pi).mean(axis=1)
    turned = found.q - 2 * np.pi * np.round((found.q - middle) / (2 * np.pi))
    turned = np.where(np.isfinite(arm.limits).all(axis=1), turned, found.q)
    answered = (found.miss < EXACT) & arm.within_limits(turned)
    return answered, turned[answered]


def _really_reach(calibrated: Calibrated, targets: Targets, start: Array) -> Reached:
    """The joint commands of the identified arm, what is beyond its D-H parameters included.

    Joint errors and shifts are small and smooth, so going to and fro between what the encoders
    read and where the joints are settles by their slope, a thousandth, each time.
    """
    arm, tool, correction = calibrated.identified, calibrated.identified_tool, calibrated.correction
    if correction is None:
        return reach(arm, tool, targets, start)
    q, there = start, correction.joints(arm, start)
    for _ in range(ROUNDS):
        unshifted = Targets(targets.position - correction.shifts(arm, q), targets.rotation)
        found = reach(arm, tool, unshifted, there)
        q = q + found.q - correction.joints(arm, q)
    beyond = np.maximum(arm.limits[:, 0] - q, q - arm.limits[:, 1])
    worst = np.where(beyond.max(axis=1) > 0, beyond.argmax(axis=1), -1)
    left = np.linalg.norm(calibrated.tool_at(q) - targets.position, axis=1)
    return Reached(q, np.maximum(found.miss, left), np.where(found.limit < 0, worst, found.limit))


def _from_nominal(
    calibrated: Calibrated, targets: Targets, q: Array, place: Callable[[int], str]
) -> Compensated:
    found = _really_reach(calibrated, targets, q)
    for row in map(int, np.flatnonzero(~found.arrived)):
        why = _obstacle(calibrated, found, row)
        raise CompensationError(f'{place(row)}: {_unreached(calibrated, targets, row)}: {why}')
    return _finished(calibrated, targets, q, found.q)


def _finished(calibrated: Calibrated, targets: Targets, q: Array, joints: Array) -> Compensated:
    missed = np.linalg.norm(calibrated.tool_at(q) - targets.position, axis=1)
    return Compensated(frozen(q), frozen(joints), frozen(missed))


def _unreached(calibrated: Calibrated, targets: Targets, row: int) -> str:
    x, y, z = targets.position[row]
    return f'{calibrated.identified.name} does not get to ({x:.4f}, {y:.4f}, {z:.4f}) m'


def _obstacle(calibrated: Calibrated, found: Reached, row: int) -> str:
    arm, joint = calibrated.identified, int(found.limit[row])
    if joint < 0:
        return f'{1e3 * found.miss[row]:.3g} mm are left, it is stretched out or singular there'
    lower, upper = arm.limits[joint]
    return f'{arm.joints[joint].name} would pass its limits [{lower:.4f}, {upper:.4f}] rad'
