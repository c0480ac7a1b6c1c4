# SPDX-License-Identifier: Apache-2.0
"""Measured points in a bag: the arm's description and the messages on /capture/points."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.bags import cdr
from calib_model.bags.descriptions import BagDescriptions
from calib_model.bags.files import listed_topics
from calib_model.bags.reader import read_messages
from calib_model.errors import BagError
from calib_model.instruments import Arm
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS

LARGEST_POINT = 10_000  # bytes: of a hundred joints and long names
LARGEST_SET = 400_000_000  # bytes: over a million points
NUMBERS = 8  # behind the joints: position, orientation, sigma

_Row = tuple[int, str, int, tuple[float, ...]]  # stamp, target, station, joints and numbers


def has_points(bag: str | Path) -> bool:
    """Whether a bag has messages on /capture/points.

    Raises:
        BagError: there is no bag, or it cannot be read.
    """
    topics = listed_topics(str(bag))
    if topics:
        return CAPTURE_POINTS.name in topics
    return next(read_messages(bag, {CAPTURE_POINTS.name}), None) is not None


@dataclass(frozen=True)
class PointMessages:
    """The `points` of a bag as they are there, when each was `recorded` (N,), ns, and what the bag
    describes."""

    points: PointSet
    recorded: NDArray[np.int64]
    described: BagDescriptions


def read_points(path: str | Path, arm: Arm | None = None) -> PointMeasurement:
    """The points in a bag, with the joints that they have; an arm given here takes the place of
    the bag's own.

    Raises:
        BagError: no bag, a topic missing, or a message that cannot be read.
        DescriptionError: the arm's description cannot be used.
        DataError: a point does not fit the arm.
    """
    found = read_point_messages(path)
    return PointMeasurement(arm or found.described.arm(), found.points, str(path)).checked()


def read_point_messages(path: str | Path) -> PointMessages:
    """The points in a bag whatever they have, the joints (N, 0) where a tracker sent them alone.

    Raises:
        BagError: no bag, a topic missing, or a message that cannot be read.
    """
    described = BagDescriptions(path)
    messages: list[bytes] = []
    recorded: list[int] = []
    size = 0
    for message in read_messages(path, {ARM_DESCRIPTION.name, CAPTURE_POINTS.name}):
        if message.topic != CAPTURE_POINTS.name:
            described.take(message)
            continue
        if message.type != CAPTURE_POINTS.type:
            raise BagError(
                f'{path}: topic {message.topic} has type {message.type}, not {CAPTURE_POINTS.type}'
            )
        size += len(message.data)
        if len(message.data) > LARGEST_POINT or size > LARGEST_SET:
            raise BagError(
                f'{path}: {message.topic}, message {len(messages) + 1} has {len(message.data)} '
                f'bytes, {size} with those before: more than is taken'
            )
        messages.append(message.data)
        recorded.append(message.log_time)
    if not messages:
        raise BagError(f'{path}: the bag has no messages on {CAPTURE_POINTS.name}')
    points = _decoded(path, messages)
    return PointMessages(points, np.array(recorded, dtype=np.int64), described)


def _decoded(path: str | Path, messages: Sequence[bytes]) -> PointSet:
    rows: list[_Row] = []
    for number, data in enumerate(messages, start=1):
        try:
            rows.append(_quickly(data) or _row_of(cdr.decode(CAPTURE_POINTS.type, data)))
        except ValueError as error:
            raise BagError(f'{path}: {CAPTURE_POINTS.name}, message {number}: {error}') from error
        if len(rows[-1][3]) != len(rows[0][3]):
            raise BagError(
                f'{path}: point {number} has {len(rows[-1][3]) - NUMBERS} joint positions, '
                f'the first has {len(rows[0][3]) - NUMBERS}'
            )
    stamp, target, station, values = zip(*rows, strict=True)
    table = np.array(values)
    joints, numbers = table[:, :-NUMBERS], table[:, -NUMBERS:]
    return PointSet(
        np.array(target),
        np.array(station, dtype=np.int64),
        joints,
        numbers[:, :3],
        numbers[:, 3:7],
        numbers[:, 7],
        np.array(stamp, dtype=np.int64),
    )


def _row_of(message: Any) -> _Row:
    values = (
        *message.joint_position.tolist(),
        *message.position.tolist(),
        *message.orientation.tolist(),
        float(message.sigma),
    )
    return cdr.stamp_of(message), str(message.target), int(message.station), values


def _quickly(data: bytes) -> _Row | None:
    """A little-endian message without the type system, which takes long to load; None where it is
    not laid out as it should be, to be read, or refused, by that."""
    try:
        if data[:2] != b'\x00\x01':
            return None
        # offsets are aligned as counted behind the CDR header of four bytes
        seconds, nanoseconds, length = struct.unpack_from('<iII', data, 4)
        at = 16 + length + -length % 4
        (length,) = struct.unpack_from('<I', data, at)
        target = data[at + 4 : at + 4 + length - 1].decode()
        at += 4 + length + -length % 4
        station, joints = struct.unpack_from('<II', data, at)
        at += 8
        at += -(at - 4) % 8
        count = joints + NUMBERS
        if joints > LARGEST_POINT or not at + 8 * count <= len(data) <= at + 8 * count + cdr.SLACK:
            return None
        values = struct.unpack_from(f'<{count}d', data, at)
    except (struct.error, UnicodeDecodeError):
        return None
    return seconds * 1_000_000_000 + nanoseconds, target, station, values
