# SPDX-License-Identifier: Apache-2.0
"""Errors beyond D-H, kept where held-out locations gain: joint errors, eq. 12."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.error_models.correction import (
        CorrectionChoice as CorrectionChoice,
        checked_choice as checked_choice,
        fit_correction as fit_correction,
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
        Gain as Gain,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
