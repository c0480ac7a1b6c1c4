# SPDX-License-Identifier: Apache-2.0
"""Identification of a probe's place on the flange (eq. 15) and of an arm's parameters (eq. 11)."""

from typing import TYPE_CHECKING

from calib_model.blas_threads import ask_for_one_thread
from calib_model.lazy import lazily

# the matrices are small, and the compiled pass has its own threads
ask_for_one_thread()

if TYPE_CHECKING:
    from calib_solver.calibration import (
        Calibration as Calibration,
        Sources as Sources,
        calibrate as calibrate,
        load as load,
    )
    from calib_solver.compensation import (
        compensate_joints as compensate_joints,
        compensate_targets as compensate_targets,
    )
    from calib_solver.fitting import (
        Options as Options,
        Prior as Prior,
        fit_probe as fit_probe,
    )
    from calib_solver.held_out import (
        HeldOut as HeldOut,
    )
    from calib_solver.identification import (
        identify as identify,
    )
    from calib_solver.identified import (
        Identification as Identification,
    )
    from calib_solver.quality import (
        Quality as Quality,
        assess as assess,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
