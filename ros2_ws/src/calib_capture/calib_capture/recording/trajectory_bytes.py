# SPDX-License-Identifier: Apache-2.0
"""Trajectories as their messages' CDR bytes: all points in one go, where rclpy takes each by hand.

A trajectory_msgs/msg/JointTrajectory of some hundred points costs rclpy milliseconds on both sides,
and a stepped simulation lives on such messages.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from calib_capture.motion import Trajectory
from calib_model.arrays import frozen
from calib_model.stamps import SECOND

HEAD = b'\x00\x01\x00\x00'  # little endian, plain CDR


def trajectory_cdr(names: Sequence[str], trajectory: Trajectory) -> bytes:
    """The message of a trajectory with velocities and accelerations, and its stamp if any."""
    v, a = trajectory.velocities, trajectory.accelerations
    assert v is not None and a is not None
    count, n = trajectory.positions.shape
    body = _before_points(names, trajectory.stamp) + struct.pack('<I', count)
    points = np.zeros(count, dtype=_point(n))
    stamps = np.round(trajectory.seconds * SECOND).astype(np.int64)
    points['counts_p'] = points['counts_v'] = points['counts_a'] = n
    points['p'], points['v'], points['a'] = trajectory.positions, v, a
    points['sec'], points['nanosec'] = stamps // SECOND, stamps % SECOND
    data = points.tobytes()
    if len(body) % 8 == 0:  # the first doubles are to be aligned, too; the others are by themselves
        data = data[:4] + bytes(4) + data[4:]
    return HEAD + body + data


def read_trajectory_cdr(data: bytes, names: Sequence[str]) -> Trajectory | None:
    """The trajectory of a message as `trajectory_cdr` writes it, None of any other message, as
    of one with a stamp."""
    before = HEAD + _before_points(names)
    if not data.startswith(before) or len(data) < len(before) + 4:
        return None
    (count,) = struct.unpack_from('<I', data, len(before))
    start = len(before) + 4
    if count and (start - len(HEAD)) % 8 == 0:
        data, start = data[start : start + 4] + data[start + 8 :], 0
    kind = _point(len(names))
    if not count or len(data) - start < count * kind.itemsize:  # some middleware pads the end
        return None
    points = np.frombuffer(data, kind, count, start)
    counts = (points[f'counts_{key}'] == len(names) for key in 'pva')
    if not all(each.all() for each in counts) or points['effort'].any():
        return None
    seconds = points['sec'] + points['nanosec'] / SECOND
    p, v, a = (frozen(points[key]) for key in 'pva')
    return Trajectory(frozen(seconds), p, v, a)


def _before_points(names: Sequence[str], stamp: int = 0) -> bytes:
    """A header that says nothing but the stamp (ns), and the joints' names."""
    body = struct.pack('<iI', *divmod(stamp, SECOND)) + _string('')
    body += bytes(-len(body) % 4) + struct.pack('<I', len(names))
    for name in names:
        body += bytes(-len(body) % 4) + _string(name)
    return body + bytes(-len(body) % 4)


def _string(text: str) -> bytes:
    encoded = text.encode() + b'\x00'
    return struct.pack('<I', len(encoded)) + encoded


def _point(n: int) -> np.dtype[np.void]:
    """A point of n joints whose first count is 4 bytes off a multiple of 8, as the next one is."""
    doubles, whole = (np.float64, (n,)), np.uint32
    return np.dtype(
        [
            ('counts_p', whole),
            ('p', *doubles),
            ('counts_v', whole),
            ('pad_v', whole),
            ('v', *doubles),
            ('counts_a', whole),
            ('pad_a', whole),
            ('a', *doubles),
            ('effort', whole),
            ('sec', np.int32),
            ('nanosec', whole),
        ]
    )
