# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo and bootstrap, over processes or a Dask cluster."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.resampling.cluster import (
        connected as connected,
    )
    from calib_solver.resampling.plan import (
        Plan as Plan,
        refuse_plan as refuse_plan,
        refuse_repetitions as refuse_repetitions,
    )
    from calib_solver.resampling.points import (
        resample_points as resample_points,
    )
    from calib_solver.resampling.processes import (
        Spread as Spread,
        in_processes as in_processes,
    )
    from calib_solver.resampling.resampling import (
        Repeated as Repeated,
        Resampled as Resampled,
        exact_centers as exact_centers,
        resample as resample,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
