# SPDX-License-Identifier: Apache-2.0
"""Poses sorted by sphere, and the sums over them in one compiled pass."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.problem.gauge_placement import (
        Placed as Placed,
        place_gauge as place_gauge,
    )
    from calib_solver.problem.kernel import (
        Points as Points,
        available as available,
        raw_point_sums as raw_point_sums,
        threads as threads,
    )
    from calib_solver.problem.problem import (
        IntArray as IntArray,
        Problem as Problem,
        Turned as Turned,
    )
    from calib_solver.problem.sphere_sums import (
        SphereSums as SphereSums,
        accumulate as accumulate,
        accumulate_by as accumulate_by,
        accumulate_numpy as accumulate_numpy,
        by_joint as by_joint,
        point_jacobian as point_jacobian,
        posture_jacobian as posture_jacobian,
    )
    from calib_solver.problem.subproblem import (
        Folds as Folds,
        gathered as gathered,
        merged_sums as merged_sums,
        take_groups as take_groups,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
