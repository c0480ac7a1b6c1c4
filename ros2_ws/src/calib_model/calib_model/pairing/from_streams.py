# SPDX-License-Identifier: Apache-2.0
"""Poses from whole streams: of an arm that stops for each, or of a hand-guided one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen, largest_steps
from calib_model.pairing.interpolation import interpolated, states_around
from calib_model.pairing.paired_readings import WIDE, HandGuidedSettings, paired_parts
from calib_model.pairing.readings import JointSample, Reading, Reason, reasons_in_words
from calib_model.pairing.spaced_poses import SpacedPoses
from calib_model.pairing.stop_and_go import (
    Outcome,
    Pairing,
    Refusal,
    SteadyPose,
    SteadySettings,
    still_as,
)
from calib_model.pairing.stops import SCATTER, StopFinder, UsualNoise
from calib_model.pairing.streams import STEP_BACK, RawStreams, RecordedStreams, unbroken
from calib_model.stamps import SECOND

APART = 0.1  # s between readings that belong to one contact
SEATED = 0.05  # s at both ends of a contact in which the sphere may not sit yet
FINE = 0.05  # s between joint states up to which the way between them is known
SELDOM = 0.25  # s, where they come no oftener: of an arm that stands
PER_STOP = 1.0  # rad in contact for every stop: more of a way is worth more than its stops
CANDIDATES = 0.01  # s between readings that are looked at
Touching = Callable[[Array], NDArray[np.bool_]]  # which readings (N, 3), m, a sphere gives
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
        return reasons_in_words(self.refused)


def pair_streams(
    streams: RawStreams,
    settings: SteadySettings,
    standing: bool | None = None,
    guided: HandGuidedSettings | None = None,
    shift: int = 0,
    touching: Touching | None = None,
) -> Paired:
    """The poses of both streams; `standing` None lets the data say how they were taken.

    A hand-guided arm goes a long way in contact for every stop that it makes there; one that
    stops for each pose touches the sphere shortly before and after. Where the moment after a stop
    is too early for most (slow readings, a probe that comes into contact by itself), the readings
    of a contact in which the arm stands are one pose.

    A hand-guided arm is paired with `guided` (None: as by default, but across the gaps that slower
    joint states have), its readings `shift` (ns) later, those alone that are `touching`
    a sphere.
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
        poses = _hand_guided(streams, guided or _usual(streams), shift, touching)
    return Paired(poses, standing, len(still), way, len(contacts), refused, bool(held))


def recorded_outcomes(
    recorded: RecordedStreams, settings: SteadySettings
) -> tuple[list[Outcome], int]:
    """What `Pairing` makes of streams as they were received, and how many of their messages came
    too late; like it, this begins anew where the joints' stamps fall back."""
    outcomes: list[Outcome] = []
    late, usual = 0, UsualNoise()
    arm = np.zeros(len(recorded.joint_stamp), dtype=np.int64)
    step_back = max(STEP_BACK, round(settings.lateness * SECOND))
    begins = [stretch.start for stretch in unbroken(recorded.joint_stamp, arm, step_back)]
    numbers = [0, *recorded.joint_number[begins[1:]].tolist(), recorded.end]
    for begin, end in zip(numbers, numbers[1:], strict=False):
        readings = _Readings(recorded.received(begin, end), settings.lateness, step_back)
        late += readings.late
        outcomes += standing_outcomes(readings.streams, settings, readings, usual)
    return outcomes, late


class _Readings:
    """The readings of a stretch of joint states, in parts: each begins where their stamps fall back
    by more than `step_back` (ns), and what was left of the one before is forgotten."""

    def __init__(self, received: RecordedStreams, lateness: float, step_back: int) -> None:
        recorded = list(received.by_readings(step_back))
        self._until = [int(part.reading_number[0]) for part in recorded[1:]]
        self._parts = [part.ordered(lateness, broken_off=True) for part in recorded[:-1]]
        self._parts.append(recorded[-1].ordered(lateness))
        self.streams = self._parts[-1]
        self.late = self.streams.late_joints + sum(part.late_readings for part in self._parts)
        self._newest = np.maximum.accumulate(received.joint_stamp) - round(lateness * SECOND)
        self._number = received.joint_number

    def deciding(self, answered: int, end: int) -> RawStreams:
        """Those that decide on a stop with the joint state `answered` (ns) after its window, which
        ends at `end` (ns): of the first part that reaches so far and was there that long."""
        row = int(np.searchsorted(self._newest, answered))
        if row < len(self._number):
            for until, part in zip(self._until, self._parts, strict=False):
                stamp = part.reading_stamp
                if until > self._number[row] and len(stamp) and stamp[-1] >= end:
                    return part
        return self._parts[-1]


