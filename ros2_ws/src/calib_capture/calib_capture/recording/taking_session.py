# SPDX-License-Identifier: Apache-2.0
"""A hand-guided session without probe readings: a pose is taken when somebody asks. No graph."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calib_capture.recording.hand_guided_run import Held
from calib_capture.recording.recorder import Recorder
from calib_model.arrays import Array
from calib_model.bags import cdr
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, PassiveProbe
from calib_model.labelling import AGAIN, held_posture, sockets
from calib_model.pairing import JointSample, Reading
from calib_model.stamps import SECOND
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, Topic

MOMENT = 0.2  # s of joint states that are looked at
FASTEST = 0.05  # rad/s: more and the hand does not hold the arm
OLD = 0.5  # s after which joint states are no longer those of the moment
UNTOLD = (0, 0)  # location and sphere that nobody has told
ENOUGH = 6  # poses from which on it can be told in how many sockets they are


TakenByHand = tuple[tuple[int, int], Array, Array]  # location and sphere, joints, displacements


class TakeError(CalibrationError):
    """A pose that cannot be taken, or taken back."""


@dataclass
class TakenTally:
    """How it is going."""

    planned: int = 0
    taken: int = 0
    undone: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    @property
    def done(self) -> int:
        """As `taken`."""
        return self.taken

    @property
    def left(self) -> int:
        """None is planned."""
        return 0

    def line(self) -> str:
        """Counts in words."""
        back = f', {self.undone} taken back' if self.undone else ''
        return f'{self.taken} poses taken by hand{back}'


class TakingRun:
    """What a progress bar asks of a session: only the operator knows."""

    current: Held | None = None

    def seconds_left(self, _: float) -> float:
        """Unknown."""
        return math.nan


class PoseTaker:
    """Keeps the last joint states of an arm whose ball sits in a socket, and makes a pose of the
    moment when asked. In which socket nobody has to say: poses are recorded without a sphere's
    number, unless `told` knows location and sphere of a posture (n,), and sorted when they are
    identified from.

    `undone` gets the CDR bytes of each pose that was taken back, once that is on disk. `clock`
    gives seconds, `wall` ns for the bag.
    """

    def __init__(
        self,
        arm: Arm,
        probe: PassiveProbe,
        recorder: Recorder,
        undone: Callable[[bytes], None],
        clock: Callable[[], float],
        wall: Callable[[], int],
        told: Callable[[Array], tuple[int, int]] = lambda posture: UNTOLD,
    ) -> None:
        self.tally = TakenTally()
        self._arm, self._probe, self._recorder = arm, probe, recorder
        self._undone, self._clock, self._wall, self._told = undone, clock, wall, told
        self._heard = -math.inf
        self._samples: deque[JointSample] = deque()
        self._poses: list[Any] = []

    @property
    def poses(self) -> list[TakenByHand]:
        """Those that were taken, and not taken back."""
        return [
            ((each.location, each.sphere), each.joint_position, each.displacement)
            for each in self._poses
        ]

    def see(self, sample: JointSample) -> None:
        """A joint state has come."""
        self._heard = self._clock()
        if self._samples and sample.stamp <= self._samples[-1].stamp:
            self._samples.clear()
        self._samples.append(sample)
        while len(self._samples) > 2 and self._samples[1].stamp < sample.stamp - MOMENT * SECOND:
            self._samples.popleft()

    def forget(self) -> None:
        """What comes next may be of another arm."""
        self._samples.clear()

    def take(self) -> str:
        """Take the pose of the moment; it is on disk when this returns. Says which it is.

        Raises:
            TakeError: the arm moves, or nothing has come of it.
        """
        posture = self._posture()
        newest = self._samples[-1]
        if self._poses and cdr.stamp_of(self._poses[-1]) == newest.stamp:
            raise TakeError('no joint state has come since the last pose')
        pose = cdr.probing_pose(
            newest.stamp,
            self._arm.base_frame,
            *self._told(posture),
            posture,
            np.zeros(3),
            len(self._samples),
        )
        self._recorder.pose(cdr.encode(pose), self._wall())
        self._recorder.commit()
        self._poses.append(pose)
        self.tally.taken += 1
        return f'pose {self.tally.taken} taken{self._remark()}'

    def undo(self) -> str:
        """Take back the last pose; says which it was.

        Raises:
            TakeError: there is none of this session.
        """
        if not self._poses:
            raise TakeError('nothing was taken that could be taken back')
        data = cdr.encode(self._poses.pop())
        self._recorder.undone(data, self._wall())
        self._undone(data)
        self.tally.taken -= 1
        self.tally.undone += 1
        return f'pose {self.tally.taken + 1} taken back, {self.tally.taken} left'

    def _posture(self) -> Array:
        if not self._samples or self._clock() - self._heard > OLD:
            raise TakeError('no joint states from the arm')
        first, last = self._samples[0], self._samples[-1]
        if first is last:
            raise TakeError('a single joint state does not tell whether the arm is held still')
        seconds = (last.stamp - first.stamp) / SECOND
        speed = float(np.abs(last.joints - first.joints).max()) / seconds
        if speed > FASTEST:
            raise TakeError(f'the arm moves at {speed:.2f} rad/s: hold it still')
        return held_posture(np.array([sample.joints for sample in self._samples]))

    def _remark(self) -> str:
        """What the operator should know of it."""
        joints = np.array([pose.joint_position for pose in self._poses])
        if len(joints) > 1 and np.abs(joints[-1] - joints[-2]).max() < AGAIN:
            return ': the arm stands as it did for the one before, lead it to another posture'
        if len(joints) < ENOUGH:
            return ''
        place = sockets(self._arm, self._probe, joints)
        mine = sum(each == place[-1] for each in place)
        return f', {mine} in this socket, one of {len(set(place))} so far'


class TakingSession:
    """Records the joint states; the poses are those that its `taker` is asked for.

    `clock` gives seconds, `wall` ns for the bag. It has finished after `silence` s without a
    message.
    """

    def __init__(
        self,
        taker: PoseTaker,
        recorder: Recorder,
        clock: Callable[[], float],
        wall: Callable[[], int],
        silence: float,
    ) -> None:
        self.taker = taker
        self.recorder = recorder
        self.run = TakingRun()
        self._clock, self._wall, self._silence = clock, wall, silence
        self._heard = clock()

    @property
    def tally(self) -> TakenTally:
        """How it is going."""
        return self.taker.tally

    @property
    def poses(self) -> list[TakenByHand]:
        """All poses so far."""
        return self.taker.poses

    @property
    def finished(self) -> bool:
        """Whether the joint states have ended."""
        return self._clock() - self._heard > self._silence

    def take_joints(self, sample: JointSample, raw: bytes) -> None:
        """A joint state has come; `raw` are its CDR bytes."""
        self._heard = self._clock()
        self.recorder.raw(JOINT_STATES, raw, self._wall())
        self.taker.see(sample)

    def take_reading(self, _: Reading, raw: bytes) -> None:
        """A reading has come after all: it is recorded, and says nothing here."""
        self.recorder.raw(PROBE_DISPLACEMENTS, raw, self._wall())

    def start_over(self, _: Topic) -> None:
        """A message has come that may be of another arm than the bag's: it is left out."""
        self._heard = self._clock()
        self.taker.forget()

    def tick(self) -> None:
        """Nothing is due without a message."""

    def finish(self) -> None:
        """Nothing is left over."""

    def remarks(self) -> str:
        """What there is to say at the end, beside the counts."""
        return ''
