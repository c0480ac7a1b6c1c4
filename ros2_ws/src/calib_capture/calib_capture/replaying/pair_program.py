# SPDX-License-Identifier: Apache-2.0
"""Pairing done again from the raw topics of a bag."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from calib_model.arrays import Array
from calib_model.bags import BagDescriptions, BagMessage, cdr, read_messages
from calib_model.errors import BagError
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.labelling import SphereFinder
from calib_model.measurement import Measurement, ProbingSet
from calib_model.pairing import (
    ClockOffset,
    JointSample,
    Outcome,
    Pairing,
    Reading,
    Refusal,
    SteadyPose,
    SteadySettings,
    estimate_clock_offset,
    usable,
)
from calib_model.progress import Pace, Progress, paced
from calib_model.stamps import SECOND
from calib_model.topics import CAPTURE_POSES, DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS
from calib_model.transforms import RigidTransform

T = TypeVar('T')
Label = tuple[int, int]  # location and sphere
SAME_POSTURE = 2e-3  # rad: what a run takes for the planned pose
SAME_STOP = 0.5  # s beyond the window: other settings find another instant of the same stop


@dataclass
class Repeated:
    """What came of pairing anew.

    `recorded` poses were in the bag, of which `missed` have no pose now. `unknown` counts stops
    that were paired and belong to no sphere, `refused` stops by their reason.
    """

    measured: Measurement
    recorded: int
    missed: int
    unknown: int
    refused: Counter[str] = field(default_factory=Counter)
    too_late: int = 0
    clock: ClockOffset | None = None

    def lines(self) -> list[str]:
        """The counts in words."""
        lines = []
        if self.recorded:
            lines.append(f'{self.recorded} poses were recorded, {self.missed} have no pose now')
        if self.unknown:
            lines.append(f'{self.unknown} stops belong to no sphere')
        if self.refused:
            why = ', '.join(f'{count} {reason}' for reason, count in self.refused.most_common())
            lines.append(f'{sum(self.refused.values())} stops refused: {why}')
        if self.clock is not None:
            lines.append(self.clock.line())
        if self.too_late:
            lines.append(f'{self.too_late} messages came too late for their place')
        return lines


@dataclass(frozen=True)
class Raw:
    """What a bag holds, decoded: descriptions, streams in recorded order, recorded poses."""

    arm: Arm
    probe: Probe
    gauge: Gauge
    stream: list[JointSample | Reading]
    poses: list[Any]


def repeat_pairing(
    path: Path,
    settings: SteadySettings,
    placements: Mapping[int, RigidTransform] | None = None,
    correct_clock: bool = False,
    progress: Progress | None = None,
) -> Repeated:
    """The poses of a bag paired anew with `settings`, in time order.

    The recorded poses say which sphere each belongs to; with `placements` (`T_base_gauge`) the
    nominal centres of the spheres do. With `correct_clock` readings are paired at their stamps in
    the joints' clock, as far as the streams tell the offset; poses keep the readings' stamps.
    `progress` hears how far it is.

    Raises:
        BagError: no bag, a topic missing or not readable, or no pose comes of it.
        DescriptionError: a description in the bag cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    raw = read_raw(path, progress)
    if not raw.poses and placements is None:
        raise BagError(
            f'{path}: no {CAPTURE_POSES.name} to say which spheres were probed, '
            'say where the gauge stood (--placements)'
        )
    clock = clock_of(raw)
    shift = round(clock.seconds * SECOND) if clock is not None and correct_clock else 0
    outcomes, too_late = _paired([_shifted(each, shift) for each in raw.stream], settings, progress)
    steady = sorted(
        (
            replace(each, stamp=each.stamp - shift)
            for each in outcomes
            if isinstance(each, SteadyPose)
        ),
        key=lambda each: each.stamp,
    )
    if placements is None:
        labels = _Recorded(raw.poses, settings).labels(steady)
    else:
        labels = _nominal(raw, placements, steady)
    known = [(each, label) for each, label in zip(steady, labels, strict=True) if label]
    if not known:
        hint = 'led by hand? say --mode continuous'
        raise BagError(f'{path}: no pose comes of its {len(outcomes)} stops ({hint})')
    measured = Measurement(raw.arm, raw.probe, raw.gauge, _probing_set(known), str(path)).checked()
    refused = Counter(each.reason.value for each in outcomes if isinstance(each, Refusal))
    missed = 0 if placements is not None else len(raw.poses) - len(known)
    recorded = len(raw.poses) if placements is None else 0
    return Repeated(measured, recorded, missed, len(steady) - len(known), refused, too_late, clock)


def clock_of(raw: Raw) -> ClockOffset | None:
    """What the streams tell of the offset between their clocks."""
    return estimate_clock_offset(
        raw.arm,
        raw.probe,
        raw.gauge,
        [each for each in raw.stream if isinstance(each, JointSample)],
        [each for each in raw.stream if isinstance(each, Reading)],
    )


def _nominal(
    raw: Raw, placements: Mapping[int, RigidTransform], steady: list[SteadyPose]
) -> list[Label | None]:
    """The sphere of each stop by where the nominal arm sees it; None where none is near."""
    if not steady:
        return []
    finder = SphereFinder(raw.arm, raw.probe, raw.gauge, placements)
    rows = finder.rows(
        np.array([pose.joints for pose in steady]),
        np.array([pose.displacement for pose in steady]),
    )
    return [finder.labels[row] if row >= 0 else None for row in rows]


