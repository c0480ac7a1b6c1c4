# SPDX-License-Identifier: Apache-2.0
"""Errors beyond D-H, kept where held-out locations gain: joint errors, eq. 12."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.error_models.correction import (
        CorrectionChoice as CorrectionChoice,
        CorrectionColumns as CorrectionColumns,
        best_basis as best_basis,
        checked_choice as checked_choice,
        fit_correction as fit_correction,
        too_few as too_few,
    )
    from calib_solver.error_models.joint_errors import (
        JointErrorChoice as JointErrorChoice,
        checked_kinds as checked_kinds,
        choose_joint_errors as choose_joint_errors,
        chosen_by as chosen_by,
        chosen_kinds as chosen_kinds,
        table_with as table_with,
    )
    from calib_solver.error_models.validation_gain import (
        FEWEST_LOCATIONS as FEWEST_LOCATIONS,
        Gain as Gain,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
