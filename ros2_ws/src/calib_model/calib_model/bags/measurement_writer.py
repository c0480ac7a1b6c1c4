# SPDX-License-Identifier: Apache-2.0
"""A whole measurement written to a bag of its own: probing poses, or measured points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib_model.bags import cdr
from calib_model.bags.writer import BagWriter
from calib_model.descriptions import arm_yaml, gauge_yaml, probe_yaml
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measured_points import PointMeasurement
from calib_model.measurement import Measurement
from calib_model.progress import Progress, paced
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS, CAPTURE_POSES, DESCRIPTIONS


def write_descriptions(bag: BagWriter, arm: Arm, probe: Probe, gauge: Gauge, time: int) -> None:
    """Put the three descriptions into a bag, as the latched topics give them (time in ns)."""
    texts = (arm_yaml(arm), probe_yaml(probe), gauge_yaml(gauge))
    for topic, text in zip(DESCRIPTIONS, texts, strict=True):
        bag.write_message(topic, cdr.string(text), time)


def write_measurement(
    path: str | Path,
    measured: Measurement,
    progress: Progress | None = None,
    notes: Mapping[str, dict[str, str]] | None = None,
) -> None:
    """A measurement as a bag of its own, with `notes` by name; stamps become log times. `progress`
    hears how far it is.

    Raises:
        BagError: there is something at `path` already, or it cannot be written.
    """
    poses = measured.poses
    with BagWriter(path, chunk_size=1 << 20) as bag:
        start = int(poses.stamp[0]) if len(poses) else 0
        for name, content in (notes or {}).items():
            bag.note(name, content)
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, start)
        for i in paced(range(len(poses)), progress, f'writing {path}', 'poses', 256):
            bag.write_message(CAPTURE_POSES, pose_message(measured, i), int(poses.stamp[i]))


def pose_message(measured: Measurement, row: int) -> Any:
    """The pose in a row of a measurement as /capture/poses has it."""
    poses = measured.poses
    return cdr.probing_pose(
        int(poses.stamp[row]),
        measured.arm.base_frame,
        int(poses.location[row]),
        int(poses.sphere[row]),
        poses.joints[row],
        poses.displacement[row],
        int(poses.readings[row]),
    )


def write_points(
    path: str | Path, measured: PointMeasurement, progress: Progress | None = None
) -> None:
    """Points as a bag of their own; stamps become log times.

    Raises:
        BagError: there is something at `path` already, or it cannot be written.
    """
    points = measured.points
    with BagWriter(path, chunk_size=1 << 20) as bag:
        start = int(points.stamp[0]) if len(points) else 0
        bag.write_message(ARM_DESCRIPTION, cdr.string(arm_yaml(measured.arm)), start)
        for i in paced(range(len(points)), progress, f'writing {path}', 'points', 256):
            stamp = int(points.stamp[i])
            message = cdr.measured_point(
                stamp,
                f'station_{points.station[i]}',
                str(points.target[i]),
                int(points.station[i]),
                points.joints[i],
                points.position[i],
                points.orientation[i],
                float(points.sigma[i]),
            )
            bag.write_message(CAPTURE_POINTS, message, stamp)
