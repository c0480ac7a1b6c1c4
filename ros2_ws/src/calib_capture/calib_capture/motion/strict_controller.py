# SPDX-License-Identifier: Apache-2.0
"""A simulated arm behind a controller: it takes what joint_trajectory_controller takes, and stops
with a fault where an industrial arm would."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calib_capture.motion.interpolated_motion import Fault, InterpolatedMotion, MotionState
from calib_capture.motion.limits import MotionLimits
from calib_capture.motion.trajectory import Trajectory, TrajectoryError
from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.stamps import SECOND


class StrictController:
    """The commanded state of an arm in its own time, ns, that begins at `start` (n,).

    After a fault it stands where that happened and takes nothing more. `tell` hears of it.
    """

    def __init__(
        self,
        arm: Arm,
        limits: MotionLimits,
        now: int,
        tell: Callable[[str], None],
        start: Array | None = None,
    ) -> None:
        self._names, self._limits, self._tell = arm.joint_names, limits, tell
        self._motion = InterpolatedMotion.resting(arm.zero if start is None else start)
        self._began = now
        self._fault: Fault | None = None
        self.failed = ''  # what stopped the arm for good

    def follow(self, trajectory: Trajectory, now: int, start: int = 0) -> None:
        """Take on a trajectory in place of what is left of the one before; it begins `now` or, if
        given, at the stamp `start`, which may be past.

        Raises:
            TrajectoryError: it is over already, or the arm has failed.
        """
        if self.failed:
            raise TrajectoryError(f'the arm has failed ({self.failed}): start it anew')
        late = (start - now) / SECOND if start else 0.0
        if trajectory.duration + late < 0:
            raise TrajectoryError('a trajectory that ends in the past')
        shifted = Trajectory(
            trajectory.seconds + late,
            trajectory.positions,
            trajectory.velocities,
            trajectory.accelerations,
        )
        self._motion = InterpolatedMotion(self.at(now), shifted)
        self._began = now
        self._fault = self._motion.first_fault(self._limits, self._names)

    def hold(self, now: int) -> None:
        """Stay where it is, at once: a jump of velocity where it moves."""
        if not self.failed:
            here = self.at(now).position
            self.follow(Trajectory(np.zeros(1), here[None]), now)

    def at(self, stamp: int) -> MotionState:
        """What is commanded at a stamp; a fault that is due by then happens."""
        seconds = (stamp - self._began) / SECOND
        if self._fault is not None and seconds >= self._fault.seconds:
            self.failed, where = self._fault.words, self._motion.at(self._fault.seconds)
            self._motion, self._fault = InterpolatedMotion.resting(where.position), None
            self._tell(f'FAULT {self.failed}: the arm has stopped, start it anew')
        return self._motion.at(seconds)

    def busy(self, stamp: int) -> bool:
        """Whether a trajectory is still under way."""
        return not self.failed and (stamp - self._began) / SECOND < self._motion.duration

    def instants(self) -> NDArray[np.int64]:
        """Stamps (K,) that a stepped simulation looks at, from the start of the motion on."""
        seconds = self._motion.instants()
        if self._fault is not None:
            seconds = np.append(seconds[seconds < self._fault.seconds], self._fault.seconds)
        stamps: NDArray[np.int64] = self._began + np.round(seconds * SECOND).astype(np.int64)
        return stamps
