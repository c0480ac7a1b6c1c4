# SPDX-License-Identifier: Apache-2.0
"""Finished calibrations: held against new poses, against limits and against one another."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.acceptance.history import (
        History as History,
        compare as compare,
        history_lines as history_lines,
    )
    from calib_solver.acceptance.new_report import (
        report_anew as report_anew,
    )
    from calib_solver.acceptance.pages import (
        write_comparison as write_comparison,
        write_verification as write_verification,
    )
    from calib_solver.acceptance.point_verification import (
        PointVerification as PointVerification,
    )
    from calib_solver.acceptance.verdict import (
        FAILED as FAILED,
    )
    from calib_solver.acceptance.verification import (
        Verification as Verification,
        verification_lines as verification_lines,
        verify as verify,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
