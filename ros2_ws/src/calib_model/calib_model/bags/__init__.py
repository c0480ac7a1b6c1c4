# SPDX-License-Identifier: Apache-2.0
"""Recordings, MCAP and SQLite: read, written, recovered."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.bags.cdr import (
        decode as decode,
        stamp_of as stamp_of,
    )
    from calib_model.bags.descriptions import (
        TEMPERATURE_NOTE as TEMPERATURE_NOTE,
        BagDescriptions as BagDescriptions,
        Temperature as Temperature,
        read_descriptions as read_descriptions,
        read_temperature as read_temperature,
        together as together,
    )
    from calib_model.bags.files import (
        bag_files as bag_files,
        left_aside as left_aside,
        listed_topics as listed_topics,
    )
    from calib_model.bags.measurement import (
        PoseMessages as PoseMessages,
        read_measurement as read_measurement,
        read_poses as read_poses,
    )
    from calib_model.bags.measurement_writer import (
        pose_message as pose_message,
        write_descriptions as write_descriptions,
        write_measurement as write_measurement,
        write_points as write_points,
    )
    from calib_model.bags.metadata import (
        Definition as Definition,
        FileAccount as FileAccount,
        metadata_yaml as metadata_yaml,
    )
    from calib_model.bags.points import (
        has_points as has_points,
        read_point_messages as read_point_messages,
        read_points as read_points,
    )
    from calib_model.bags.reader import (
        BagMessage as BagMessage,
        Told as Told,
        cut_files as cut_files,
        read_messages as read_messages,
        read_note as read_note,
        read_notes as read_notes,
    )
    from calib_model.bags.record_reader import (
        MAGIC as MAGIC,
    )
    from calib_model.bags.recovery import (
        recover as recover,
        repair as repair,
    )
    from calib_model.bags.writer import (
        BagWriter as BagWriter,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
