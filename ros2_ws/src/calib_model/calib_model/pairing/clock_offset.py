# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of joint states and probe readings, from motion in contact.

While the arm moves with the sphere in the probe, joints and displacements must tell of one fixed
sphere. Read against the wrong instant of the joints, it seems to move with the arm's velocity.
The nominal arm makes it seem to move, too, and by more: so the arm's parameters are solved for
together with the offset, to first order, and forgotten.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe, known_centers
from calib_model.kinematics import points, probing_jacobian
from calib_model.pairing.clock_equations import ChunkSums, centred, solved
from calib_model.pairing.interpolation import interpolated
from calib_model.pairing.readings import GRAVEST, JointSample, Reading, objections, usable
from calib_model.pairing.streams import STEP_BACK, RawStreams, Rows
from calib_model.stamps import SECOND

FINE = 0.02  # s between joint states up to which the arm's way between them is known
APART = 0.1  # s between readings that belong to one contact
SPACING = 7_900_000  # ns between readings that are looked at: more of them tell little more
CHUNK = 200  # readings that are kept together
STEP = 8e-3  # s of the central difference: noise of joint states is no velocity
FEW = 2  # readings in a row that tell nothing
SLOWEST = 2e-3  # m/s that count as motion
FEWEST = 20  # readings in motion that an estimate needs
ROUNDS = 20
MANY = 100_000  # stamps that are looked at as Python's numbers at a time
SAME = 2e-5  # s: so near the estimate is exact
LONGEST = 0.05  # s: beyond that it is no offset between clocks
KNOWN_TO = 5e-4  # s of standard uncertainty up to which an estimate is one
MARGIN = round((LONGEST + STEP + FINE) * SECOND)  # ns of joint states around a reading
LONGEST_WAIT = 60 * SECOND  # ns that joint states are kept for readings that do not come
WAITING = 20  # chunks that wait for joint states: those of other clocks never come
KEPT = 120  # chunks: beyond, every second one is forgotten
#: how far off an arm may be before it is calibrated (a, alpha, d, theta_0, beta), and its probe;
#: m and rad
UNKNOWN = (1e-3, 2e-3, 1e-3, 2e-3, 2e-3)
UNKNOWN_PROBE = (2e-3, 2e-2)


@dataclass(frozen=True)
class ClockOffset:
    """`seconds` to be added to a reading's stamp to have it in the joints' clock."""

    seconds: float
    standard_uncertainty: float
    readings: int

    def line(self) -> str:
        """In words."""
        return (
            f'clock offset: readings are {self.seconds * 1e3:+.3f} ms from the joints, '
            f'standard uncertainty {self.standard_uncertainty * 1e3:.3f} ms'
        )


@dataclass(frozen=True)
class _Chunk:
    """Consecutive readings of one contact: `stamp` (N,), ns, and `p_probe` (N, 3), m, of each.

    `joint_stamp` (M,), ns, and `q` (M, n) are the joint states around them.
    """

    stamp: Rows
    p_probe: Array
    joint_stamp: Rows
    q: Array


