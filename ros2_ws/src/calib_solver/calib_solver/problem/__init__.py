# SPDX-License-Identifier: Apache-2.0
"""Poses sorted by sphere, and the sums over them in one compiled pass."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.problem.gauge_placement import (
        place_gauge as place_gauge,
    )
    from calib_solver.problem.kernel import (
        threads as threads,
    )
    from calib_solver.problem.problem import (
        IntArray as IntArray,
        Problem as Problem,
    )
    from calib_solver.problem.sphere_sums import (
        SphereSums as SphereSums,
        accumulate as accumulate,
        accumulate_by as accumulate_by,
        accumulate_numpy as accumulate_numpy,
        by_joint as by_joint,
        point_jacobian as point_jacobian,
    )
    from calib_solver.problem.subproblem import (
        gathered as gathered,
        location_folds as location_folds,
        merged_sums as merged_sums,
        take_groups as take_groups,
        without as without,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
