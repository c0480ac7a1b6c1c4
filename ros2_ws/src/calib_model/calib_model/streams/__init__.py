# SPDX-License-Identifier: Apache-2.0
"""What recorded streams may suffer from: stamps that tell no time, joints that repeat or wrap."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.streams.repeats import (
        Freshness as Freshness,
        freshness as freshness,
    )
    from calib_model.streams.rivals import (
        rival as rival,
    )
    from calib_model.streams.spread_joints import (
        Part as Part,
        put_together as put_together,
    )
    from calib_model.streams.stamping import (
        tell_no_time as tell_no_time,
    )
    from calib_model.streams.turns import (
        Turns as Turns,
        unwrapped as unwrapped,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
