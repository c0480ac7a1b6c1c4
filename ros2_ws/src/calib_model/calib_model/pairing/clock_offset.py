# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of joint states and probe readings, from motion in contact.

While the arm moves with the sphere in the probe, joints and displacements must tell of one fixed
sphere. Read against the wrong instant of the joints, it seems to move with the arm's velocity.
The nominal arm makes it seem to move, too, and by more: so the arm's parameters are solved for
together with the offset, to first order, and forgotten.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from heapq import merge

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe, known_centers
from calib_model.kinematics import points, probing_jacobian
from calib_model.pairing.stop_and_go import JointSample, Reading, usable
from calib_model.stamps import SECOND

FINE = 0.02  # s between joint states up to which the arm's way between them is known
APART = 0.1  # s between readings that belong to one contact
SPACING = 0.0079  # s between readings that are looked at: more of them tell little more
CHUNK = 200  # readings that are kept together
WHILE = 25  # readings within which nothing but motion moves the sphere
STEP = 8e-3  # s of the central difference: noise of joint states is no velocity
SLOWEST = 2e-3  # m/s that count as motion
FEWEST = 20  # readings in motion that an estimate needs
ROUNDS = 20
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
FITTED = 6  # chunks that look no worse than they are: the arm's parameters have bent to them
NOISE = 1e-4  # m: what no kinematic parameter explains


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
    """Consecutive readings of one contact: `t` (N,), s, and `p_probe` (N, 3), m, of each.

    `t_joints` (M,) and `q` (M, n) are the joint states around them.
    """

    t: Array
    p_probe: Array
    t_joints: Array
    q: Array


@dataclass(frozen=True)
class _Sums:
    """What a chunk tells when its readings are `around` s from the joints.

    Its columns are the rate by the offset, those of P parameters, and the sphere's place:
    `square` (P + 2, P + 2) sums their products over readings and coordinates, each column around
    its mean over a short while.
    """

    readings: int
    moving: int
    square: Array


class ClockEstimate:
    """Takes both streams message by message and tells the offset between their clocks so far.

    Each stream comes in the order of its stamps; messages that do not are left out.
    """

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge) -> None:
        self._arm, self._probe, self._diameter = arm, probe, gauge.sphere_diameter
        self._origin: int | None = None
        self._joints: deque[JointSample] = deque()
        self._open: list[Reading] = []
        self._waiting: deque[list[Reading]] = deque()
        self._last = -1
        self._every, self._skipped = 1, 0
        self._chunks: list[_Chunk] = []
        self._around = 0.0
        self._sums: list[_Sums] = []

    @property
    def chunks(self) -> int:
        """How many stretches of contact, of up to two seconds each, there are to tell by."""
        return len(self._chunks) * self._every

    def see_joints(self, sample: JointSample) -> None:
        """Take one joint state."""
        if self._joints and sample.stamp <= self._joints[-1].stamp:
            return
        if self._origin is None:
            self._origin = sample.stamp
        self._joints.append(sample)
        while self._waiting and self._waiting[0][-1].stamp + MARGIN <= sample.stamp:
            self._keep(self._waiting.popleft())
        self._forget()

    def see_reading(self, reading: Reading) -> None:
        """Take one probe reading."""
        if any(reading.status) or reading.stamp < self._last + SPACING * SECOND:
            return
        if not usable(reading.displacement):
            return
        if len(self._open) == CHUNK or reading.stamp > self._last + APART * SECOND:
            self._end_chunk()
        self._last = reading.stamp
        self._open.append(reading)

    def finish(self) -> None:
        """Take in what is left: no more messages are coming."""
        self._end_chunk()
        while self._waiting:
            self._keep(self._waiting.popleft())

    def estimate(self) -> ClockOffset | None:
        """The offset, None where the streams do not tell: no motion in contact, or too little."""
        for _ in range(ROUNDS):
            new = self._chunks[len(self._sums) :]
            self._sums += [self._summed(chunk) for chunk in new]
            sums = [each for each in self._sums if each.readings]
            if sum(each.moving for each in sums) < FEWEST:
                return None
            seconds, uncertainty = _solved(sums, self._prior())
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
        if len(self._open) > 2:
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

    def _keep(self, readings: list[Reading]) -> None:
        self._skipped += 1
        if self._skipped < self._every or len(self._joints) < 2 or self._origin is None:
            return
        self._skipped = 0
        t = np.array([each.stamp - self._origin for each in readings]) / SECOND
        t_joints = np.array([each.stamp - self._origin for each in self._joints]) / SECOND
        q = np.array([each.joints for each in self._joints])
        first, last = np.searchsorted(t_joints, [t[0] - MARGIN / SECOND, t[-1] + MARGIN / SECOND])
        if last - first < 2:
            return
        s = np.array([each.displacement for each in readings])
        p_probe = known_centers(self._probe, s, self._diameter)
        good = np.isfinite(p_probe).all(axis=1)
        # copies: a slice would keep all the joint states there were
        around = t_joints[first:last].copy(), q[first:last].copy()
        self._chunks.append(_Chunk(t[good], p_probe[good], *around))
        if len(self._chunks) > KEPT:  # every second one tells almost as much
            self._chunks, self._sums = self._chunks[::2], []
            self._every *= 2

    def _summed(self, chunk: _Chunk) -> _Sums:
        known = _finely_known(chunk.t_joints, chunk.t + self._around)
        at, p_probe = chunk.t[known] + self._around, chunk.p_probe[known]
        if len(at) < 3:
            return _Sums(0, 0, np.zeros(0))

        def joints(shift: float) -> Array:
            turned = [np.interp(at + shift, chunk.t_joints, column) for column in chunk.q.T]
            return np.stack(turned, axis=1)

        p_flange = self._probe.flange_T_probe.apply(p_probe)
        before, after = (points(self._arm, joints(shift), p_flange) for shift in (-STEP, STEP))
        rate = (after - before) / (2 * STEP)  # m/s
        moving = np.linalg.norm(rate, axis=1) > SLOWEST
        rate[~moving] = 0.0
        p_base, by_parameters = probing_jacobian(self._arm, self._probe, joints(0.0), p_probe)
        place = p_base - rate * self._around
        columns = np.concatenate([rate[..., None], by_parameters, place[..., None]], axis=2)
        rows = _centred(columns).reshape(-1, columns.shape[2])
        return _Sums(len(at), int(moving.sum()), rows.T @ rows)