def standing_outcomes(
    streams: RawStreams,
    settings: SteadySettings,
    readings: _Readings | None = None,
    usual: UsualNoise | None = None,
) -> Iterator[Outcome]:
    """What `Pairing` makes of the streams, stop by stop; of `readings` in parts, if there are any,
    and after what earlier ones told of their `usual` noise.

    Only the samples of a stop and the first after it decide on it, so `Pairing` is shown these.
    """
    t, q = streams.joint_stamp, streams.joints
    if len(t) < 2:
        return
    usual = UsualNoise() if usual is None else usual
    gap, step = np.diff(t), largest_steps(q)
    rule = still_as(settings)
    still = (gap <= rule.gap) & (step <= rule.max_speed * gap / SECOND + SCATTER)
    for first, last in _runs(still):
        if t[last] - t[first] < rule.settle:
            continue
        finder = StopFinder(rule)
        for row in range(first, min(last + 2, len(t))):
            for stop in finder.take(JointSample(int(t[row]), q[row])):
                if not stop.answered:
                    yield Refusal(stop.start, stop.samples[0].joints, Reason.ARM_UNSTEADY)
                    continue
                until = stop.start + rule.window
                deciding = streams
                if readings is not None:
                    deciding = readings.deciding(stop.samples[-1].stamp, until)
                yield from _stop(stop.samples, deciding, settings, until, usual)


def _stop(
    samples: Sequence[JointSample],
    streams: RawStreams,
    settings: SteadySettings,
    end: int,
    usual: UsualNoise,
) -> list[Outcome]:
    pairing = Pairing(settings, usual)
    found = [outcome for sample in samples for outcome in pairing.add_joints(sample)]
    rows = np.searchsorted(streams.reading_stamp, [samples[0].stamp, end])
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
    usual = (
        float(np.median(np.diff(streams.joint_stamp))) / SECOND if len(streams.joints) > 1 else 0.0
    )
    fine = max(FINE, min(SELDOM, WIDE * usual))
    # a reading that is not good ends a contact as well as a gap does
    apart = (np.diff(t[good]) > APART * SECOND) | (np.diff(good) > 1)
    for part in np.split(good, np.flatnonzero(apart) + 1):
        inside = (t[part] >= t[part[0]] + SEATED * SECOND) & (
            t[part] <= t[part[-1]] - SEATED * SECOND
        )
        rows = _thinned(t, part[inside])
        some = states_around(streams.joint_stamp, int(t[part[0]]), int(t[part[-1]]))
        there = interpolated(streams.joint_stamp[some], streams.joints[some], t[rows], fine)
        if there.known.sum() >= 2:
            q = there.joints[there.known]
            steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
            yield _Contact(rows[there.known], q, np.concatenate([[0.0], np.cumsum(steps)]))


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


def _usual(streams: RawStreams) -> HandGuidedSettings:
    """Settings for streams that nobody said anything of."""
    default = HandGuidedSettings()
    if len(streams.joint_stamp) < 2:
        return default
    usual = float(np.median(np.diff(streams.joint_stamp))) / SECOND
    return replace(default, max_gap=min(FINE, max(default.max_gap, WIDE * usual)))


def _hand_guided(
    streams: RawStreams,
    settings: HandGuidedSettings,
    shift: int,
    touching: Touching | None,
) -> tuple[SteadyPose, ...]:
    """The poses that live pairing takes, on whatever sphere."""
    spaced, poses = SpacedPoses(settings), []
    for found in paired_parts(streams, settings.max_gap, shift):
        rows = np.flatnonzero(found.paired)
        if touching is not None:
            rows = rows[touching(found.displacement[rows])]
        anywhere = np.zeros(len(rows), dtype=np.int64)
        poses += spaced.take(
            found.stamp[rows], anywhere, found.joints[rows], found.displacement[rows]
        )
    return tuple(
        SteadyPose(pose.stamp, frozen(pose.joints), frozen(pose.displacement), 1) for pose in poses
    )
