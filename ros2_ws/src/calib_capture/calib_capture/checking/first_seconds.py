# SPDX-License-Identifier: Apache-2.0
"""What a capture looks at in its first seconds, to refuse what would spoil all of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib_capture.checking.contacts import apart, contact_of
from calib_capture.checking.finding import WRONG
from calib_capture.checking.first_contacts import ROWS, FirstContacts, clock_apart
from calib_capture.checking.hypotheses import AS_DESCRIBED, Contact, Explained, explained
from calib_capture.checking.signs import CLEARLY, fits, told_by
from calib_capture.checking.streams import SLOW, Heard, arrivals, nearest_arrival
from calib_capture.checking.units import joint_units
from calib_model.arrays import Array
from calib_model.instruments import ActiveProbe, Arm, Gauge
from calib_model.pairing import NOISIEST, JointSample, Reading, Reason, SteadySettings
from calib_model.stamps import SECOND

PERIOD = 1.0  # s between two looks
LISTENED = 2.0  # s after which rates and clocks are told
LONGEST = 30.0  # s after which nothing more is looked at
CONTACTS = 2  # contacts that tell of signs together
CLEARED = 8  # contacts in which all is as described: there need be no more
STEADY = 0.25  # of the offset by arrival, that it may vary by
APART = 0.25  # s between the clocks, told by the messages that come nearest together
BACK = 0.1  # of stamps, that may go back
REAL = 1.5  # times as fast as real: what lives faster is a simulation, and in haste
REFUSED = 4  # poses refused, and none taken
DEAFENING = 1.5  # times the noise that is averaged away: few readings tell it roughly
UNSTEADY, UNQUIET = Reason.STYLI_UNSTEADY.value, 2  # tries in vain that noise explains
NO_POSES, NONE = np.empty((0, 0)), Counter[str]()
TELLS_MORE = '`ros2 run calib_capture check` tells more'
#: what it may come from, by the reason of refusal
WHY: Mapping[str, str] = {
    'no contact': 'is the gauge where it is said to be, and does every joint count as described?',
    'over-travel': 'is the gauge where it is said to be?',
    UNSTEADY: 'is there noise on the styli, or vibration?',
    'joint states missing': 'are there gaps in the joint states, or two clocks?',
    'no probe readings': 'are there gaps in the readings, or two clocks?',
}


class FirstSeconds:
    """Sees both streams; `objection` is why the capture is to stop, empty as long as it is not.

    `places` (K, 3), m, are where the spheres should be in the base frame, `poses` (N, n) the
    postures to which the arm is sent. Readings of a pose may be `spread` (m) apart.
    """

    def __init__(
        self,
        arm: Arm,
        probe: ActiveProbe,
        gauge: Gauge,
        places: Array,
        poses: Array = NO_POSES,
        spread: float = SteadySettings.max_spread,
    ) -> None:
        self._arm, self._probe, self._gauge = arm, probe, gauge
        self._places, self._spread = places, spread
        self._alone = FirstContacts(arm, probe, gauge, places, poses)
        self._over = False
        self.objection = ''
        self.start_over()

    def start_over(self) -> None:
        """Forget what was heard: it may be of somebody else."""
        self._heard = Heard()
        self._begin = self._due = 0.0
        self._contacts, self._touching, self._told = 0, False, 0
        self._alone.start_over()

    def see(self, message: JointSample | Reading, now: float) -> None:
        """One message that came `now` (s)."""
        if self._over:
            return
        heard = self._heard
        first_joints = not heard.joints
        heard.take(message, now)
        if isinstance(message, Reading):
            touching = not any(message.status)
            self._contacts += touching and not self._touching
            self._touching = touching
        elif first_joints:
            self._begin, self._due = now, now + LISTENED
            self._object(self._units())
        if self._begin:
            self._object(self._of_first(message))
        if now >= self._due and self._begin:
            self._due = now + PERIOD
            self._look(now)

    @property
    def over(self) -> bool:
        """Whether it has heard enough."""
        return self._over

    def refused(
        self, taken: int, refused: Mapping[str, int], tried_again: Mapping[str, int] = NONE
    ) -> None:
        """How many poses were taken, refused, and are tried again so far, by reason."""
        if taken:
            return
        unsteady = refused.get(UNSTEADY, 0) + tried_again.get(UNSTEADY, 0)
        if unsteady >= UNQUIET and self._alone.noise > self._spread:
            self._object(self._noisy())
        if sum(refused.values()) < REFUSED:
            return
        reason = max(refused, key=lambda each: refused[each])
        if reason in WHY:
            self._object(f'the first {sum(refused.values())} poses gave {reason}: {WHY[reason]}')

    def _of_first(self, message: JointSample | Reading) -> str:
        if self._pace() >= REAL:
            self._alone.start_over()
            return ''
        found = self._alone.see(self._heard, message)
        return found or (
            self._noisy() if self._alone.noise > DEAFENING * NOISIEST * self._spread else ''
        )

    def _noisy(self) -> str:
        return (
            f'readings scatter by {self._alone.noise * 1e6:.0f} um on a sphere, of a pose they may '
            f'be {self._spread * 1e6:.0f} um apart: see to cables, shields and vibration'
        )

    def _look(self, now: float) -> None:
        self._object(self._units() or self._streams())
        new = self._contacts >= CONTACTS and self._contacts > self._told
        if new and self._pace() < REAL:
            self._object(self._signs())
        if now - self._begin > LONGEST or self._told >= CLEARED:
            self._over, self._heard = True, Heard()

    def _object(self, what: str) -> None:
        if what and not self.objection:
            self.objection = f'{what}; {TELLS_MORE}'

    def _units(self) -> str:
        """Of the newest joint state."""
        newest = Heard(joints=self._heard.joints[-1:])
        found = joint_units(self._arm, newest)
        return f'{found.what}: {found.seen}: {found.advice}' if found.verdict == WRONG else ''

    def _streams(self) -> str:
        """Rates and clocks: what no simulation's own pace can look like."""
        heard = self._heard
        for name, samples, times in (
            ('joint states', heard.joints, heard.joint_times),
            ('readings', heard.readings, heard.reading_times),
        ):
            stamps = np.array([each.stamp for each in samples], dtype=np.int64)
            if len(stamps) < 3:
                continue
            steps = np.diff(stamps)
            if not stamps.any():
                return f'{name} are stamped zero: stamp them when they are measured'
            if (steps < 0).mean() > BACK:
                return f'{int((steps < 0).sum())} of {len(stamps)} stamps of {name} go back'
            slowest = min(float(np.median(steps)) / SECOND, float(np.median(np.diff(times))))
            if slowest > 1 / SLOW:
                return f'{name} come at {1 / slowest:.2g} Hz: 100 Hz or more are asked for'
        if len(heard.joints) < ROWS or len(heard.readings) < ROWS or self._pace() >= REAL:
            return ''  # in haste a moment on the way is long by the stamps
        late = nearest_arrival(heard)
        low, high = np.percentile(arrivals(heard), [10, 90])
        if abs(late) < APART or high - low > STEADY * abs(late):
            return ''  # what is held up on a busy computer comes now sooner, now later
        side = 'before' if late > 0 else 'after'
        return (
            f'readings are stamped {abs(late):.2f} s {side} the joints they come with: stamp both '
            'on one clock'
        )

    def _pace(self) -> float:
        """Seconds of the stamps in a second."""
        heard = self._heard
        passed = heard.joint_times[-1] - heard.joint_times[0]
        return (heard.joints[-1].stamp - heard.joints[0].stamp) / SECOND / max(passed, 1e-9)

    def _signs(self) -> str:
        """Of joints, styli and mounting, and the clocks."""
        contact = contact_of(self._heard)
        if contact is None or len(contact.joints) < ROWS:
            return ''
        plain = self._explained(contact)
        if plain.cost > plain.rows:  # there may be better
            shifted = contact_of(self._heard, plain.late)
            if clock_apart(plain) and shifted is not None:
                again = self._explained(shifted)
                if again.cost / again.rows * CLEARLY < plain.cost / plain.rows:
                    return clock_apart(again)
            told = told_by(self._arm, self._probe, self._gauge, self._by_sphere(contact))
            if told.found is not None and not told.ok:
                return f'{told.names}: so the readings say, not as described'
        self._told = self._contacts
        return clock_apart(plain) if fits(plain) else ''

    def _explained(self, contact: Contact) -> Explained:
        spheres = self._by_sphere(contact)
        return explained(self._arm, self._probe, self._gauge, spheres, AS_DESCRIBED)

    def _by_sphere(self, contact: Contact) -> Contact:
        """With the sphere that each reading is of: the nearest one."""
        touches = contact.joints, contact.displacement
        distances = apart(self._arm, self._probe, self._gauge, touches, self._places)
        nearest = np.argmin(np.where(np.isnan(distances), np.inf, distances), axis=1)
        return replace(contact, sphere=nearest.astype(np.int64))
