# SPDX-License-Identifier: Apache-2.0
"""From the arm and the probe to a bag of probing poses: planned, driven, paired, recorded."""

from typing import TYPE_CHECKING

from calib_model.blas_threads import ask_for_one_thread
from calib_model.lazy import lazily

# the matrices are small
ask_for_one_thread()

if TYPE_CHECKING:
    from calib_capture.motion import (
        CollisionCheck as CollisionCheck,
        InverseKinematics as InverseKinematics,
        PinocchioArm as PinocchioArm,
        Trajectory as Trajectory,
    )
    from calib_capture.program import (
        Planner as Planner,
        Program as Program,
        ProgramSettings as ProgramSettings,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
