# SPDX-License-Identifier: Apache-2.0
"""Requests of the services: what may be reached, what is done, in processes that can be ended."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.serving.opened import (
        Opened as Opened,
    )
    from calib_solver.serving.residual_lines import (
        Residuals as Residuals,
        residuals as residuals,
    )
    from calib_solver.serving.work import (
        compare as compare,
        compensate as compensate,
        evaluate as evaluate,
        fit_probe as fit_probe,
        identify as identify,
        verify as verify,
    )
    from calib_solver.serving.workers import (
        AT_ONCE as AT_ONCE,
        WAITING as WAITING,
        Work as Work,
        Workers as Workers,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
