# SPDX-License-Identifier: Apache-2.0
"""The bag of a hand-guided arm with its raw streams in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from heapq import merge
from pathlib import Path
from typing import Any

from calib_model.bags import BagWriter, cdr, write_descriptions
from calib_model.measurement import Measurement
from calib_model.topics import CAPTURE_POSES, JOINT_STATES, PROBE_DISPLACEMENTS, Topic
from selfcenter_probe.operator.readings import HandGuided, RawStretch

Sent = tuple[int, int, Topic, Any]  # stamp in ns, order at the same stamp, topic, message


def write_raw(
    path: Path, measured: Measurement, hand: HandGuided, told: Callable[[int, int, str], None]
) -> None:
    """Joint states, readings and poses in time order; stamps become log times.

    Raises:
        BagError: there is something at `path` already, or it cannot be written.
    """
    poses = _poses(measured)
    waiting = next(poses, None)
    seatings = hand.motion.seatings
    with BagWriter(path, chunk_size=1 << 20) as bag:
        begin = seatings[0].begin
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, begin)
        done = 0
        for stretch in hand.raw():
            told(done, len(seatings), f'raw streams of seating {done + 1}')
            for sent in merge(_joints(measured, stretch), _readings(measured, stretch)):
                bag.write_message(sent[2], sent[3], sent[0])
                while waiting is not None and waiting[:2] <= sent[:2]:
                    bag.write_message(CAPTURE_POSES, waiting[3], waiting[0])
                    waiting = next(poses, None)
            done += int(stretch.stamp[-1] == seatings[done].end)


def _joints(measured: Measurement, stretch: RawStretch) -> Iterator[Sent]:
    frame, names = measured.arm.base_frame, list(measured.arm.joint_names)
    for stamp, q in zip(stretch.stamp.tolist(), stretch.joints, strict=True):
        yield stamp, 0, JOINT_STATES, cdr.joint_state(stamp, frame, names, q)


def _readings(measured: Measurement, stretch: RawStretch) -> Iterator[Sent]:
    read = stretch.readings
    for stamp, values, status in zip(
        read.stamp.tolist(), read.displacement, read.status, strict=True
    ):
        message = cdr.displacements(stamp, measured.probe.name, values, status)
        yield stamp, 1, PROBE_DISPLACEMENTS, message


def _poses(measured: Measurement) -> Iterator[Sent]:
    poses = measured.poses
    for i in range(len(poses)):
        stamp = int(poses.stamp[i])
        pose = cdr.probing_pose(
            stamp,
            measured.arm.base_frame,
            int(poses.location[i]),
            int(poses.sphere[i]),
            poses.joints[i],
            poses.displacement[i],
            int(poses.readings[i]),
        )
        yield stamp, 1, CAPTURE_POSES, pose
