# SPDX-License-Identifier: Apache-2.0
"""How the poses of a run are commanded, and how long they are waited for."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib_capture.measuring.commanded_motion import AUTO, LEAD
from calib_capture.motion import ACCELERATION, JERK, MotionLimits, motion_limits
from calib_capture.program import Program, motion_seconds
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm

RESERVE = 0.85  # of acceleration and jerk is planned with: a stop may need the rest


class RunError(CalibrationError):
    """A measuring run that cannot go on."""


class SourceError(RunError):
    """A run that cannot go on because of who publishes, however well."""


@dataclass(frozen=True)
class RunSettings:
    """How poses are commanded: `batch` at a time, each held for `hold` s.

    `speed` is the share of the joints' largest speeds at which the arm goes from pose to pose,
    `approach_speed` (m/s) how fast it comes to a sphere and leaves it along the probe's axis;
    `acceleration` (rad/s^2) and `jerk` (rad/s^3) are the limits of joints whose description has
    none.

    `answer_timeout` (s of the wall clock) after the last sign of life the poses of a batch that
    have no outcome get none; `give_up` (s) without any accepted or refused pose ends the run.
    `tolerance` (rad) is how near to the planned joints a stop must be to be that pose's. A pose is
    tried up to `attempts` times.
    Where the gauge is `carried` from location to location, the arm waits for it out of its way.
    `stamps` says whose clock tells when a trajectory begins.
    """

    batch: int = 7
    hold: float = 0.06
    speed: float = 0.3
    approach_speed: float = 0.1
    acceleration: float = ACCELERATION
    jerk: float = JERK
    answer_timeout: float = 3.0
    give_up: float = 30.0
    tolerance: float = 2e-3
    attempts: int = 2
    carried: bool = False
    stamps: str = AUTO

    def whole_limits(self, arm: Arm) -> MotionLimits:
        """What the arm can do."""
        return motion_limits(arm, self.acceleration, self.jerk)

    def limits(self, arm: Arm) -> MotionLimits:
        """What motion is planned with."""
        return self.whole_limits(arm).share(self.speed, RESERVE, RESERVE)

    def timed(self, program: Program, arm: Arm) -> Program:
        """The program with how long it takes when it is commanded so."""
        moving = motion_seconds(
            program, self.limits(arm), self.approach_speed, self.hold, self.batch
        )
        commands = -(-len(program.poses) // self.batch)
        return replace(program, seconds=moving + LEAD * commands)
