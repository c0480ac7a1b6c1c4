# SPDX-License-Identifier: Apache-2.0
"""The true world, which nobody else may see: errors, encoders, readings, health."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from selfcenter_probe.simulation.encoders import (
        Encoders as Encoders,
    )
    from selfcenter_probe.simulation.health import (
        Health as Health,
        Report as Report,
    )
    from selfcenter_probe.simulation.magnitudes import (
        ArmMagnitudes as ArmMagnitudes,
        GaugeMagnitudes as GaugeMagnitudes,
        HandMagnitudes as HandMagnitudes,
        Magnitudes as Magnitudes,
        parse_magnitudes as parse_magnitudes,
    )
    from selfcenter_probe.simulation.readings import (
        ProbeSimulation as ProbeSimulation,
        Readings as Readings,
        probe_postures as probe_postures,
    )
    from selfcenter_probe.simulation.world import (
        World as World,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