class ClockEstimate:
    """Takes both streams, message by message or whole, and tells the offset between their clocks.

    Each stream comes in the order of its stamps; messages that do not are left out. Either way the
    same readings are looked at, with the same joint states around them.
    """

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge) -> None:
        self._arm, self._probe, self._diameter = arm, probe, gauge.sphere_diameter
        self._joints: deque[JointSample] = deque()
        self._open: list[Reading] = []
        self._waiting: deque[list[Reading]] = deque()
        self._last = -1
        self._every, self._skipped = 1, 0
        self._chunks: list[_Chunk] = []
        self._around = 0.0
        self._sums: list[ChunkSums] = []

    @property
    def chunks(self) -> int:
        """How many stretches of contact, of up to two seconds each, there are to tell by."""
        return len(self._chunks) * self._every

    def see_joints(self, sample: JointSample) -> None:
        """Take one joint state."""
        newest = self._joints[-1].stamp if self._joints else sample.stamp - 1
        if sample.stamp < newest - STEP_BACK:
            self.finish()
            self._joints.clear()
        elif sample.stamp <= newest:
            return
        self._joints.append(sample)
        while self._waiting and self._waiting[0][-1].stamp + MARGIN <= sample.stamp:
            self._keep_waiting()
        self._forget()

    def see_reading(self, reading: Reading) -> None:
        """Take one probe reading."""
        if reading.stamp < self._last - STEP_BACK:
            self._end_chunk()
            self._last = -1
        if any(reading.status) or reading.stamp < self._last + SPACING:
            return
        if not usable(reading.displacement):
            return
        if len(self._open) == CHUNK or reading.stamp > self._last + APART * SECOND:
            self._end_chunk()
        self._last = reading.stamp
        self._open.append(reading)

    def see_streams(self, streams: RawStreams) -> None:
        """Take both streams whole; what was seen before is no part of them."""
        against = objections(streams.status, streams.displacement)
        rows = np.flatnonzero(against == len(GRAVEST))
        rows = rows[_spaced(streams.reading_stamp[rows], SPACING)]
        stamp = streams.reading_stamp[rows]
        contacts = np.split(rows, np.flatnonzero(np.diff(stamp) > APART * SECOND) + 1)
        for contact in contacts:
            for begin in range(0, len(contact), CHUNK):
                chunk = contact[begin : begin + CHUNK]
                if len(chunk) > FEW:
                    self._keep(
                        streams.reading_stamp[chunk],
                        streams.displacement[chunk],
                        streams.joint_stamp,
                        streams.joints,
                    )

    def finish(self) -> None:
        """Take in what is left: no more messages are coming."""
        self._end_chunk()
        while self._waiting:
            self._keep_waiting()

    def estimate(self) -> ClockOffset | None:
        """The offset, None where the streams do not tell: no motion in contact, or too little."""
        for _ in range(ROUNDS):
            new = self._chunks[len(self._sums) :]
            self._sums += [self._summed(chunk) for chunk in new]
            sums = [each for each in self._sums if each.readings]
            if sum(each.moving for each in sums) < FEWEST:
                return None
            seconds, uncertainty = solved(sums, self._prior())
            if not abs(seconds) <= LONGEST:
                self._around, self._sums = 0.0, []
                return None
            if abs(seconds - self._around) < SAME:
                count = sum(each.readings for each in sums)
                known = uncertainty <= KNOWN_TO
                return ClockOffset(seconds, uncertainty, count) if known else None
            self._around, self._sums = seconds, []
        return None

    def _prior(self) -> Array:
        unknown = np.append(np.repeat(UNKNOWN, self._arm.n), np.repeat(UNKNOWN_PROBE, 3))
        prior: Array = np.append(0.0, 1 / unknown**2)
        return prior

    def _end_chunk(self) -> None:
        if len(self._open) > FEW:
            self._waiting.append(self._open)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()
        self._open = []

    def _forget(self) -> None:
        """Drop the joint states from before all readings that are still to be looked at."""
        oldest = self._last
        if self._waiting:
            oldest = self._waiting[0][0].stamp
        elif self._open:
            oldest = self._open[0].stamp
        keep = max(oldest, self._joints[-1].stamp - LONGEST_WAIT) - 2 * MARGIN
        while self._joints and self._joints[0].stamp < keep:
            self._joints.popleft()

    def _keep_waiting(self) -> None:
        readings = self._waiting.popleft()
        self._keep(
            np.array([each.stamp for each in readings]),
            np.array([each.displacement for each in readings]),
            np.array([each.stamp for each in self._joints], dtype=np.int64),
            np.array([each.joints for each in self._joints]),
        )

    def _keep(self, stamp: Rows, displacement: Array, joint_stamp: Rows, joints: Array) -> None:
        self._skipped += 1
        if self._skipped < self._every:
            return
        self._skipped = 0
        first, last = np.searchsorted(joint_stamp, [stamp[0] - MARGIN, stamp[-1] + MARGIN])
        if last - first < 2:
            return
        p_probe = known_centers(self._probe, displacement, self._diameter)
        good = np.isfinite(p_probe).all(axis=1)
        # copies: a slice would keep all the joint states there were
        around = joint_stamp[first:last].copy(), joints[first:last].copy()
        self._chunks.append(_Chunk(stamp[good], p_probe[good], *around))
        if len(self._chunks) > KEPT:  # every second one tells almost as much
            self._chunks, self._sums = self._chunks[::2], []
            self._every *= 2

    def _summed(self, chunk: _Chunk) -> ChunkSums:
        at = chunk.stamp + round(self._around * SECOND)
        step = round(STEP * SECOND)
        before, here, after = (
            interpolated(chunk.joint_stamp, chunk.q, at + shift, FINE) for shift in (-step, 0, step)
        )
        known = before.known & here.known & after.known
        p_probe = chunk.p_probe[known]
        if len(p_probe) <= FEW:
            return ChunkSums(0, 0, np.zeros(0))
        p_flange = self._probe.flange_T_probe.apply(p_probe)
        ends = [points(self._arm, each.joints[known], p_flange) for each in (before, after)]
        rate = (ends[1] - ends[0]) / (2 * STEP)  # m/s
        moving = np.linalg.norm(rate, axis=1) > SLOWEST
        rate[~moving] = 0.0
        p_base, by_parameters = probing_jacobian(
            self._arm, self._probe, here.joints[known], p_probe
        )
        place = p_base - rate * self._around
        columns = np.concatenate([rate[..., None], by_parameters, place[..., None]], axis=2)
        rows = centred(columns).reshape(-1, columns.shape[2])
        return ChunkSums(len(p_probe), int(moving.sum()), rows.T @ rows)


def estimate_clock_offset(
    arm: Arm, probe: Probe, gauge: Gauge, streams: Sequence[RawStreams]
) -> ClockOffset | None:
    """The offset that streams, one after the other, tell; None where they do not: no motion in
    contact, or too little."""
    estimate = ClockEstimate(arm, probe, gauge)
    for each in streams:
        estimate.see_streams(each)
    return estimate.estimate()


def _spaced(stamp: Rows, spacing: int) -> list[int]:
    """The rows of stamps (N,) in order of which each is at least `spacing` (ns) after the last."""
    rows, due = [], -1
    for begin in range(0, len(stamp), MANY):
        for row, each in enumerate(stamp[begin : begin + MANY].tolist(), start=begin):
            if each >= due:
                rows.append(row)
                due = each + spacing
    return rows
