# SPDX-License-Identifier: Apache-2.0
"""Two streams of a few seconds: how often they come, and what they are stamped with."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib_capture.checking.finding import DOUBTFUL, OK, WRONG, Finding
from calib_model.arrays import Array
from calib_model.pairing import JointSample, Reading
from calib_model.stamps import SECOND

FAST, SLOW = 90.0, 9.5  # Hz: as asked for, and too slow for anything
LONG_GAP, GAP = 5.0, 0.05  # times the usual time between messages, and s, that are a gap
MANY_GAPS, LOST = 3, 0.3  # so many gaps, that are such a share of the time
LONGEST_GAP = 0.3  # s, in which a motion can hide
APART = 0.2  # s between stamps of what comes together
Stamps = NDArray[np.int64]
JOINTS, READINGS = 'joint states', 'readings'


@dataclass
class Heard:
    """What came of both streams, with the time of its arrival (s)."""

    joints: list[JointSample] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    joint_times: list[float] = field(default_factory=list)
    reading_times: list[float] = field(default_factory=list)

    def take(self, message: JointSample | Reading, now: float) -> None:
        """Keep one message that came `now` (s)."""
        if isinstance(message, JointSample):
            self.joints.append(message)
            self.joint_times.append(now)
        else:
            self.readings.append(message)
            self.reading_times.append(now)

    @property
    def contacts(self) -> Array:
        """Displacements (N, 3) of readings whose styli are all well."""
        good = [each.displacement for each in self.readings if not any(each.status)]
        return np.array(good).reshape(-1, 3)

    @property
    def rate(self) -> float:
        """Of the slower stream, Hz."""
        slower = min((self.joint_times, self.reading_times), key=len)
        return (len(slower) - 1) / max(slower[-1] - slower[0], 1e-9)

    @property
    def postures(self) -> Array:
        """The joints (N, n) of all joint states."""
        return np.array([each.joints for each in self.joints])


def stream_findings(heard: Heard) -> list[Finding]:
    """Rates, gaps, stamps and how far apart the two clocks are by what comes together."""
    findings = []
    for name, samples, times in (
        (JOINTS, heard.joints, heard.joint_times),
        (READINGS, heard.readings, heard.reading_times),
    ):
        stamps = np.array([each.stamp for each in samples], dtype=np.int64)
        findings += [_rate(name, np.array(times)), _stamps(name, stamps)]
        if len(stamps) > 2:
            findings.append(_gaps(name, np.diff(stamps) / SECOND))
    findings.append(_together(heard))
    return findings


def _rate(name: str, times: Array) -> Finding:
    what = f'rate of {name}'
    if len(times) < 3:
        return Finding(what, WRONG, f'{len(times)} messages', 'is its driver well?')
    rate = (len(times) - 1) / max(times[-1] - times[0], 1e-9)
    seen = f'{rate:.3g} Hz'
    if rate < FAST:
        verdict = WRONG if rate < SLOW else DOUBTFUL
        return Finding(what, verdict, seen, '100 Hz or more are asked for', movable=True)
    return Finding(what, OK, seen)


def _gaps(name: str, steps: Array) -> Finding:
    what = f'gaps in {name}'
    usual = float(np.median(steps))
    wide = steps[steps > max(LONG_GAP * usual, GAP)]
    if not len(wide):
        return Finding(what, OK, f'none, a message every {usual * 1e3:.3g} ms')
    seen = f'{len(wide)}, the widest of {wide.max():.2f} s'
    share = wide.sum() / max(float(steps[steps > 0].sum()), 1e-9)
    often = len(wide) >= MANY_GAPS and share > LOST
    long = bool(wide.max() > LONGEST_GAP)
    verdict = WRONG if often or long else DOUBTFUL
    advice = 'see what holds messages up or loses them: network, driver, a busy computer'
    return Finding(what, verdict, seen, advice, movable=not long)


def _stamps(name: str, stamps: Stamps) -> Finding:
    what = f'stamps of {name}'
    if not stamps.any():
        return Finding(what, WRONG, 'zero', 'stamp messages when they are measured')
    steps = np.diff(stamps)
    if (steps < 0).any():
        seen = f'{int((steps < 0).sum())} of {len(steps)} go back'
        return Finding(what, WRONG, seen, 'is there a second publisher, or a clock that is set?')
    same = int((steps == 0).sum())
    if same > 0.1 * len(steps):
        seen = f'{same} of {len(steps)} as the one before'
        return Finding(what, WRONG, seen, 'stamp each when it is measured')
    return Finding(what, OK, 'they increase')


def arrival_offset(heard: Heard) -> float:
    """By how much (s) readings are stamped before the joint states that they come with, as a rule;
    what holds up either stream is in it."""
    return float(np.median(arrivals(heard)))


def nearest_arrival(heard: Heard) -> float:
    """The same of the one that comes nearest: what is held up only takes stamps further apart."""
    late = arrivals(heard)
    return float(late[np.argmin(np.abs(late))])


def arrivals(heard: Heard) -> Array:
    """The same of each reading, (N,) s."""
    before = np.searchsorted(heard.joint_times, heard.reading_times) - 1
    joints = np.array([each.stamp for each in heard.joints], dtype=np.int64)
    readings = np.array([each.stamp for each in heard.readings], dtype=np.int64)
    late: Array = (joints[np.maximum(before, 0)] - readings) / SECOND
    return late


def _together(heard: Heard) -> Finding:
    """By the stamps of readings and the joint state that came last before each."""
    what = 'one clock'
    if not heard.joints or not heard.readings:
        return Finding(what, DOUBTFUL, 'not both streams came', 'see above')
    late = nearest_arrival(heard)
    if abs(late) > APART:
        behind = 'before' if late > 0 else 'after'
        seen = f'readings are stamped {abs(late):.3f} s {behind} the joints they come with'
        return Finding(what, WRONG, seen, 'stamp both on one clock, when they were measured')
    return Finding(what, OK, f'what comes together is stamped within {abs(late) * 1e3:.0f} ms')
