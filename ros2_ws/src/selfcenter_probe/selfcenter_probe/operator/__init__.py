# SPDX-License-Identifier: Apache-2.0
"""The simulated hand that guides a measuring arm around the gauge."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from selfcenter_probe.operator.motion import (
        LIFT as LIFT,
        TICK as TICK,
        HandMotion as HandMotion,
        MotionSettings as MotionSettings,
        guided as guided,
    )
    from selfcenter_probe.operator.path import (
        LIMIT_MARGIN as LIMIT_MARGIN,
    )
    from selfcenter_probe.operator.raw_bag import (
        write_raw as write_raw,
    )
    from selfcenter_probe.operator.readings import (
        HandGuided as HandGuided,
        RawStretch as RawStretch,
        probing_set as probing_set,
    )
    from selfcenter_probe.operator.scene import (
        FILES as FILES,
        Scene as Scene,
        read_scene as read_scene,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