def estimate_clock_offset(
    arm: Arm,
    probe: Probe,
    gauge: Gauge,
    joints: Sequence[JointSample],
    readings: Sequence[Reading],
) -> ClockOffset | None:
    """The offset, None where the streams do not tell: no motion in contact, or too little."""
    estimate = ClockEstimate(arm, probe, gauge)
    for message in _in_time(joints, readings):
        if isinstance(message, Reading):
            estimate.see_reading(message)
        else:
            estimate.see_joints(message)
    estimate.finish()
    return estimate.estimate()


def _in_time(
    joints: Iterable[JointSample], readings: Iterable[Reading]
) -> Iterable[JointSample | Reading]:
    of_arm: Iterable[JointSample | Reading] = sorted(joints, key=lambda each: each.stamp)
    of_probe: Iterable[JointSample | Reading] = sorted(readings, key=lambda each: each.stamp)
    return merge(of_arm, of_probe, key=lambda each: each.stamp)


def _solved(chunks: Sequence[_Sums], prior: Array) -> tuple[float, float]:
    """The offset and its standard uncertainty, s, with the parameters as far off as `prior` lets.

    The uncertainty is that of chunks that err on their own: neighbouring readings err alike. It is
    no less than what the parameters leave open: chunks of one sphere, to which they all bent, agree
    with one another and not with the truth.
    """
    squares = np.array([chunk.square for chunk in chunks]) / NOISE**2
    square = squares.sum(axis=0)
    inverse = np.linalg.pinv(square[:-1, :-1] + np.diag(prior), hermitian=True)
    x = -inverse @ square[:-1, -1]
    score = np.append(inverse[0], 0.0) @ squares @ np.append(x, 1.0)
    freedom = len(chunks) / max(len(chunks) - FITTED, 1)
    scatter = np.sqrt((score**2).sum() * freedom)
    best = np.append(x, 1.0)
    noise = best @ square @ best / sum(3 * chunk.readings for chunk in chunks)  # in NOISE**2
    return float(x[0]), float(max(scatter, np.sqrt(inverse[0, 0] * noise * WHILE)))


def _centred(columns: Array) -> Array:
    """Columns (N, 3, K) around their mean over each `WHILE` rows.

    What an arm's errors and the hand's force do to the sphere's place changes slowly, and so does
    not matter.
    """
    begin = np.arange(0, len(columns), WHILE)
    count = np.diff(np.append(begin, len(columns)))
    mean = np.add.reduceat(columns, begin) / count[:, None, None]
    centred: Array = columns - np.repeat(mean, count, axis=0)
    return centred


def _finely_known(t_joints: Array, t: Array) -> NDArray[np.bool_]:
    """Which instants (N,) fall between joint states close together, with room around them."""
    gap = np.diff(t_joints)
    known: NDArray[np.bool_] = np.full(len(t), len(gap) > 0)
    for shift in (-STEP, 0.0, STEP):
        place = np.searchsorted(t_joints, t + shift, side='right') - 1
        inside = (place >= 0) & (place < len(gap))
        known = known & inside & (gap[np.clip(place, 0, len(gap) - 1)] <= FINE)
    return known
