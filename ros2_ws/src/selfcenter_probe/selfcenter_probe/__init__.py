# SPDX-License-Identifier: Apache-2.0
"""The self-centering probe, and the simulated world that it alone may see."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from selfcenter_probe.simulation import (
        Magnitudes as Magnitudes,
        ProbeSimulation as ProbeSimulation,
        World as World,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
