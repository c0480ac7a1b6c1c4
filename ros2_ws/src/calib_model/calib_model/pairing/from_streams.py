# SPDX-License-Identifier: Apache-2.0
"""Poses from raw streams: of an arm that stops for each, or of one that is led around spheres."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.pairing.stop_and_go import (
    JointSample,
    Outcome,
    Pairing,
    Reading,
    Refusal,
    SteadyPose,
    SteadySettings,
)
from calib_model.pairing.streams import RawStreams
from calib_model.stamps import SECOND

APART = 0.1  # s between readings that belong to one contact
SEATED = 0.05  # s at both ends of a contact in which the sphere may not sit yet
SPACING = 0.1  # rad, of all joints together, between poses taken in motion
FINE = 0.05  # s between joint states up to which the way between them is known
PER_CONTACT = 1000  # poses of one contact at most: more of the same say nothing new
PER_STOP = 1.0  # rad in contact for every stop: more of a way is worth more than its stops
CANDIDATES = 0.01  # s between readings that are looked at
STANDING = 0.05  # s across which an arm in contact is seen to stand: noise of encoders is no speed


@dataclass(frozen=True)
class Paired:
    """Poses in time order, how they were found (`standing` or in motion), and stops refused."""

    poses: tuple[SteadyPose, ...]
    standing: bool
    stops: int
    way: float
    contacts: int
    refused: Counter[str] = field(default_factory=Counter)
    held: bool = False  # each the mean of a contact, not of the moment after the arm stopped

    def lines(self) -> list[str]:
        """What was done, in words."""
        how = 'is led around the spheres in contact'
        if self.standing:
            how = 'stands in contact for each' if self.held else 'stops for each'
        lines = [f'{len(self.poses)} poses of an arm that {how}']
        if self.contacts:
            lines[0] += f' ({self.stops} stops, {self.way:.0f} rad of way in contact)'
        if self.standing and self.refused and not self.held:
            lines.append(f'{sum(self.refused.values())} stops gave no pose: {self.reasons}')
        return lines

    @property
    def reasons(self) -> str:
        """Why stops gave no pose, the most frequent first."""
        return ', '.join(f'{count} {reason}' for reason, count in self.refused.most_common())


def pair_streams(
    streams: RawStreams, settings: SteadySettings, standing: bool | None = None
) -> Paired:
    """The poses of both streams; `standing` None lets the data say how they were taken.

    A hand-guided arm goes a long way in contact for every stop that it makes there; one that
    stops for each pose touches the sphere shortly before and after. Where the moment after a stop
    is too early for most (slow readings, a probe that comes into contact by itself), the readings
    of a contact in which the arm stands are one pose.
    """
    outcomes = list(standing_outcomes(streams, settings))
    still = tuple(each for each in outcomes if isinstance(each, SteadyPose))
    refused = Counter(each.reason.value for each in outcomes if isinstance(each, Refusal))
    contacts = list(_contacts(streams))
    way = sum(float(contact.way[-1]) for contact in contacts)
    held: tuple[SteadyPose, ...] = ()
    if standing is not False:
        means = (_held(streams, contact, settings) for contact in contacts)
        held = tuple(pose for pose in means if pose is not None)
    if 2 * len(still) >= len(held):
        held = ()
    if standing is None:
        standing = way <= PER_STOP * max(len(still), len(held))
    poses = held or still
    if not standing:
        poses = tuple(pose for contact in contacts for pose in _led(streams, contact))
    return Paired(poses, standing, len(still), way, len(contacts), refused, bool(held))


def standing_outcomes(streams: RawStreams, settings: SteadySettings) -> Iterator[Outcome]:
    """What `Pairing` makes of the streams, stop by stop.

    Only the samples of a stop and the first after it decide on it, so `Pairing` is shown these.
    """
    t, q = streams.joint_stamp, streams.joints
    gap = np.diff(t)
    speed = np.abs(np.diff(q, axis=0)).max(axis=1)
    still = (gap <= round(settings.max_gap * SECOND)) & (speed <= settings.max_speed * gap / SECOND)
    window = round((settings.settle + settings.dwell) * SECOND)
    for first, last in _runs(still):
        if t[last] - t[first] < round(settings.settle * SECOND):
            continue
        end = min(int(np.searchsorted(t, t[first] + window)), last)
        yield from _stop(streams, settings, first, end, min(last + 1, len(t) - 1), window)


def _stop(
    streams: RawStreams, settings: SteadySettings, first: int, end: int, after: int, window: int
) -> list[Outcome]:
    pairing = Pairing(settings)
    found: list[Outcome] = []
    for row in [*range(first, end + 1), *([after] if after > end else [])]:
        sample = JointSample(int(streams.joint_stamp[row]), streams.joints[row])
        found += pairing.add_joints(sample)
    begin = int(streams.joint_stamp[first])
    rows = np.searchsorted(streams.reading_stamp, [begin, begin + window])
    for row in range(rows[0], min(rows[1] + 2, len(streams.reading_stamp))):
        found += pairing.add_reading(_reading(streams, row))
    return found + pairing.finish()


def _reading(streams: RawStreams, row: int) -> Reading:
    first, second, third = (int(status) for status in streams.status[row])
    return Reading(
        int(streams.reading_stamp[row]), streams.displacement[row], (first, second, third)
    )


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last sample of each run of steps (M - 1,) that are set."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))


@dataclass(frozen=True)
class _Contact:
    """Readings of one contact that are looked at: their `rows` (K,), the joints (K, n) at them and
    how far these have come since the first, `way` (K,), rad."""

    rows: NDArray[np.int64]
    joints: Array
    way: Array


def _contacts(streams: RawStreams) -> Iterator[_Contact]:
    t = streams.reading_stamp
    number = np.isfinite(streams.displacement).all(axis=1)
    good = np.flatnonzero((streams.status == 0).all(axis=1) & number)
    if not len(good):
        return
    # a reading that is not good ends a contact as well as a gap does
    apart = (np.diff(t[good]) > APART * SECOND) | (np.diff(good) > 1)
    for part in np.split(good, np.flatnonzero(apart) + 1):
        inside = (t[part] >= t[part[0]] + SEATED * SECOND) & (
            t[part] <= t[part[-1]] - SEATED * SECOND
        )
        rows = _thinned(t, part[inside])
        known, joints = _joints_at(streams, t[rows])
        if known.sum() >= 2:
            q = joints[known]
            steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
            yield _Contact(rows[known], q, np.concatenate([[0.0], np.cumsum(steps)]))


def _thinned(t: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """One reading for each hundredth of a second: noise of joint states is no way."""
    if not len(rows):
        return rows
    slot = (t[rows] - t[rows[0]]) // round(CANDIDATES * SECOND)
    return rows[np.unique(slot, return_index=True)[1]]


def _held(streams: RawStreams, contact: _Contact, settings: SteadySettings) -> SteadyPose | None:
    """The mean of the longest stretch of a contact in which the arm stands and the styli rest."""
    if contact.way[-1] > PER_STOP:
        return None
    t = streams.reading_stamp[contact.rows]
    count = len(t)
    later = np.clip(np.searchsorted(t, t + round(STANDING * SECOND)), None, count - 1)
    turned = np.abs(contact.joints[later] - contact.joints).max(axis=1)
    still = turned <= settings.max_speed * np.maximum(t[later] - t, 1) / SECOND
    runs = _runs(still[:-1])
    if not runs:
        return None
    first, last = max(runs, key=lambda run: int(t[run[1]] - t[run[0]]))
    part = slice(first, last + 1)
    rows = contact.rows[part]
    readings = streams.displacement[rows]
    if len(rows) < settings.min_readings:
        return None
    # of many readings the two farthest apart say more of their noise than of their drift
    if np.ptp(np.quantile(readings, [0.1, 0.9], axis=0), axis=0).max() > settings.max_spread:
        return None
    middle = int(t[first] + np.mean(t[part] - t[first]))
    joints = contact.joints[part].mean(axis=0)
    return SteadyPose(middle, frozen(joints), frozen(readings.mean(axis=0)), len(rows))


def _led(streams: RawStreams, contact: _Contact) -> list[SteadyPose]:
    spacing = max(SPACING, float(contact.way[-1]) / PER_CONTACT)
    which = np.unique(contact.way // spacing, return_index=True)[1]
    return [
        SteadyPose(
            int(streams.reading_stamp[contact.rows[i]]),
            frozen(contact.joints[i]),
            frozen(streams.displacement[contact.rows[i]]),
            1,
        )
        for i in which
    ]


def _joints_at(streams: RawStreams, stamps: NDArray[np.int64]) -> tuple[NDArray[np.bool_], Array]:
    """The joints (K, n) at stamps (K,), and at which of them they are known.

    Cubic through the two joint states on either side (Lagrange): an arm in motion accelerates, and
    half-way between 250 Hz states a straight line is off by up to a hundredth of a mrad.
    """
    t, count = streams.joint_stamp, len(streams.joint_stamp)
    if count < 4 or not len(stamps):
        return np.zeros(len(stamps), dtype=np.bool_), np.zeros((len(stamps), 0))
    right = np.searchsorted(t, stamps)
    first = np.clip(right - 2, 0, count - 4)
    knots = (t[first[:, None] + np.arange(4)] - stamps[:, None]) / SECOND  # (K, 4), s from here
    inside = (stamps >= t[first + 1]) & (stamps <= t[first + 2])
    known = inside & (np.diff(knots, axis=1).max(axis=1) <= FINE)
    joints = np.zeros((len(stamps), streams.joints.shape[1]))
    near = knots[known]
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod([near[:, j] / (near[:, j] - near[:, i]) for j in others], axis=0)
        joints[known] += weight[:, None] * streams.joints[first[known] + i]
    return known, joints
