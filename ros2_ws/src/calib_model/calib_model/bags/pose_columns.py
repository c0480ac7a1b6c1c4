# SPDX-License-Identifier: Apache-2.0
"""Many ProbingPose messages at once: alike in layout, they are one table of bytes."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.bags.cdr import SLACK
from calib_model.measurement import ProbingSet

LITTLE_ENDIAN = b'\x00\x01'
STRING_LENGTH = 12  # offset of the frame's length, behind CDR header and stamp


@dataclass(frozen=True)
class _Layout:
    """Offsets (bytes) of a message with such a frame and so many joints."""

    location: int
    joints: int
    count: int

    @property
    def values(self) -> int:
        return self.joints + 4 + -(self.joints + 4 - 4) % 8

    @property
    def end(self) -> int:
        return self.values + 8 * (self.count + 3) + 4


def decode_poses(messages: Sequence[bytes]) -> ProbingSet | None:
    """The poses of CDR messages of one layout; None where they differ, to be read one by one."""
    if not messages or len({len(data) for data in messages}) > 1:
        return None
    layout = _layout(messages[0])
    if layout is None or not layout.end <= len(messages[0]) <= layout.end + SLACK:
        return None
    table = np.frombuffer(b''.join(messages), dtype=np.uint8).reshape(len(messages), -1)
    for begin in (0, STRING_LENGTH, layout.joints):
        # byte order, the frame's length and the number of joints place everything else
        size = 2 if begin == 0 else 4
        if (table[:, begin : begin + size] != table[0, begin : begin + size]).any():
            return None

    def column(offset: int, kind: str, count: int = 1) -> np.ndarray:
        size = np.dtype(kind).itemsize * count
        return np.ascontiguousarray(table[:, offset : offset + size]).view(kind)

    seconds, nanoseconds = column(4, '<i4')[:, 0], column(8, '<u4')[:, 0]
    numbers = column(layout.location, '<u2', 2)
    values = column(layout.values, '<f8', layout.count + 3)
    return ProbingSet(
        numbers[:, 0],
        numbers[:, 1],
        values[:, : layout.count],
        values[:, layout.count :],
        seconds.astype(np.int64) * 1_000_000_000 + nanoseconds,
        column(layout.end - 4, '<u4')[:, 0],
    )


def _layout(data: bytes) -> _Layout | None:
    if data[:2] != LITTLE_ENDIAN or len(data) < STRING_LENGTH + 4:
        return None
    (length,) = struct.unpack_from('<I', data, STRING_LENGTH)
    # offsets are aligned as counted behind the CDR header of four bytes
    location = STRING_LENGTH + 4 + length
    location += location % 2
    joints = location + 4 + -(location + 4) % 4
    if joints + 4 > len(data):
        return None
    (count,) = struct.unpack_from('<I', data, joints)
    return _Layout(location, joints, count)
