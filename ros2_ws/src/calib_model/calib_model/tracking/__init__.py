# SPDX-License-Identifier: Apache-2.0
"""Which posture a tracker's point was measured in: live, and from a recording."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.tracking.recorded_points import (
        TrackedBag as TrackedBag,
        read_tracked as read_tracked,
    )
    from calib_model.tracking.standing import (
        MISSING as MISSING,
        MOVES as MOVES,
        StandingSettings as StandingSettings,
        posture_at as posture_at,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
