# SPDX-License-Identifier: Apache-2.0
"""Postures for targets that a tracker sees: which tell most of the arm, and how sure it will be.

As in `pose_selection`, but that a posture says where its targets are in the frame of a tracker:
the targets' places on the flange and the tracker's are unknown beside the parameters. Of several
targets each is measured in every posture, of several stations each sees its share of the postures.
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
    of an orientation about each axis, 0 where none is measured; `targets` (K, 3), m, on the flange.
    `poses` are taken out of `pool` times as many, `limit_margin` (rad, m) off the joint limits, and
    the tracker stands at so many `stations` in turn."""

    noise: float
    turn_noise: float = 0.0
    targets: Array = field(default_factory=lambda: np.array([[0.0, 0.0, 0.1]]))
    poses: int = 60
    pool: int = 3
    limit_margin: float = np.radians(1.0)
    bodies: BodySettings = BodySettings()
    seed: int = 1
    stations: int = 1


@dataclass(frozen=True)
class TrackerProgram:
    """Postures (N, n) of an arm for its targets, how many others were refused for which reason, and
    the standard uncertainty (m) of a position to be expected by them."""

    arm: str
    settings: TrackerSettings
    joints: Array
    refused: dict[str, int]
    expected: float

    @property
    def station(self) -> Indices:
        """From which each is measured (N,), counted from 1."""
        return station_of(len(self.joints), self.settings.stations)


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
    apart = information.from_stations(rows[chosen])
    expected = information.position_uncertainty(information.of(apart))
    return TrackerProgram(arm.name, settings, frozen(found[chosen]), refused, expected)


def _free_postures(arm: Arm, settings: TrackerSettings) -> tuple[Array, dict[str, int]]:
    generator = np.random.default_rng(settings.seed)
    ball = Gauge('target', BALL, ((1, (0.0, 0.0, 0.0)),))
    each = [
        bodies_of(arm, PassiveProbe('target', RigidTransform(at)), ball, settings.bodies)
        for at in settings.targets
    ]
    balls = [replace(b, kind='target') for one in each for b in one.moving if b.kind == 'probe']
    moving = (*(b for b in each[0].moving if b.kind != 'probe'), *balls)
    check = CollisionCheck(arm, replace(each[0], moving=moving, gauge=()))
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
    """What points of targets tell of F parameters and of the places of targets and stations.

    Columns: the parameters, in standard deviations of what is known of them beforehand, then each
    target's place on the flange and the base's in the tracker's frame, rotations behind
    translations; a target's rotation only where orientations are measured.
    """

    def __init__(self, arm: Arm, settings: TrackerSettings) -> None:
        self._arm, self._settings = arm, settings
        table = identifiable_table(arm, PassiveProbe('target', RigidTransform(ANYWHERE)))
        self.table = table.frozen_at(table.matching('probe_*'), 'the target')
        self._sigma = np.array([DEFAULT_SIGMA[parameter.kind] for parameter in self.table.free])
        self._of_target = 6 if settings.turn_noise else 3

    @property
    def _free(self) -> int:
        return len(self._sigma)

    def rows(self, joints: Array) -> Array:
        """J (N, 3 K, D) of postures (N, n) seen from one station, in standard deviations of a
        point; (N, 6 K, D) with orientations."""
        targets = len(self._settings.targets)
        found = []
        for number, at in enumerate(self._settings.targets):
            own = self._rows_of(joints, at)
            wide = np.zeros((*own.shape[:2], self._free + self._of_target * targets + 6))
            first = self._free + self._of_target * number
            wide[:, :, : self._free] = own[:, :, : self._free]
            wide[:, :, first : first + self._of_target] = own[:, :, self._free : -6]
            wide[:, :, -6:] = own[:, :, -6:]
            found.append(wide)
        return np.concatenate(found, axis=1)

    def from_stations(self, rows: Array) -> Array:
        """The rows of N postures with columns for the base in the frame of every station, in which
        each is seen from its own."""
        stations = self._settings.stations
        own = station_of(len(rows), stations) - 1
        by_base = np.zeros((*rows.shape[:2], 6 * stations))
        for station in range(stations):
            seen = own == station
            by_base[seen, :, 6 * station : 6 * station + 6] = rows[seen, :, -6:]
        return np.concatenate([rows[:, :, :-6], by_base], axis=2)

    def _rows_of(self, joints: Array, at: Array) -> Array:
        """J of one target `at` (3,) alone."""
        settings, count = self._settings, len(joints)
        p_base, by_parameters, by_target = self._points(joints, at)
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

    def _points(self, joints: Array, at: Array) -> tuple[Array, Array, Array]:
        """A target (N, 3) in the base frame, and how it goes with parameters and its place."""
        seat = PassiveProbe('target', RigidTransform(at))
        p_base, jacobian = probing_jacobian(self._arm, seat, joints, np.zeros((len(joints), 3)))
        by_parameters = jacobian[:, :, self.table.free_columns] * self._sigma
        return p_base, by_parameters, jacobian[:, :, self.table.mount][:, :, :3]

    def of(self, rows: Array) -> Array:
        """The information (D, D) of some rows, with what is known beforehand."""
        flat = rows.reshape(-1, rows.shape[2])
        places = rows.shape[2] - self._free
        known = np.concatenate([np.ones(self._free), np.full(places, UNKNOWN**-2)])
        information: Array = np.diag(known) + flat.T @ flat
        return information

    def position_uncertainty(self, information: Array, seed: int = 0) -> float:
        """rms standard uncertainty (m) of the first target in the arm's base frame in postures
        anywhere between the joint limits, from the information (D, D)."""
        generator = np.random.default_rng(seed)
        lower, upper = self._arm.ranges.T
        joints = generator.uniform(lower, upper, (POSTURES, self._arm.n))
        _, by_parameters, by_target = self._points(joints, self._settings.targets[0])
        moved = np.concatenate([by_parameters, by_target], axis=2)
        size = moved.shape[2]
        covariance = np.linalg.inv(information)[:size, :size]
        variance = np.einsum('nkf,fg,nkg->n', moved, covariance, moved, optimize=True)
        return float(np.sqrt(variance.mean()))


