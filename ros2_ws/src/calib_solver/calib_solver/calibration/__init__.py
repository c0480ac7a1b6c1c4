# SPDX-License-Identifier: Apache-2.0
"""From bags to files: what the commands and services run."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.calibration.calibration import (
        Calibration as Calibration,
        Effort as Effort,
        calibrate as calibrate,
    )
    from calib_solver.calibration.duplicate_poses import (
        duplicate_lines as duplicate_lines,
    )
    from calib_solver.calibration.evaluate import (
        evaluation_record as evaluation_record,
    )
    from calib_solver.calibration.fit_probe import (
        fit_probe_from as fit_probe_from,
    )
    from calib_solver.calibration.gauge_options import (
        add_gauge_arguments as add_gauge_arguments,
        given_temperature as given_temperature,
    )
    from calib_solver.calibration.points import (
        PointCalibration as PointCalibration,
        calibrate_points as calibrate_points,
        load_points as load_points,
    )
    from calib_solver.calibration.raw_options import (
        add_raw_arguments as add_raw_arguments,
        raw_settings as raw_settings,
    )
    from calib_solver.calibration.sources import (
        Sources as Sources,
        bag_list as bag_list,
        hold_points as hold_points,
        load as load,
        load_all as load_all,
        unread_lines as unread_lines,
    )
    from calib_solver.calibration.summary import (
        in_one_line as in_one_line,
        point_summary_text as point_summary_text,
        summary_text as summary_text,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
