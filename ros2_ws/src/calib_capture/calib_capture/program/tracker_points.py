# SPDX-License-Identifier: Apache-2.0
"""Postures for a target that a tracker sees: which tell most of the arm, and how sure it will be.

As in `pose_selection`, but that a posture says where the target is in the frame of a tracker: the
target's place on the flange and the tracker's are unknown beside the parameters.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from calib_capture.motion import BodySettings, CollisionCheck, bodies_of
from calib_capture.program.candidates import LIMITS
from calib_capture.program.listing import expected_lines
from calib_capture.program.pose_selection import POSTURES, Indices, exchanged
from calib_capture.program.program import ProgramError
from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, Gauge, PassiveProbe
from calib_model.kinematics import (
    DEFAULT_SIGMA,
    forward_kinematics,
    identifiable_table,
    probing_jacobian,
    turning_jacobian,
)
from calib_model.transforms import RigidTransform, skew

#: a target somewhere: which parameters points tell is asked of a place that is no special one (m)
ANYWHERE = np.array([0.13, 0.07, 0.19])
#: of the places, which nobody knows beforehand: m, rad
UNKNOWN = 10.0
#: a reflector's ball, m, where it meets the arm
BALL = 0.0381
#: postures in vain for every one that is wanted, after which there are none
HOPELESS = 1000


@dataclass(frozen=True)
class TrackerSettings:
    """`noise`: standard deviation (m) of a coordinate, tracker and arm together; `turn_noise` (rad)
    of an orientation about each axis, 0 where none is measured; `target` (3,), m, on the flange.
    `poses` are taken out of `pool` times as many, `limit_margin` (rad, m) off the joint limits."""

    noise: float
    turn_noise: float = 0.0
    target: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.1]))
    poses: int = 60
    pool: int = 3
    limit_margin: float = np.radians(1.0)
    bodies: BodySettings = BodySettings()
    seed: int = 1


@dataclass(frozen=True)
class TrackerProgram:
    """Postures (N, n) of an arm for a target, how many others were refused for which reason, and
    the standard uncertainty (m) of a position to be expected by them."""

    arm: str
    settings: TrackerSettings
    joints: Array
    refused: dict[str, int]
    expected: float


def tracker_program(arm: Arm, settings: TrackerSettings) -> TrackerProgram:
    """The most telling postures, free of collisions; what is between them and what the tracker
    sees of them is not looked at.

    Raises:
        BodyError: the sizes of the bodies do not fit the arm.
        ProgramError: hardly any posture is free.
    """
    found, refused = _free_postures(arm, settings)
    information = TargetInformation(arm, settings)
    rows = information.rows(found)
    chosen: Indices = np.arange(settings.poses)
    if len(found) > settings.poses:
        begun = np.asarray(np.linalg.inv(information.of(rows[chosen])), dtype=np.float64)
        chosen = exchanged(begun, rows, chosen)
    expected = information.position_uncertainty(information.of(rows[chosen]))
    return TrackerProgram(arm.name, settings, frozen(found[chosen]), refused, expected)


def _free_postures(arm: Arm, settings: TrackerSettings) -> tuple[Array, dict[str, int]]:
    generator = np.random.default_rng(settings.seed)
    target = PassiveProbe('target', RigidTransform(settings.target))
    ball = Gauge('target', BALL, ((1, (0.0, 0.0, 0.0)),))
    bodies = bodies_of(arm, target, ball, settings.bodies)
    named = (replace(b, kind='target') if b.kind == 'probe' else b for b in bodies.moving)
    check = CollisionCheck(arm, replace(bodies, moving=tuple(named), gauge=()))
    wanted = settings.poses * settings.pool
    lower, upper = arm.ranges.T
    found: list[Array] = []
    refused: Counter[str] = Counter()
    while len(found) < wanted:
        if sum(refused.values()) > HOPELESS + HOPELESS * len(found):
            reasons = ', '.join(f'{reason} {n}' for reason, n in refused.most_common())
            raise ProgramError(f'{arm.name}: hardly any posture is free: {reasons}')
        q = generator.uniform(lower, upper)
        inside = bool(arm.within_limits(q[None], settings.limit_margin)[0])
        reason = check.contact(q) if inside else LIMITS
        if reason:
            refused[reason] += 1
        else:
            found.append(q)
    return np.array(found), dict(refused.most_common())


class TargetInformation:
    """What points of one target from one station tell of F parameters and of these places.

    Columns: the parameters, in standard deviations of what is known of them beforehand, then the
    target's place on the flange and the base's in the tracker's frame, rotations behind
    translations; a target's rotation only where orientations are measured.
    """

    def __init__(self, arm: Arm, settings: TrackerSettings) -> None:
        self._arm, self._settings = arm, settings
        table = identifiable_table(arm, PassiveProbe('target', RigidTransform(ANYWHERE)))
        self.table = table.frozen_at(table.matching('probe_*'), 'the target')
        self._sigma = np.array([DEFAULT_SIGMA[parameter.kind] for parameter in self.table.free])
        self._places = 12 if settings.turn_noise else 9

    @property
    def _free(self) -> int:
        return len(self._sigma)

    def rows(self, joints: Array) -> Array:
        """J (N, 3, D) of postures (N, n), in standard deviations of a point; (N, 6, D) with its
        orientation."""
        settings, count = self._settings, len(joints)
        p_base, by_parameters, by_target = self._points(joints)
        one, none = (np.broadcast_to(m, (count, 3, 3)) for m in (np.eye(3), np.zeros((3, 3))))
        target = [by_target] if not settings.turn_noise else [by_target, none]
        parts = [by_parameters, *target, one, -skew(p_base)]
        position = np.concatenate(parts, axis=2) / settings.noise
        if not settings.turn_noise:
            return position
        turns = np.zeros((count, 3, len(self.table.nominal)))
        turns[:, :, : self.table.mount.start] = turning_jacobian(self._arm, joints)
        turns = turns[:, :, self.table.free_columns] * self._sigma
        flange = forward_kinematics(self._arm, joints)[:, :3, :3]
        rotation = np.concatenate([turns, none, flange, none, one], axis=2) / settings.turn_noise
        return np.concatenate([position, rotation], axis=1)

    def _points(self, joints: Array) -> tuple[Array, Array, Array]:
        """The target (N, 3) in the base frame, and how it goes with parameters and its place."""
        at = PassiveProbe('target', RigidTransform(self._settings.target))
        p_base, jacobian = probing_jacobian(self._arm, at, joints, np.zeros((len(joints), 3)))
        by_parameters = jacobian[:, :, self.table.free_columns] * self._sigma
        return p_base, by_parameters, jacobian[:, :, self.table.mount][:, :, :3]

    def of(self, rows: Array) -> Array:
        """The information (D, D) of some rows, with what is known beforehand."""
        flat = rows.reshape(-1, rows.shape[2])
        known = np.concatenate([np.ones(self._free), np.full(self._places, UNKNOWN**-2)])
        information: Array = np.diag(known) + flat.T @ flat
        return information

    def position_uncertainty(self, information: Array, seed: int = 0) -> float:
        """rms standard uncertainty (m) of the target in the arm's base frame in postures anywhere
        between the joint limits, from the information (D, D)."""
        generator = np.random.default_rng(seed)
        lower, upper = self._arm.ranges.T
        joints = generator.uniform(lower, upper, (POSTURES, self._arm.n))
        _, by_parameters, by_target = self._points(joints)
        moved = np.concatenate([by_parameters, by_target], axis=2)
        size = moved.shape[2]
        covariance = np.linalg.inv(information)[:size, :size]
        variance = np.einsum('nkf,fg,nkg->n', moved, covariance, moved, optimize=True)
        return float(np.sqrt(variance.mean()))


def tracker_text(program: TrackerProgram) -> list[str]:
    """Lines: how many postures, what was refused and why, and what is to be expected of them."""
    x, y, z = program.settings.target * 1e3
    measured = 'position and orientation' if program.settings.turn_noise else 'position'
    lines = [
        f'{len(program.joints)} postures of {program.arm}: the {measured} of a target at '
        f'{x:g}, {y:g}, {z:g} mm on the flange',
        *(f'refused, {reason}: {count}' for reason, count in program.refused.items()),
        'not looked at: what the tracker sees, and the ways between postures',
    ]
    return [*lines, *expected_lines(program.expected)]


def postures_csv(program: TrackerProgram) -> str:
    """The postures as a table, rad and m, for `import_points` once the tracker's columns are
    added."""
    header = ','.join(f'q{i}' for i in range(1, program.joints.shape[1] + 1))
    rows = (','.join(f'{value:.9f}' for value in q) for q in program.joints.tolist())
    return '\n'.join([header, *rows]) + '\n'
