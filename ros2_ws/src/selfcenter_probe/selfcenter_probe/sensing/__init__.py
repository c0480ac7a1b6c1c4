# SPDX-License-Identifier: Apache-2.0
"""From a sphere in contact to displacements: styli, LED and PSD."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from selfcenter_probe.sensing.contact import (
        Contact as Contact,
        Status as Status,
        seat as seat,
        touch as touch,
    )
    from selfcenter_probe.sensing.psd import (
        PsdDesign as PsdDesign,
        Psds as Psds,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
