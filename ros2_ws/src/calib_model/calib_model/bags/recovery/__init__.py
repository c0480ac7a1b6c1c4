# SPDX-License-Identifier: Apache-2.0
"""Damaged and unfinished bags: what is whole in them, copied or made complete in its place."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.bags.recovery.recovered_bag import (
        recover as recover,
    )
    from calib_model.bags.recovery.repaired_bag import (
        repair as repair,
    )
    from calib_model.bags.recovery.whole_messages import (
        Recovery as Recovery,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
