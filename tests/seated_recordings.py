# SPDX-License-Identifier: Apache-2.0
"""Bags of joint states alone, as people record an arm whose ball they seat in sockets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.bags import BagWriter, cdr
from calib_model.instruments import Arm, Gauge
from calib_model.kinematics import points
from calib_model.stamps import SECOND
from calib_model.topics import JOINT_STATES

BEGIN = 1_790_000_000 * SECOND  # ns


@dataclass(frozen=True)
class Recording:
    """How the arm is held and moved: times in s, `rate` in Hz, `noise` of the encoders and `drift`
    of the hand over a hold in rad; `lift` are joints (n,) that it goes to between two postures."""

    rate: float = 100.0
    hold: float = 0.5
    move: float = 0.5
    noise: float = 0.0
    drift: float = 0.0
    lift: Array | None = None

    def states(self, postures: Array) -> Iterator[Array]:
        """The joints state by state."""
        draw = np.random.default_rng(5)
        held, moved = round(self.rate * self.hold), round(self.rate * self.move)
        for row, posture in enumerate(postures):
            if row and moved:
                stops = [postures[row - 1], *([] if self.lift is None else [self.lift]), posture]
                for begin, end in zip(stops, stops[1:], strict=False):
                    for u in np.linspace(0.0, 1.0, moved, endpoint=False):
                        yield begin + (end - begin) * u**2 * (3 - 2 * u)
            away = draw.normal(0.0, 1.0, len(posture))
            for u in np.linspace(-0.5, 0.5, held):
                shaken = draw.normal(0.0, 1.0, len(posture)) * self.noise
                yield posture + self.drift * u * away + shaken

    def write(self, folder: Path, names: Sequence[str], postures: Array) -> Path:
        """The bag, of these joints."""
        with BagWriter(folder) as bag:
            for number, joints in enumerate(self.states(postures)):
                stamp = BEGIN + round(number * SECOND / self.rate)
                message = cdr.joint_state(stamp, 'base', list(names), joints)
                bag.write_message(JOINT_STATES, message, stamp)
        return folder


def project(arm: Arm, ball: Array, near: Array, goal: Array) -> Array:
    """Postures (N, n) beside those `near` (N, n) at which the ball (3,) on the flange is at the
    goal (3,), m."""
    q = near
    for _ in range(12):
        miss = points(arm, q, ball) - goal
        slope = np.stack(
            [(points(arm, q + step, ball) - goal - miss) / 1e-6 for step in 1e-6 * np.eye(arm.n)],
            axis=-1,
        )  # (N, 3, n)
        q = q - np.einsum('kij,kj->ki', np.linalg.pinv(slope), miss)
    assert np.abs(points(arm, q, ball) - goal).max() < 1e-6
    return q


def led(
    arm: Arm, ball: Array, gauge: Gauge, places: Sequence[Sequence[float]]
) -> tuple[Array, Array, Array]:
    """States (N, n), 50 a second, of an arm led around its ball in every socket, which socket each
    state is in (N,), -1 between them, and the ball (3,)."""
    draw = np.random.default_rng(8)
    start = np.array([0.0, 0.6, 0.0, -1.2, 0.0, 1.0, 0.0])
    parts: list[Array] = []
    socket: list[Array] = []
    for number, goal in enumerate(
        np.add(place, gauge.center(each)) for place in places for each in gauge.numbers
    ):
        turns = start + draw.normal(0.0, 0.25, (9, arm.n))
        path = np.concatenate(
            [np.linspace(one, other, 100) for one, other in zip(turns, turns[1:], strict=False)]
        )
        seated = project(arm, ball, path, goal)
        if parts:
            u = np.linspace(0.0, 1.0, 80)[:, None]
            lifted = (parts[-1][-1] + seated[0]) / 2 + draw.normal(0.0, 0.3, arm.n)
            parts.append((1 - u) ** 2 * parts[-1][-1] + 2 * u * (1 - u) * lifted + u**2 * seated[0])
            socket.append(np.full(80, -1))
        parts.append(seated)
        socket.append(np.full(len(seated), number))
    return np.concatenate(parts), np.concatenate(socket), ball
