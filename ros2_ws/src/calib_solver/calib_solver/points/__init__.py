# SPDX-License-Identifier: Apache-2.0
"""Eq. 10 for points of targets on the flange that a tracker measured: no gauge, no probe."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.points.identification import (
        checked_point_options as checked_point_options,
        identify_points as identify_points,
    )
    from calib_solver.points.identified import (
        Placed as Placed,
        PointIdentification as PointIdentification,
    )
    from calib_solver.points.joining import (
        held_out_points as held_out_points,
        joined_points as joined_points,
    )
    from calib_solver.points.place_shares import (
        PlaceShares as PlaceShares,
        StationShare as StationShare,
    )
    from calib_solver.points.places import (
        Flange as Flange,
        Places as Places,
        motions as motions,
    )
    from calib_solver.points.point_noise import (
        moved_by_joints as moved_by_joints,
    )
    from calib_solver.points.point_sums import (
        point_slopes as point_slopes,
    )
    from calib_solver.points.problem import (
        FLANGE as FLANGE,
        PointProblem as PointProblem,
    )
    from calib_solver.points.quality import (
        HeldOutPoints as HeldOutPoints,
        PointQuality as PointQuality,
        fitted_quality as fitted_quality,
        flange_of as flange_of,
        known_quality as known_quality,
        refuse_unknown_targets as refuse_unknown_targets,
    )
    from calib_solver.points.solver import (
        PlacedQuadratic as PlacedQuadratic,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
