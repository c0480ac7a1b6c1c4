# SPDX-License-Identifier: Apache-2.0
"""Which readings of a hand-guided arm become poses: seated, and spaced along the arm's way."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from calib_model.arrays import Array
from calib_model.pairing.paired_readings import HandGuidedSettings
from calib_model.pairing.streams import Rows
from calib_model.stamps import SECOND

APART = SECOND // 10  # ns between readings that belong to one contact
WINDOW = 64  # readings that are looked at first for the next pose


class SpacedPose(NamedTuple):
    """A pose on the move: `joints` (n,) in rad, `displacement` (3,) in m, at `stamp` (ns), in
    contact with what the caller numbered `place`."""

    stamp: int
    place: int
    joints: Array
    displacement: Array


class SpacedPoses:
    """Takes paired readings in time order, as many at once as there are, and tells the poses.

    A contact is what follows at one place without a break. In it a pose is taken wherever the
    joints have gone the settings' spacing since the last one, but none while the sphere may not sit
    yet, or no more, at the contact's ends.
    """

    def __init__(self, settings: HandGuidedSettings) -> None:
        self.place: int | None = None  # in contact now
        self._spacing = settings.spacing
        self._seated = round(settings.seated * SECOND)
        self._begin = self._last = -APART
        self._posture: Array | None = None  # of the last pose of this contact
        self._unsure: deque[SpacedPose] = deque()  # the contact may end too soon after these

    def take(
        self, stamp: Rows, place: Rows, joints: Array, displacement: Array
    ) -> list[SpacedPose]:
        """Readings (N,) with `joints` (N, n) and `displacement` (N, 3): the poses that are certain
        now."""
        if not len(stamp):
            return []
        since = np.diff(stamp, prepend=self._last)
        moved = np.diff(place, prepend=-1 if self.place is None else self.place) != 0
        begins = moved | (since <= 0) | (since > APART)
        bounds = [0, *(np.flatnonzero(begins[1:]) + 1).tolist(), len(stamp)]
        sure: list[SpacedPose] = []
        for first, end in zip(bounds, bounds[1:], strict=False):
            if begins[first]:
                self.place, self._begin = int(place[first]), int(stamp[first])
                self._posture = None
                self._unsure.clear()
            rows = slice(first, end)
            sure += self._go_on(stamp[rows], joints[rows], displacement[rows])
        self._last = int(stamp[-1])
        return sure

    def start_over(self) -> None:
        """Take back what is not certain yet."""
        self.place, self._posture = None, None
        self._unsure.clear()

    def _go_on(self, stamp: Rows, joints: Array, displacement: Array) -> list[SpacedPose]:
        assert self.place is not None
        row = int(np.searchsorted(stamp, self._begin + self._seated))
        while (row := self._next(joints, row)) < len(stamp):
            self._posture = q = joints[row].copy()  # of its own: it keeps no other readings
            pose = SpacedPose(int(stamp[row]), self.place, q, displacement[row].copy())
            self._unsure.append(pose)
            row += 1
        sure, last = [], int(stamp[-1])
        while self._unsure and self._unsure[0].stamp + max(self._seated, 1) <= last:
            sure.append(self._unsure.popleft())
        return sure

    def _next(self, joints: Array, row: int) -> int:
        """The first reading from `row` on that is far enough from the last pose."""
        if self._posture is None:
            return row
        window = WINDOW
        while row < len(joints):
            way = travel(self._posture, joints[row : row + window])
            far = way >= self._spacing
            if far.any():
                return row + int(far.argmax())
            row, window = row + window, 2 * window
        return row


def travel(first: Array, others: Array) -> Array:
    """How far postures (N, n) are from a first one (n,), rad, of all joints together."""
    way: Array = np.sqrt(((others - first) ** 2).sum(axis=1))
    return way
