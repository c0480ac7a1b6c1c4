# SPDX-License-Identifier: Apache-2.0
"""An arm on a sphere that lives in no graph and in its own time, with what can be wrong of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from calib_capture.checking import OK, Finding, Heard, SmallMove
from calib_capture.motion import InterpolatedMotion, MotionState, Trajectory
from calib_model.instruments import ActiveProbe, Arm, Gauge
from calib_model.kinematics import forward_kinematics, points
from calib_model.pairing import JointSample, Reading
from calib_model.stamps import SECOND
from calib_model.transforms import RigidTransform, rotation_matrix, rotation_vector

BEGIN = 1_700_000_000 * SECOND
OFFSET = np.array([4e-4, -7e-4, 3e-4])  # m, of the sphere in the probe


@dataclass
class Wrongs:
    """How streams differ from what they should be."""

    length: float = 1.0
    angle: float = 1.0
    signs: tuple[int, int, int] = (1, 1, 1)
    order: tuple[int, int, int] = (0, 1, 2)
    flips: int | None = None
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock: float = 0.0
    noise: float = 1e-6
    joint_noise: float = 0.0
    rate: float = 125.0
    silence: float = 0.0  # s in each second
    stuck: int | None = None
    swapped: bool = False  # the first two joints of commands
    backwards: bool = False  # commands are
    unstamped: bool = False
    jitter: float = 0.0  # s, of the joints' stamps
    step: float = 0.0  # rad, of the joints' encoders
    errors: float = 1.0  # times the usual ones of arm and probe


@dataclass
class LiveCell:
    """Is a `Cell`. The true arm is off by tenths of a mm and the probe by 1 mm and 0.3 deg."""

    arm: Arm
    probe: ActiveProbe
    gauge: Gauge
    posture: np.ndarray
    wrongs: Wrongs
    heard: Heard = field(default_factory=Heard)
    moves: list[SmallMove] = field(default_factory=list)
    seed: int = 5

    def __post_init__(self) -> None:
        rng = self._rng = np.random.default_rng(self.seed)
        joints = [
            replace(joint, direction=-joint.direction) if i == self.wrongs.flips else joint
            for i, joint in enumerate(self.arm.joints)
        ]
        arm = replace(self.arm, joints=tuple(joints))
        off = rng.normal(size=arm.geometry[:4].shape) * 3e-4 * self.wrongs.errors
        geometry = arm.geometry.copy()
        geometry[:4] += off
        self._true = arm.with_geometry(geometry)
        mount = self.probe.flange_T_probe
        turn = rotation_matrix(np.array(self.wrongs.turn)) @ rotation_matrix(
            rng.normal(size=3) * 5e-3 * self.wrongs.errors
        )
        at = mount.translation + rng.normal(size=3) * 1e-3 * self.wrongs.errors
        self._mounted = self.probe.mounted(
            RigidTransform(at, rotation_vector(mount.rotation @ turn))
        )
        self._motion: tuple[float, InterpolatedMotion] | None = None
        self._here, self._time, self._to = self.posture.copy(), 0.0, [(0.0, self.posture.copy())]
        in_probe = self._mounted.flange_T_probe.apply(OFFSET[None])
        self._sphere = points(self._true, self.posture[None], in_probe)[0]

    def spin(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end, wrongs = self._time + seconds, self.wrongs
        times = [self._time]
        while times[-1] < end - 1e-9:
            times.append(times[-1] + 1 / wrongs.rate)
        postures = np.array([self._at(time) for time in times])
        for time, q, true in zip(times[1:], postures[1:], self._touched(postures)[1:], strict=True):
            if until():
                break
            self._time = time
            if time % 1.0 < wrongs.silence:
                continue
            stamp = 0 if wrongs.unstamped else BEGIN + round(time * SECOND)
            late = round(self._rng.normal() * wrongs.jitter * SECOND) if wrongs.jitter else 0
            told = (q + self._rng.normal(size=len(q)) * wrongs.joint_noise) * wrongs.angle
            told = np.round(told / wrongs.step) * wrongs.step if wrongs.step else told
            self.heard.take(JointSample(stamp + late, told), time)
            self._read(true, stamp)

    def _touched(self, postures: np.ndarray) -> np.ndarray:
        """Where the styli are at postures (N, n)."""
        flange = forward_kinematics(self._true, postures)
        p_flange = np.einsum('nji,nj->ni', flange[:, :3, :3], self._sphere - flange[:, :3, 3])
        mount = self._mounted.flange_T_probe
        p_probe = (p_flange - mount.translation) @ mount.rotation
        return self._mounted.displacements(p_probe, self.gauge.sphere_diameter)

    def _read(self, true: np.ndarray, stamp: int) -> None:
        wrongs = self.wrongs
        s = true + self._rng.normal(size=3) * wrongs.noise
        if wrongs.stuck is not None:
            s[wrongs.stuck] = 5e-4 + self._rng.normal() * wrongs.noise
        s = (s * wrongs.signs * wrongs.length)[list(wrongs.order)]
        lower, upper = self.probe.stroke.T
        far = ~(true >= lower)  # also where a sphere is nowhere near
        out = [1 if a else 2 if b else 0 for a, b in zip(far, true > upper, strict=True)]
        status = (out[0], out[1], out[2])
        reading = Reading(stamp - round(wrongs.clock * SECOND), s, status)
        self.heard.take(reading, self._time + 1e-3)

    def topic_findings(self) -> list[Finding]:
        return [Finding('/joint_states', OK, 'one publisher')]

    def listening(self) -> bool:
        return True

    def problem(self) -> str:
        return ''

    def send(self, move: SmallMove) -> None:
        self.moves.append(move)
        positions = move.positions.copy()
        if self.wrongs.swapped:
            positions[:, [0, 1]] = self.posture[[0, 1]] + (
                move.positions[:, [1, 0]] - self.posture[[1, 0]]
            )
        if self.wrongs.backwards:
            positions = 2 * self.posture - positions
        self._to = [(self._time, self._at(self._time))]
        self._to += [(self._time + s, q) for s, q in zip(move.seconds, positions, strict=True)]

    def follow(self, trajectory: Trajectory) -> None:
        """Go by a trajectory, to its end."""
        start = MotionState.resting(trajectory.positions[0])
        self._motion = self._time, InterpolatedMotion(start, trajectory)
        self.spin(trajectory.duration)

    def _at(self, now: float) -> np.ndarray:
        if self._motion is not None:
            begin, motion = self._motion
            return motion.positions_at(np.array(now - begin))
        for (begin, start), (end, goal) in zip(self._to[:-1], self._to[1:], strict=True):
            if now < end:
                x = np.clip((now - begin) / (end - begin), 0.0, 1.0)
                return start + (goal - start) * (10 * x**3 - 15 * x**4 + 6 * x**5)
        return self._to[-1][1]
