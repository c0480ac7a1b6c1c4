# SPDX-License-Identifier: Apache-2.0
"""Joint states and readings out of their messages' CDR bytes: what pairing needs of them, no more.

rclpy makes an object of every field, and of a capture's work that was an eighth.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from calib_model.pairing import JointSample, Reading, little_endian, usable
from calib_model.stamps import SECOND
from calib_model.topics import DISPLACEMENTS, JOINT_STATE

BEHIND = 4  # bytes of the CDR header, from behind which alignment counts
STAMP = struct.Struct('<iII')  # and the length of the frame's name
LENGTH = struct.Struct('<I')
VALUES = struct.Struct('<3d3B')


def _after_header(raw: bytes) -> tuple[int, int]:
    """The stamp, ns, and where the header ends."""
    seconds, nanoseconds, frame = STAMP.unpack_from(raw, BEHIND)
    return seconds * SECOND + nanoseconds, BEHIND + STAMP.size + frame


def _aligned(at: int, size: int) -> int:
    return at + -(at - BEHIND) % size


def read_reading(raw: bytes) -> Reading:
    """What a StylusDisplacements message says."""
    raw = little_endian(DISPLACEMENTS, raw)
    stamp, at = _after_header(raw)
    *displacement, first, second, third = VALUES.unpack_from(raw, _aligned(at, 8))
    return Reading(stamp, np.array(displacement), (first, second, third))


class JointStateReader:
    """Reads the joints `names` out of JointState messages. Where they are in one is known from the
    one before, as long as both name the same joints."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._layout = b''  # from the number of names to the number of positions
        self._count = 0
        self._places: tuple[int, ...] | None = None  # of our joints among the positions

    def read(self, raw: bytes) -> JointSample | None:
        """The joints at the message's stamp; None where one is missing or no number."""
        raw = little_endian(JOINT_STATE, raw)
        stamp, at = _after_header(raw)
        at = _aligned(at, 4)
        if not self._layout or not raw.startswith(self._layout, at):
            self._look(raw, at)
        if self._places is None:
            return None
        position = struct.unpack_from(f'<{self._count}d', raw, _aligned(at + len(self._layout), 8))
        joints = np.array([position[place] for place in self._places])
        return JointSample(stamp, joints) if usable(joints) else None

    def _look(self, raw: bytes, begin: int) -> None:
        """Find out where the joints are."""
        (number,) = LENGTH.unpack_from(raw, begin)
        named, at = [], begin + LENGTH.size
        for _ in range(number):
            at = _aligned(at, 4)
            (length,) = LENGTH.unpack_from(raw, at)
            at += LENGTH.size
            named.append(raw[at : at + length - 1].decode('utf-8', 'replace'))
            at += length
        at = _aligned(at, 4)
        (self._count,) = LENGTH.unpack_from(raw, at)
        self._layout = raw[begin : at + LENGTH.size]
        there = self._count >= number and set(self._names) <= set(named)
        self._places = tuple(map(named.index, self._names)) if there else None
