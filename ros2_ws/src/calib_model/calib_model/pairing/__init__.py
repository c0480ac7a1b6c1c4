# SPDX-License-Identifier: Apache-2.0
"""Joints with probe readings: of an arm that stops, of one guided by hand, across two clocks."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.pairing.clock_offset import (
        WAITING as WAITING,
        ClockEstimate as ClockEstimate,
        ClockOffset as ClockOffset,
        estimate_clock_offset as estimate_clock_offset,
    )
    from calib_model.pairing.from_streams import (
        pair_streams as pair_streams,
    )
    from calib_model.pairing.hand_guided import (
        BRIDGED as BRIDGED,
        NO_SPHERE as NO_SPHERE,
        NO_TOUCH as NO_TOUCH,
        UNSURE as UNSURE,
        HandGuidedPairing as HandGuidedPairing,
        HandGuidedSettings as HandGuidedSettings,
        PairedReading as PairedReading,
        travel as travel,
    )
    from calib_model.pairing.raw_topics import (
        RawTopics as RawTopics,
    )
    from calib_model.pairing.settings_record import (
        NOTE as NOTE,
        PAIRING as PAIRING,
        note_of as note_of,
        noted_number as noted_number,
        settings_of as settings_of,
    )
    from calib_model.pairing.stop_and_go import (
        JointSample as JointSample,
        Outcome as Outcome,
        Pairing as Pairing,
        Reading as Reading,
        Reason as Reason,
        Refusal as Refusal,
        SteadyPose as SteadyPose,
        SteadySettings as SteadySettings,
        usable as usable,
    )
    from calib_model.pairing.streams import (
        read_raw as read_raw,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
