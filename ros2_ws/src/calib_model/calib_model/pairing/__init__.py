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
        Paired as Paired,
        pair_streams as pair_streams,
        recorded_outcomes as recorded_outcomes,
    )
    from calib_model.pairing.hand_guided import (
        HandGuidedPairing as HandGuidedPairing,
    )
    from calib_model.pairing.interpolation import (
        JointsAt as JointsAt,
        interpolated as interpolated,
    )
    from calib_model.pairing.paired_readings import (
        BRIDGED as BRIDGED,
        OUT_OF_ORDER as OUT_OF_ORDER,
        REASONS as REASONS,
        UNSURE as UNSURE,
        Gaps as Gaps,
        HandGuidedSettings as HandGuidedSettings,
        PairedReading as PairedReading,
        PairedReadings as PairedReadings,
        pair_readings as pair_readings,
        paired_parts as paired_parts,
    )
    from calib_model.pairing.raw_bag import (
        RawBag as RawBag,
        read_raw as read_raw,
    )
    from calib_model.pairing.readings import (
        JointSample as JointSample,
        Reading as Reading,
        Reason as Reason,
        Status as Status,
        reasons_in_words as reasons_in_words,
        usable as usable,
    )
    from calib_model.pairing.settings_record import (
        HAND_GUIDED_NOTE as HAND_GUIDED_NOTE,
        NOTE as NOTE,
        hand_guided_settings_of as hand_guided_settings_of,
        note_of as note_of,
        noted_number as noted_number,
        settings_of as settings_of,
    )
    from calib_model.pairing.spaced_poses import (
        SpacedPoses as SpacedPoses,
    )
    from calib_model.pairing.stop_and_go import (
        NOISIEST as NOISIEST,
        Outcome as Outcome,
        Pairing as Pairing,
        Refusal as Refusal,
        SteadyPose as SteadyPose,
        SteadySettings as SteadySettings,
    )
    from calib_model.pairing.stream_columns import (
        joint_layout as joint_layout,
        little_endian as little_endian,
    )
    from calib_model.pairing.streams import (
        RawStreams as RawStreams,
        RecordedStreams as RecordedStreams,
        Rows as Rows,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
