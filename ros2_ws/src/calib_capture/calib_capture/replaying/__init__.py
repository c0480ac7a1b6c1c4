# SPDX-License-Identifier: Apache-2.0
"""A recorded bag paired again, or played back."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.replaying.pair_hand_guided import (
        PairedHandGuided as PairedHandGuided,
        pair_recorded_guidance as pair_recorded_guidance,
    )
    from calib_capture.replaying.pair_program import (
        Repeated as Repeated,
        read_raw as read_raw,
        repeat_pairing as repeat_pairing,
    )
    from calib_capture.replaying.playback import (
        OfferedQos as OfferedQos,
        Playback as Playback,
        Timing as Timing,
        offered_qos as offered_qos,
        read_playback as read_playback,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
