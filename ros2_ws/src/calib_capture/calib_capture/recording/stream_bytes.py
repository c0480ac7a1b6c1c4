# SPDX-License-Identifier: Apache-2.0
"""Joint states and readings out of their messages' CDR bytes: what pairing needs of them, no more.

rclpy makes an object of every field, and of a capture's work that was an eighth.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from calib_model.pairing import JointSample, Reading, joint_layout, little_endian, usable
from calib_model.stamps import SECOND
from calib_model.topics import DISPLACEMENTS, JOINT_STATE

BEHIND = 4  # bytes of the CDR header, from behind which alignment counts
STAMP = struct.Struct('<iII')  # and the length of the frame's name
FRAME = 12  # where the length of the frame's name stands, behind CDR header and stamp
VALUES = struct.Struct('<3d3B')


def _after_header(raw: bytes) -> tuple[int, int]:
    """The stamp, ns, and where the header ends."""
    seconds, nanoseconds, frame = STAMP.unpack_from(raw, BEHIND)
    return seconds * SECOND + nanoseconds, BEHIND + STAMP.size + frame


def read_reading(raw: bytes) -> Reading:
    """What a StylusDisplacements message says."""
    raw = little_endian(DISPLACEMENTS, raw)
    stamp, at = _after_header(raw)
    *displacement, first, second, third = VALUES.unpack_from(raw, at + -(at - BEHIND) % 8)
    return Reading(stamp, np.array(displacement), (first, second, third))


class JointStateReader:
    """Reads the joints `names` out of JointState messages. Where they are in one is known from the
    one before, as long as all before its numbers is alike."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._alike = b''  # from behind the stamp to the positions
        self._positions = struct.Struct('')
        self._places: tuple[int, ...] | None = None  # of our joints among the positions

    def read(self, raw: bytes) -> JointSample | None:
        """The joints at the message's stamp; None where one is missing or no number."""
        raw = little_endian(JOINT_STATE, raw)
        if not self._alike or not raw.startswith(self._alike, FRAME):
            self._look(raw)
        if self._places is None:
            return None
        stamp, _ = _after_header(raw)
        position = self._positions.unpack_from(raw, FRAME + len(self._alike))
        joints = np.array([position[place] for place in self._places])
        return JointSample(stamp, joints) if usable(joints) else None

    def _look(self, raw: bytes) -> None:
        """Find out where the joints are."""
        self._places = None
        try:
            layout = joint_layout(raw)
        except ValueError:  # of no arm
            return
        self._alike = raw[FRAME : layout.values]
        self._positions = struct.Struct(f'<{layout.count}d')
        named = layout.names(raw)
        if layout.count >= len(named) and set(self._names) <= set(named):
            self._places = tuple(map(named.index, self._names))
