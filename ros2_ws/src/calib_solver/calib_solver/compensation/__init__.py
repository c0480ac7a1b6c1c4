# SPDX-License-Identifier: Apache-2.0
"""Putting a calibration to use: joint commands, the user's URDF, controller figures."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.compensation.calibrated_arm import (
        Calibrated as Calibrated,
        read_calibrated as read_calibrated,
        tip as tip,
    )
    from calib_solver.compensation.inverse_kinematics import (
        Targets as Targets,
    )
    from calib_solver.compensation.joint_commands import (
        Compensated as Compensated,
        compensate_joints as compensate_joints,
        compensate_targets as compensate_targets,
    )
    from calib_solver.compensation.kuka import (
        ControllerFigures as ControllerFigures,
        abc as abc,
        controller_figures as controller_figures,
        counted_as as counted_as,
        figures_text as figures_text,
        shown as shown,
    )
    from calib_solver.compensation.tables import (
        Finished as Finished,
        compensate_file as compensate_file,
        rows_of as rows_of,
    )
    from calib_solver.compensation.target_table import (
        FARTHEST as FARTHEST,
        TargetTable as TargetTable,
        joints_csv as joints_csv,
        read_targets as read_targets,
    )
    from calib_solver.compensation.universal_robots import (
        driver_yaml as driver_yaml,
    )
    from calib_solver.compensation.user_urdf import (
        corrected_urdf as corrected_urdf,
        refuse_uncorrectable as refuse_uncorrectable,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
