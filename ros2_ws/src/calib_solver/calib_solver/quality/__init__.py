# SPDX-License-Identifier: Apache-2.0
"""Distance errors and 2 sigma (Fig. 6), tests of measuring arms."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.quality.assessment import (
        COORDINATES as COORDINATES,
        ProbedSpheres as ProbedSpheres,
        Quality as Quality,
        assess as assess,
        probed_points as probed_points,
    )
    from calib_solver.quality.measuring_arm import (
        BASIS as BASIS,
        articulation as articulation,
        lengths as lengths,
    )
    from calib_solver.quality.standards import (
        STANDARDS_BASIS as STANDARDS_BASIS,
        standard_figures as standard_figures,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
