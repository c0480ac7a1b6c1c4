# SPDX-License-Identifier: Apache-2.0
"""One measuring run from streams to bag: pairing, run and recorder put together."""

from __future__ import annotations

from collections.abc import Callable

from calib_capture.recorder import Recorder
from calib_capture.run import MeasuringRun, Tally
from calib_capture.trajectory import Trajectory
from calib_model import cdr
from calib_model.pairing import JointSample, Outcome, Pairing, Reading
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS

Clock = Callable[[], float]
SAVE_WITHIN = 0.02  # s: accepted poses that come closer together share a flush


class CaptureSession:
    """Feeds both streams to the pairing and the bag, and the outcomes to the run.

    `command` is called with each next trajectory; `clock` gives seconds, `wall` ns for the bag.
    """

    def __init__(
        self, run: MeasuringRun, pairing: Pairing, recorder: Recorder, frame: str,
        command: Callable[[Trajectory], None], clock: Clock, wall: Callable[[], int],
    ) -> None:  # fmt: skip
        self.run = run
        self.pairing = pairing
        self.recorder = recorder
        self._frame = frame
        self._command = command
        self._clock = clock
        self._wall = wall
        self._unsaved_since: float | None = None
        self.outcomes: list[Outcome] = []  # of all stops so far, to be shown

    @property
    def finished(self) -> bool:
        """Whether every pose has been taken or given up."""
        return self.run.finished

    @property
    def tally(self) -> Tally:
        """How the run is going."""
        return self.run.tally

    def take_joints(self, sample: JointSample, raw: bytes) -> None:
        """A joint state has come; `raw` are its CDR bytes."""
        self.recorder.raw(JOINT_STATES, raw, self._wall())
        self.run.see(sample.joints, sample.stamp, self._clock())
        self._go_on(self.pairing.add_joints(sample))

    def take_reading(self, reading: Reading, raw: bytes) -> None:
        """A probe reading has come; `raw` are its CDR bytes."""
        self.recorder.raw(PROBE_DISPLACEMENTS, raw, self._wall())
        self._go_on(self.pairing.add_reading(reading))

    def tick(self) -> None:
        """Do what is due without a message: save, give up waiting, command.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        now = self._clock()
        if self.run.overdue(now):
            self._take(self.pairing.finish())
            self.run.close_batch(now)
        self._save()
        self._go_on([])

    def _go_on(self, outcomes: list[Outcome]) -> None:
        self._take(outcomes)
        trajectory = self.run.next_trajectory(self._clock())
        if trajectory is not None:
            self._command(trajectory)
        waited = self._unsaved_since is not None and self._clock() - self._unsaved_since
        if trajectory is not None or self.run.finished or (waited and waited > SAVE_WITHIN):
            self._save()

    def _take(self, outcomes: list[Outcome]) -> None:
        self.outcomes += outcomes
        for outcome in outcomes:
            taken = self.run.take(outcome, self._clock())
            if taken is None:
                continue
            planned, measured = taken.planned, taken.measured
            message = cdr.probing_pose(
                measured.stamp, self._frame, planned.location, planned.sphere,
                measured.joints, measured.displacement, measured.readings,
            )  # fmt: skip
            self.recorder.pose(cdr.encode(message), self._wall())
            self._unsaved_since = self._unsaved_since or self._clock()

    def _save(self) -> None:
        self.recorder.commit()
        self._unsaved_since = None
