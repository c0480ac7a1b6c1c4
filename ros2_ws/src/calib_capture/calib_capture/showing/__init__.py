# SPDX-License-Identifier: Apache-2.0
"""How a run is going, to be seen: shapes, counts and 2 sigma."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.showing.markers import (
        SPHERES as SPHERES,
        Color as Color,
        Marker as Marker,
        gauge_markers as gauge_markers,
        outcome_markers as outcome_markers,
        program_markers as program_markers,
    )
    from calib_capture.showing.refusal_news import (
        RefusalNews as RefusalNews,
    )
    from calib_capture.showing.running_quality import (
        RunningQuality as RunningQuality,
        SphereScatter as SphereScatter,
    )
    from calib_capture.showing.sphere_progress import (
        HandGuidedProgress as HandGuidedProgress,
        RunProgress as RunProgress,
        SphereProgress as SphereProgress,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
