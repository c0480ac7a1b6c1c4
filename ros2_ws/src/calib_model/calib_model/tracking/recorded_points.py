# SPDX-License-Identifier: Apache-2.0
"""Points in a bag: with their joints, or as a tracker sent them, paired with /joint_states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.bags import listed_topics, read_point_messages
from calib_model.errors import BagError
from calib_model.instruments import Arm
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.pairing import RawStreams, read_raw
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS, RawTopics
from calib_model.tracking.standing import MISSING, StandingSettings, posture_at

NO_STAMPS = 'have no stamps in their headers: --stamps record takes when they were recorded'


@dataclass(frozen=True)
class TrackedBag:
    """The points of a bag as one measurement, and `lines` on what was made of them."""

    measured: PointMeasurement
    lines: tuple[str, ...] = ()


def read_tracked(
    path: str | Path,
    arm: Arm | None = None,
    topics: RawTopics | None = None,
    stamps: str = 'auto',
    standing: StandingSettings | None = None,
) -> TrackedBag:
    """The points in a bag; an arm given here takes the place of the bag's own. Where they have no
    joints, each gets the posture in which the arm stood by the joint states on `topics`, and is
    left out where it did not stand.

    Raises:
        BagError: no bag, a topic missing, a message that cannot be read, or no point of an arm
            that stood.
        DescriptionError: the arm's description cannot be used.
        DataError: a point does not fit the arm.
    """
    found = read_point_messages(path)
    if arm is None and not found.described.has_arm:
        raise BagError(f'{path}: the bag has no {ARM_DESCRIPTION.name}: give --arm arm.yaml')
    arm = arm or found.described.arm()
    points = found.points
    if points.joints.shape[1]:
        return TrackedBag(PointMeasurement(arm, points, str(path)).checked())
    topics = topics or RawTopics()
    there = listed_topics(str(path))
    if there and topics.joint_states not in there:
        raise BagError(
            f'{path}: the points on {CAPTURE_POINTS.name} have no joints, and there is no '
            f'{topics.joint_states} to take them from: record both, or make the bag of a table '
            'that has joints (import_points)'
        )
    if stamps == 'record':
        points = replace(points, stamp=found.recorded)
    elif not points.stamp.any():
        raise BagError(f'{path}: the points on {CAPTURE_POINTS.name} {NO_STAMPS}')
    bag = read_raw(path, topics, readings=False, stamps=stamps)
    parts = bag.streams(topics.joints or arm.joint_names)
    asked = standing or StandingSettings()
    postures = [_posture(int(at), parts, asked) for at in points.stamp]
    reasons = Counter(each for each in postures if isinstance(each, str))
    words = ', '.join(f'{reason} {count}' for reason, count in reasons.most_common())
    stood = [row for row, each in enumerate(postures) if not isinstance(each, str)]
    if not stood:
        raise BagError(f'{path}: none of {len(points)} points is of an arm that stood: {words}')
    line = f'{path}: {len(stood)} of {len(points)} points paired with {topics.joint_states}'
    lines = (*bag.lines, f'{line}; left out: {words}' if reasons else line)
    measured = PointMeasurement(arm, _paired(points, postures, stood), str(path))
    return TrackedBag(measured.checked(), lines)


def _posture(at: int, parts: Sequence[RawStreams], asked: StandingSettings) -> Array | str:
    """By the part of the joint states that tells it; why it is not known where none does."""
    why = MISSING
    for part in parts:
        found = posture_at(at, part.joint_stamp, part.joints, asked)
        if not isinstance(found, str):
            return found
        why = found if found != MISSING else why
    return why


def _paired(points: PointSet, postures: Sequence[Array | str], stood: list[int]) -> PointSet:
    kept = points.take(np.array(stood))
    return replace(kept, joints=np.array([postures[row] for row in stood]))