def _shifted(message: JointSample | Reading, shift: int) -> JointSample | Reading:
    """A reading `shift` ns later; joint samples as they are."""
    if isinstance(message, Reading) and shift:
        return message._replace(stamp=message.stamp + shift)
    return message


def _probing_set(known: list[tuple[SteadyPose, Label]]) -> ProbingSet:
    return ProbingSet(
        np.array([label[0] for _, label in known], dtype=np.int64),
        np.array([label[1] for _, label in known], dtype=np.int64),
        np.array([pose.joints for pose, _ in known]),
        np.array([pose.displacement for pose, _ in known]),
        np.array([pose.stamp for pose, _ in known], dtype=np.int64),
        np.array([pose.readings for pose, _ in known], dtype=np.int64),
    )


def read_raw(path: Path, progress: Progress | None = None) -> Raw:
    """The raw topics of a bag; `progress` hears how far it is.

    Raises:
        BagError: no bag, a topic missing or not readable, or a description that changes within it.
        DescriptionError: a description in the bag cannot be used.
    """
    types = {topic.name: topic.type for topic in (JOINT_STATES, PROBE_DISPLACEMENTS, CAPTURE_POSES)}
    described = BagDescriptions(path)
    contents: dict[str, list[Any]] = {name: [] for name in types}
    order: list[tuple[str, Any]] = []
    pace = Pace(progress, f'reading {path}', 'MB', 1e6)
    wanted = {*types, *(topic.name for topic in DESCRIPTIONS)}
    for message in read_messages(path, wanted, told=pace):
        if message.topic not in types:
            described.take(message)
            continue
        content = _decoded(path, message, types[message.topic])
        contents[message.topic].append(content)
        if message.topic in (JOINT_STATES.name, PROBE_DISPLACEMENTS.name):
            order.append((message.topic, content))

    pace.end()
    for topic in (JOINT_STATES, PROBE_DISPLACEMENTS):
        if not contents[topic.name]:
            raise BagError(f'{path}: no raw messages on {topic.name}, nothing to pair')
    arm = described.arm()
    stream = list(_samples(order, arm))
    return Raw(arm, described.probe(), described.gauge(), stream, contents[CAPTURE_POSES.name])


def _decoded(path: Path, message: BagMessage, expected: str) -> Any:
    if message.type != expected:
        raise BagError(f'{path}: topic {message.topic} has type {message.type}, not {expected}')
    try:
        return cdr.decode(expected, message.data)
    except ValueError as error:
        raise BagError(f'{path}: {message.topic}: {error}') from error


def _samples(order: list[tuple[str, Any]], arm: Arm) -> Iterator[JointSample | Reading]:
    for topic, content in order:
        stamp = cdr.stamp_of(content)
        if topic == JOINT_STATES.name:
            # of a name that is there twice the first counts, as in a capture
            pairs = list(zip(content.name, content.position, strict=False))
            position = dict(reversed(pairs)) if len(pairs) == len(content.name) else {}
            joints = np.array([position.get(name, np.nan) for name in arm.joint_names])
            if usable(joints):
                yield JointSample(stamp, joints)
        else:
            first, second, third = (int(status) for status in content.status)
            yield Reading(stamp, np.array(content.displacement), (first, second, third))


def _paired(
    stream: list[JointSample | Reading],
    settings: SteadySettings,
    progress: Progress | None = None,
) -> tuple[list[Outcome], int]:
    """What comes of the streams as they were received, and how many messages were too late."""
    pairing = Pairing(settings)
    outcomes: list[Outcome] = []
    for message in paced(stream, progress, 'pairing', 'messages', 1024):
        if isinstance(message, JointSample):
            outcomes += pairing.add_joints(message)
        else:
            outcomes += pairing.add_reading(message)
    outcomes += pairing.finish()
    return outcomes, pairing.too_late


class _Recorded:
    """Knows the sphere of a stop from the pose that was recorded of it."""

    def __init__(self, poses: list[Any], settings: SteadySettings) -> None:
        self._poses = sorted(poses, key=cdr.stamp_of)
        self._stamps = [cdr.stamp_of(pose) for pose in self._poses]
        self._reach = round((settings.settle + settings.dwell + SAME_STOP) * SECOND)
        self._used: set[int] = set()

    def labels(self, steady: list[SteadyPose]) -> list[Label | None]:
        """Location and sphere of each; None where no recorded pose is of the same stop."""
        return [self._label(pose) for pose in steady]

    def _label(self, pose: SteadyPose) -> Label | None:
        begin = bisect_left(self._stamps, pose.stamp - self._reach)
        end = bisect_left(self._stamps, pose.stamp + self._reach + 1)
        near = [
            i
            for i in range(begin, end)
            if i not in self._used and self._same_posture(self._poses[i], pose.joints)
        ]
        if not near:
            return None
        best = min(near, key=lambda i: abs(self._stamps[i] - pose.stamp))
        self._used.add(best)
        return int(self._poses[best].location), int(self._poses[best].sphere)

    def _same_posture(self, recorded: Any, joints: Array) -> bool:
        there = np.asarray(recorded.joint_position)
        return there.shape == joints.shape and bool(np.abs(there - joints).max() <= SAME_POSTURE)
