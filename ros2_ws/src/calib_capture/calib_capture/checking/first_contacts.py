# SPDX-License-Identifier: Apache-2.0
"""What a capture's first stops and contacts tell, each by itself."""

from __future__ import annotations

from collections import deque

import numpy as np

from calib_capture.checking.contacts import AGAIN, FEWEST, apart, in_step, noise_of, told_of
from calib_capture.checking.hypotheses import AS_DESCRIBED, Explained, explained
from calib_capture.checking.signs import SURELY, fits
from calib_capture.checking.streams import Heard
from calib_model.arrays import Array
from calib_model.instruments import ActiveProbe, Arm, Gauge
from calib_model.pairing import JointSample, Reading, Status
from calib_model.stamps import SECOND

ROWS = 40  # readings in contact that tell of signs
SLOWEST = 0.025  # s between joint states: small motions hide between slower ones
BEFORE = 1.5  # s of joint states before a contact: clocks may be apart
ALIKE = 3  # explanations as good as the best, up to which it is one
LATE = 0.01  # s between the clocks that is said
WITHIN, STOOD = 2e-3, 0.05  # rad, s: the arm stands in a planned pose
TOUCHING = 40  # readings in contact at rest that tell their noise
RESTED, HARDLY = 0.05, 3e-3  # s, and rad in that time that readings show next to nothing of
EMPTY = 2  # poses that meet no sphere; one is enough after a touch where nothing should be
ASTRAY = 0.03  # m from every sphere, as described: farther than any stylus reaches


class FirstContacts:
    """Sees what was `heard` grow, of an arm that goes to `poses` (K, n) on spheres that should be
    at `places` (M, 3), m in the base frame; `noise` (m) is the largest so far of the readings in
    contact."""

    def __init__(
        self, arm: Arm, probe: ActiveProbe, gauge: Gauge, places: Array, poses: Array
    ) -> None:
        self._arm, self._probe, self._gauge = arm, probe, gauge
        self._places, self._poses = places, poses
        self._empty: set[int] = set()
        self._met = False  # a sphere, in a pose
        self._astray = 0.0  # m from the nearest sphere, as described, of the touch farthest off
        self.noise = 0.0
        self.start_over()

    def start_over(self) -> None:
        """What was heard begins anew."""
        self._contact: int | None = None  # the first reading of it
        self._last: deque[JointSample] = deque()
        self._resting: list[Reading] | None = None  # in contact, of an arm that rests
        self._pose: int | None = None
        self._since = self._came = 0
        self._answered = False

    def see(self, heard: Heard, message: JointSample | Reading) -> str:
        """What speaks against the capture; `message` is the newest of what was heard."""
        if isinstance(message, JointSample):
            self._rests(message)
            return self._unmet() if self._stands(heard, message) else ''
        touching, newest = not any(message.status), len(heard.readings) - 1
        begin = self._contact
        if touching and begin is None:
            self._contact = newest
            if heard.joints:
                self._astray = max(self._astray, self._off_places(heard.joints[-1], message))
        elif not touching and begin is not None:
            self._contact = None
            return self._told(heard, begin, newest)
        if touching and self._resting is not None:
            self._resting.append(message)
            if len(self._resting) == TOUCHING:
                values = np.array([each.displacement for each in self._resting])
                self.noise = max(self.noise, noise_of(values))
        elif not touching and self._resting:
            self._resting = []
        return ''

    def _rests(self, sample: JointSample) -> None:
        """Whether the arm rests, or moves so little that readings tell their noise."""
        self._last.append(sample)
        while self._last[-1].stamp - self._last[0].stamp > RESTED * SECOND:
            self._last.popleft()
        moved = np.ptp([each.joints for each in (self._last[0], sample)], axis=0).max()
        if len(self._last) < 3 or moved > HARDLY:
            self._resting = None
        elif self._resting is None:
            self._resting = []

    def _stands(self, heard: Heard, sample: JointSample) -> bool:
        """Whether the arm has stood in poses enough, and met no sphere as planned in any."""
        if self._met or not len(self._poses):
            return False
        near = np.abs(self._poses - sample.joints).max(axis=1) <= WITHIN
        pose = int(np.argmax(near)) if near.any() else None
        if pose is None or pose != self._pose:
            self._pose, self._since, self._came = pose, sample.stamp, len(heard.readings)
            self._answered = pose is None
            return False
        if self._answered or sample.stamp - self._since < STOOD * SECOND:
            return False
        readings = heard.readings[self._came :]
        if len(readings) < 3:
            return False
        self._answered, self._met = True, any(map(_meets, readings))
        if not self._met:
            self._empty.add(pose)
        return len(self._empty) >= (1 if self._astray > ASTRAY else EMPTY)

    def _off_places(self, sample: JointSample, touch: Reading) -> float:
        """How far from the nearest place (m) the sphere is that is touched, as described; 0 where
        that is not known."""
        touches = np.asarray(sample.joints)[None], np.asarray(touch.displacement)[None]
        distances = apart(self._arm, self._probe, self._gauge, touches, self._places)
        return float(np.nanmin(distances)) if np.isfinite(distances).any() else 0.0

    def _unmet(self) -> str:
        poses = f'{len(self._empty)} poses' if len(self._empty) > 1 else 'pose'
        before = (
            f', but a touch came {self._astray:.2f} m from where any sphere should be'
            if self._astray > ASTRAY
            else ''
        )
        return (
            f"the first {poses} met no sphere within the styli's travel{before}: is the gauge "
            'where it is said to be, and does every joint count as described?'
        )

    def _told(self, heard: Heard, begin: int, end: int) -> str:
        """Of joints, styli, mounting and clocks, as a contact tells in which all joints moved."""
        first = int(np.searchsorted(heard.joint_times, heard.reading_times[begin] - BEFORE))
        alone = Heard(
            heard.joints[first:],
            heard.readings[begin:end],
            heard.joint_times[first:],
            heard.reading_times[begin:end],
        )
        if _slow(alone.joints):
            return ''
        contact = in_step(self._arm, self._probe, self._gauge, alone)
        if contact is None or len(contact.joints) < ROWS:
            return ''
        plain = explained(self._arm, self._probe, self._gauge, contact, AS_DESCRIBED)
        if plain.cost < plain.rows and abs(plain.late - contact.shift) < AGAIN:
            return clock_apart(plain)
        told = told_of(self._arm, self._probe, self._gauge, alone, contact)
        if told.found is None or len(told.unsure) > ALIKE:
            return ''
        if not told.ok:
            return f'{told.names}: so the readings say, not as described'
        return clock_apart(told.found) if fits(told.found) else ''


def _meets(reading: Reading) -> bool:
    """Whether a stylus touches, and none farther than it can: a sphere met sideways is not met as
    planned."""
    status = reading.status
    return Status.OK.value in status and Status.OVER_TRAVEL.value not in status


def _slow(messages: list[JointSample]) -> bool:
    stamps = np.array([each.stamp for each in messages], dtype=np.int64)
    return len(stamps) < FEWEST or bool(np.median(np.diff(stamps)) > SLOWEST * SECOND)


def clock_apart(found: Explained) -> str:
    """What an explanation says of the clocks where they are not one."""
    if abs(found.late) <= max(LATE, SURELY * found.late_uncertainty):
        return ''
    late = abs(found.late)
    return (
        f'readings are stamped {f"{late:.2f} s" if late >= 1 else f"{late * 1e3:.0f} ms"} too '
        f'{"early" if found.late > 0 else "late"} for the joints: stamp both on one clock, when '
        'they were measured'
    )
