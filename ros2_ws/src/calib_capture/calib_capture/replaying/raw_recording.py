# SPDX-License-Identifier: Apache-2.0
"""What a capture's bag holds to be paired again: descriptions, both streams, recorded poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib_model.bags import listed_topics
from calib_model.errors import BagError
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measurement import ProbingSet
from calib_model.pairing import ClockOffset, RecordedStreams, estimate_clock_offset, read_raw
from calib_model.progress import Pace, Progress
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, RawTopics


@dataclass(frozen=True)
class RawRecording:
    """Descriptions, streams as they were received, and the recorded poses, if there are any;
    `remarks` on how they were read."""

    arm: Arm
    probe: Probe
    gauge: Gauge
    streams: RecordedStreams
    poses: ProbingSet | None
    remarks: tuple[str, ...] = ()

    def clock(self) -> ClockOffset | None:
        """What the streams tell of the offset between their clocks."""
        # what a live estimate sees is put into no order
        ordered = [stretch.ordered(0.0) for stretch in self.streams.stretches()]
        return estimate_clock_offset(self.arm, self.probe, self.gauge, ordered)


def read_recording(
    path: Path, progress: Progress | None = None, stamps: str = 'auto'
) -> RawRecording:
    """The raw topics of a bag by the `stamps` that count, as `read_raw` says; `progress` hears how
    far it is.

    Raises:
        BagError: no bag, a topic missing or not readable, or a description that changes within it.
        DescriptionError: a description in the bag cannot be used.
    """
    topics = listed_topics(path)
    for topic in (JOINT_STATES, PROBE_DISPLACEMENTS):
        if topics and topic.name not in topics:
            raise BagError(f'{path}: no raw messages on {topic.name}, nothing to pair')
    pace = Pace(progress, f'reading {path}', 'MB', 1e6)
    bag = read_raw(path, RawTopics(), pace, with_poses=True, stamps=stamps)
    pace.end()
    arm, probe, gauge = bag.described.arm(), bag.described.probe(), bag.described.gauge()
    recorded = bag.recorded(arm.joint_names)
    return RawRecording(arm, probe, gauge, recorded, bag.poses, tuple(bag.lines))
