# SPDX-License-Identifier: Apache-2.0
"""What is wrong with the data: gross errors, mix-ups, the certificate; in words."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.faults.certificate import (
        certificate_warnings as certificate_warnings,
        named_numbers as named_numbers,
        named_scale as named_scale,
        refuse_other_units as refuse_other_units,
    )
    from calib_solver.faults.gross_errors import (
        Rejected as Rejected,
        without_gross_errors as without_gross_errors,
    )
    from calib_solver.faults.mirror import (
        mirroring_joints as mirroring_joints,
    )
    from calib_solver.faults.mixups import (
        far_from_nominal as far_from_nominal,
        named_joints as named_joints,
    )
    from calib_solver.faults.stuck_styli import (
        set_apart as set_apart,
        stuck_stretches as stuck_stretches,
    )
    from calib_solver.faults.warnings import (
        SMALL as SMALL,
        distance_warnings as distance_warnings,
        parameter_warnings as parameter_warnings,
        pose_warnings as pose_warnings,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
