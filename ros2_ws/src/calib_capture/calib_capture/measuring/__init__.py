# SPDX-License-Identifier: Apache-2.0
"""A program as it is gone through: which pose is next, how the arm gets there, what came of it."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.measuring.commanded_motion import (
        AUTO as AUTO,
        JOINTS as JOINTS,
        NONE as NONE,
    )
    from calib_capture.measuring.locations import (
        EndedLocation as EndedLocation,
    )
    from calib_capture.measuring.measuring_run import (
        MeasuringRun as MeasuringRun,
    )
    from calib_capture.measuring.pose_queue import (
        TakenPose as TakenPose,
    )
    from calib_capture.measuring.run_settings import (
        RunError as RunError,
        RunSettings as RunSettings,
        SourceError as SourceError,
    )
    from calib_capture.measuring.tally import (
        Tally as Tally,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
