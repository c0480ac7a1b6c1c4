# SPDX-License-Identifier: Apache-2.0
"""A recorded bag paired again, or played back."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.replaying.pair_hand_guided import (
        PairedHandGuided as PairedHandGuided,
        paired_hand_guided as paired_hand_guided,
    )
    from calib_capture.replaying.pair_program import (
        PairedProgram as PairedProgram,
        paired_program as paired_program,
    )
    from calib_capture.replaying.playback import (
        OfferedQos as OfferedQos,
        Playback as Playback,
        Timing as Timing,
        offered_qos as offered_qos,
        read_playback as read_playback,
    )
    from calib_capture.replaying.raw_recording import (
        RawRecording as RawRecording,
        read_recording as read_recording,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
