# SPDX-License-Identifier: Apache-2.0
"""Between the simulation's arrays and the messages of the graph."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from calib_interfaces.msg import StylusDisplacements
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from calib_model.arrays import Array
from calib_model.stamps import SECOND
from selfcenter_probe.simulation import Readings, Report


def displacements(readings: Readings, frame: str) -> Iterator[StylusDisplacements]:
    """The readings' messages in their order: one object, filled anew, to be published at once.

    Making one for every reading would take as long as publishing it.
    """
    message = StylusDisplacements(header=Header(frame_id=frame))
    for stamp, displacement, status in zip(
        readings.stamp.tolist(), readings.displacement, readings.status, strict=True
    ):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        message.displacement = displacement
        message.status = status
        yield message


def joint_states(
    stamps: NDArray[np.int64], joints: Array, names: Sequence[str], frame: str
) -> Iterator[JointState]:
    """Joint states at stamps (M,), ns, with joints (M, n), rad: one object, as above."""
    message = JointState(header=Header(frame_id=frame), name=list(names))
    for stamp, q in zip(stamps.tolist(), joints, strict=True):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        message.position = q.tolist()
        yield message


def diagnostics(report: Report, probe: str, stamp: int) -> DiagnosticArray:
    """The health of the named probe at a stamp in ns."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    header = Header()
    header.stamp.sec, header.stamp.nanosec = seconds, nanoseconds
    status = DiagnosticStatus(
        level=bytes([report.level]),
        name=f'probe: {probe}',
        message=report.message,
        hardware_id=probe,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )
    return DiagnosticArray(header=header, status=[status])