def tracker_text(program: TrackerProgram) -> list[str]:
    """Lines: how many postures, what was refused and why, and what is to be expected of them."""
    settings, count = program.settings, len(program.settings.targets)
    measured = 'position and orientation' if settings.turn_noise else 'position'
    at = '; '.join(', '.join(f'{value:g}' for value in one) for one in settings.targets * 1e3)
    what = 'a target' if count == 1 else f'{count} targets'
    seen = '' if settings.stations == 1 else f', from {settings.stations} stations in turn'
    lines = [
        f'{len(program.joints)} postures of {program.arm}: the {measured} of {what} at '
        f'{at} mm on the flange{seen}',
        *(f'refused, {reason}: {count}' for reason, count in program.refused.items()),
        'not looked at: what the tracker sees, and the ways between postures',
    ]
    return [*lines, *expected_lines(program.expected)]


def postures_csv(program: TrackerProgram) -> str:
    """The postures as a table, rad and m, for `import_points` once the tracker's columns are
    added: a row for each target in each of them, with `target` and `station` where there are
    several."""
    settings = program.settings
    several = len(settings.targets) > 1 or settings.stations > 1
    header = ','.join(f'q{i}' for i in range(1, program.joints.shape[1] + 1))
    rows = [header + (',target,station' if several else '')]
    for q, station in zip(program.joints.tolist(), program.station.tolist(), strict=True):
        posture = ','.join(f'{value:.9f}' for value in q)
        for target in range(1, len(settings.targets) + 1):
            rows.append(posture + (f',{target},{station}' if several else ''))
    return '\n'.join(rows) + '\n'


def station_of(count: int, stations: int) -> Indices:
    """From which station, from 1, each of `count` postures is measured: as many from each."""
    return np.asarray(np.arange(count) * stations // count + 1, dtype=np.int64)
