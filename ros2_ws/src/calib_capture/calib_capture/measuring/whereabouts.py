# SPDX-License-Identifier: Apache-2.0
"""Where the arm stands, against where it was commanded to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_capture.measuring.run_settings import RunError
from calib_model.arrays import Array, frozen, largest_difference
from calib_model.stamps import SECOND

STILL = 5e-4  # rad: more than encoders scatter
STAMP_STEP = 1e-6  # s: stamps are rounded


class StandingMean:
    """The mean of the joints while they stay within `tolerance` (rad) of it, and since when."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._sum: Array | None = None
        self._count = 0
        self._since = self._last = 0
        self.step: Array | None = None  # (n,) rad, by which they last left where they were

    def see(self, joints: Array, stamp: int) -> bool:
        """The joints (n,) at a stamp (ns); whether they have left where they were."""
        self._last = stamp
        self._since = min(self._since, stamp)  # a clock may be set back
        here = self._sum
        if here is not None and largest_difference(joints, here / self._count) <= self._tolerance:
            self._sum, self._count = here + joints, self._count + 1
            return False
        self.step = None if here is None else joints - here / self._count
        self._sum, self._count, self._since = joints.copy(), 1, stamp
        return True

    @property
    def mean(self) -> Array | None:
        """Of the joints (n,), rad."""
        return None if self._sum is None else frozen(self._sum / self._count)

    @property
    def held(self) -> float:
        """Seconds since they came here."""
        return (self._last - self._since) / SECOND

    @property
    def seconds(self) -> float:
        """The newest stamp, s."""
        return self._last / SECOND


class Whereabouts:
    """Sees the joint states; `goal` (n,) is where the arm was commanded to be, None where nobody
    knows. Within `tolerance` (rad) it is there."""

    def __init__(self, joint_names: Sequence[str], tolerance: float) -> None:
        self._names, self._tolerance = joint_names, tolerance
        self._newest: Array | None = None
        self._stands = StandingMean(STILL)
        self.goal: Array | None = None
        self.heard = True  # whether there was a joint state since the command
        self._left = True  # whether it has moved since then

    def see(self, joints: Array, stamp: int) -> bool:
        """The joints (n,) at a stamp (ns); whether that is a sign of life: the arm moves, or was
        not heard since its command."""
        moved = self._stands.see(joints, stamp)
        alive = moved or not self.heard
        self._left, self.heard = self._left or moved, True
        self._newest = joints
        return alive

    def commanded(self, goal: Array) -> None:
        """It has been sent to a posture (n,)."""
        self.goal = goal
        self._left = self.heard = False

    def lost(self) -> None:
        """Where it goes nobody knows any more."""
        self.goal = None

    @property
    def known(self) -> bool:
        """Whether it has been seen at all."""
        return self._newest is not None

    @property
    def stands(self) -> Array | None:
        """Where it stands (n,), once it has been seen."""
        return self._stands.mean

    @property
    def left(self) -> bool:
        """Whether it has moved since it was commanded."""
        return self._left

    @property
    def held(self) -> float:
        """For how many s it has stood where it is."""
        return self._stands.held

    @property
    def seconds(self) -> float:
        """The stamp at which it was last seen, s."""
        return self._stands.seconds

    @property
    def start(self) -> Array:
        """Where the next motion begins (n,): where it was commanded to be if it is there, else
        where it stands."""
        here = self._stands.mean
        assert here is not None
        if self.goal is not None and self.near(here, self.goal):
            return self.goal
        return here

    def near(self, one: Array, other: Array) -> bool:
        """Whether two postures (n,) are the same within the tolerance."""
        return largest_difference(one, other) <= self._tolerance

    def arrived(self, hold: float) -> bool:
        """Whether it has come to where it was commanded, and stood there for `hold` s."""
        if self._newest is None or self.goal is None or not self._left:
            return False
        return self.held >= hold - STAMP_STEP and self.near(self._newest, self.goal)

    def restless(self) -> RunError:
        """What to say of an arm that has not come to rest."""
        left = self._stands.step
        step = np.zeros(len(self._names)) if left is None else np.abs(left)
        joint = int(np.argmax(step))
        return RunError(
            f'the arm does not come to rest: {self._names[joint]} moves or scatters by '
            f'{step[joint]:.2g} rad, where {STILL:g} are still; does something else move it, or '
            'are its joint states in another unit than rad?'
        )

    def refuse_standstill(self) -> None:
        """Nothing, where the arm has come to where it was commanded to.

        Raises:
            RunError: it has not; to be asked when there is no sign of life.
        """
        here = self._stands.mean
        if here is None or self.goal is None:
            return
        off = np.abs(here - self.goal)
        joint = int(np.argmax(off))
        if off[joint] <= self._tolerance:
            return
        what = 'has stopped on the way' if self._left else 'has not moved since it was commanded'
        raise RunError(
            f'the arm does not follow: it {what}, {self._names[joint]} stands '
            f'{off[joint]:.3g} rad from its goal; see what the controller says'
        )
