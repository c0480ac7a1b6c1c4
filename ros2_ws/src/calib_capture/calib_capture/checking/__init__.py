# SPDX-License-Identifier: Apache-2.0
"""What is wrong with streams before they are believed: rates, clocks, units, signs, mounting."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.checking.contacts import (
        contact_of as contact_of,
        in_step as in_step,
    )
    from calib_capture.checking.finding import (
        DOUBTFUL as DOUBTFUL,
        OK as OK,
        WRONG as WRONG,
        Finding as Finding,
    )
    from calib_capture.checking.first_seconds import (
        FirstSeconds as FirstSeconds,
    )
    from calib_capture.checking.procedure import (
        Cell as Cell,
        Check as Check,
    )
    from calib_capture.checking.signs import (
        Told as Told,
        told_by as told_by,
    )
    from calib_capture.checking.small_motion import (
        SmallMove as SmallMove,
        small_moves as small_moves,
        small_turns_at as small_turns_at,
    )
    from calib_capture.checking.streams import (
        Heard as Heard,
        stream_findings as stream_findings,
    )
    from calib_capture.checking.units import (
        unit_findings as unit_findings,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
