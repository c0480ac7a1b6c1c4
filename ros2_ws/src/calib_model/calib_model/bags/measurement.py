# SPDX-License-Identifier: Apache-2.0
"""A whole measurement in a bag: the three descriptions and the probing poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib_model.bags import cdr
from calib_model.bags.descriptions import BagDescriptions
from calib_model.bags.pose_columns import decode_poses
from calib_model.bags.reader import BagMessage, read_messages
from calib_model.errors import BagError
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measurement import Measurement, ProbingSet
from calib_model.topics import CAPTURE_POSES, CAPTURE_UNDONE, DESCRIPTIONS, POSE_TOPICS

POSES = {topic.name for topic in POSE_TOPICS}
LARGEST_POSE = 10_000  # bytes: of a hundred joints and a long frame
LARGEST_SET = 400_000_000  # bytes: over two million poses


def read_measurement(
    path: str | Path,
    arm: Arm | None = None,
    probe: Probe | None = None,
    gauge: Gauge | None = None,
) -> Measurement:
    """The measurement in a bag; a description given here takes the place of the bag's own.

    Raises:
        BagError: no bag, a topic missing, a message that cannot be read, or a description that
            changes within the bag.
        DescriptionError: a description in the bag cannot be used.
        DataError: a pose does not fit the descriptions.
    """
    described, found = read_poses(path)
    measured = Measurement(
        arm or described.arm(),
        probe or described.probe(),
        gauge or described.gauge(),
        found,
        str(path),
    )
    return measured.checked()


def read_poses(path: str | Path) -> tuple[BagDescriptions, ProbingSet]:
    """The poses in a bag as they were recorded, without those that were taken back, and what the
    bag says of the instruments. Location and sphere 0 stand for one
    that nobody has told.

    Raises:
        BagError: no bag, no poses, or a message that cannot be read.
    """
    described, poses = BagDescriptions(path), PoseMessages(path)
    for message in read_messages(path, {topic.name for topic in (*DESCRIPTIONS, *POSE_TOPICS)}):
        (poses if message.topic in POSES else described).take(message)
    found = poses.read()
    if found is None:
        raise BagError(f'{path}: the bag has no messages on {CAPTURE_POSES.name}')
    return described, found


class PoseMessages:
    """Gathers the messages on /capture/poses and /capture/undone of the bag at `path`."""

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._messages: list[bytes] = []
        self._undone: list[bytes] = []
        self._size = 0

    def take(self, message: BagMessage) -> None:
        """Keep one.

        Raises:
            BagError: it is no pose, or more than is taken.
        """
        if message.type != CAPTURE_POSES.type:
            _check_type(self._path, message, CAPTURE_POSES.type)
        taken = message.topic != CAPTURE_UNDONE.name
        size = len(message.data)
        self._size += size
        if size > LARGEST_POSE or self._size > LARGEST_SET:
            raise BagError(
                f'{self._path}: {CAPTURE_POSES.name}, message {len(self._messages) + 1} has '
                f'{size} bytes, {self._size} with those before: more than is taken'
            )
        (self._messages if taken else self._undone).append(message.data)

    def read(self) -> ProbingSet | None:
        """The poses that were not taken back, None without any message.

        Raises:
            BagError: one cannot be read, or they have different numbers of joints.
        """
        if not self._messages:
            return None
        poses = decode_poses(self._messages) or _one_by_one(self._path, self._messages)
        if not self._undone:
            return poses
        undone = decode_poses(self._undone) or _one_by_one(self._path, self._undone)
        return poses.take(~np.isin(poses.stamp, undone.stamp))


def _check_type(path: str | Path, message: BagMessage, expected: str) -> None:
    if message.type != expected:
        raise BagError(f'{path}: topic {message.topic} has type {message.type}, not {expected}')


def _decoded(path: str | Path, kind: str, topic: str, data: bytes, number: int) -> Any:
    try:
        return cdr.decode(kind, data)
    except ValueError as error:
        raise BagError(f'{path}: {topic}, message {number}: {error}') from error


def _one_by_one(path: str | Path, messages: list[bytes]) -> ProbingSet:
    """The poses of messages that differ in layout: frames of other lengths, say."""
    topic = CAPTURE_POSES
    poses = [
        _decoded(path, topic.type, topic.name, data, number)
        for number, data in enumerate(messages, start=1)
    ]
    counts = [len(pose.joint_position) for pose in poses]
    for number, count in enumerate(counts, start=1):
        if count != counts[0]:
            raise BagError(
                f'{path}: pose {number} has {count} joint positions, the first has {counts[0]}'
            )
    return ProbingSet(
        np.array([pose.location for pose in poses], dtype=np.int64),
        np.array([pose.sphere for pose in poses], dtype=np.int64),
        np.array([pose.joint_position for pose in poses], dtype=np.float64),
        np.array([pose.displacement for pose in poses], dtype=np.float64),
        np.array([cdr.stamp_of(pose) for pose in poses], dtype=np.int64),
        np.array([pose.readings for pose in poses], dtype=np.int64),
    )
