# SPDX-License-Identifier: Apache-2.0
"""A stream of joint states becomes a stream of probe readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import InTurn, PostureNoise
from calib_model.measurement import ProbingSet
from calib_model.stamps import SECOND
from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation.world import World

#: rad (m of a rail) by which encoders scatter at most while the arm stands
STANDING = 1e-4


@dataclass(frozen=True)
class Readings:
    """K readings: `stamp` (K,) in ns, `displacement` (K, 3) in m, `status` (K, 3) as `Status`."""

    stamp: NDArray[np.int64]
    displacement: Array
    status: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.stamp)

    def shifted(self, by: int) -> Readings:
        """The same readings `by` ns later."""
        return Readings(self.stamp + by, self.displacement, self.status)


class ProbeSimulation:
    """The probe on a moving arm, driven by the arm's joint states.

    It reads at the multiples of 1 / `rate` (Hz) of the stamps' time, with the joints in between
    interpolated linearly, but not across more than `max_gap` (s): after such a gap, and at the
    very first state, it reads at the state's own stamp. The same seed and the same states give
    the same readings; so do the same stops, however long the arm stood elsewhere.

    Raises:
        DataError: a rate or a gap that is not above zero.
    """

    def __init__(
        self,
        world: World,
        generator: np.random.Generator,
        rate: float = 100.0,
        max_gap: float = 0.1,
    ) -> None:
        self.pace(rate, max_gap)
        of_joints, of_psds = generator.spawn(2)
        self._world = world
        self._of_joints, self._of_readings = PostureNoise(of_joints), PostureNoise(of_psds)
        self._repeatability = world.repeatability()
        self._unseen: Array = np.zeros(world.arm.n)  # by the encoders, where it stands
        self._of_psds = generator
        self._stood: Array | None = None
        self._stamp: int | None = None
        self._joints = np.zeros(world.arm.n)

    def pace(self, rate: float, max_gap: float) -> None:
        """Read so often from now on.

        Raises:
            DataError: a rate or a gap that is not above zero.
        """
        if not (0 < rate <= 1e6 and max_gap > 0):
            raise DataError(f'rate {rate} Hz, max_gap {max_gap} s: expected both above zero')
        self._period = max(round(SECOND / rate), 1)
        self._max_gap = round(max_gap * SECOND)

    def advance(self, stamps: Sequence[int], joints: Array) -> Readings:
        """The readings up to the last of M joint states: stamps (M,) in ns, joints (M, n) in rad.

        A state not later than the one before is left out, unless it is earlier by more than
        `max_gap`: then the clock was set back and time starts again there.

        Raises:
            DataError: not the arm's number of joints.
        """
        joints = self._world.arm.check_joints(joints)
        at: list[int] = []
        seen_at: list[Array] = []
        draws: list[tuple[np.random.Generator, int]] = []
        for stamp, q in zip(stamps, joints, strict=True):
            if self._stamp is not None and -self._max_gap <= stamp - self._stamp <= 0:
                continue
            self._travel(q)
            true_joints = self._world.encoders.true(q[None])[0] + self._unseen
            due = self._due(stamp)
            if len(due):
                at.extend(due)
                seen_at.append(self._between(due, stamp, true_joints))
                draws.append((self._of_psds, len(due)))
            self._stamp, self._joints = stamp, true_joints
        if not at:
            return Readings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
        contact = self._world.contact(self._world.sight(np.concatenate(seen_at)).p_probe_sphere)
        read = self._world.read(contact, InTurn(draws))
        return Readings(np.array(at, dtype=np.int64), read.displacement, read.status)

    def _travel(self, q: Array) -> None:
        """Draw anew for an arm that has moved; one that stands draws on."""
        if self._stood is not None and np.abs(q - self._stood).max() <= STANDING:
            return
        self._stood = q
        self._unseen = self._repeatability.after(q, self._of_joints.arriving(q))
        self._of_psds = self._of_readings.arriving(q)

    def _due(self, stamp: int) -> Sequence[int]:
        """The stamps of the readings after the last state up to this one."""
        last = self._stamp
        if last is None or not 0 < stamp - last <= self._max_gap:
            return (stamp,)
        first = (last // self._period + 1) * self._period
        return range(first, stamp + 1, self._period)

    def _between(self, due: Sequence[int], stamp: int, joints: Array) -> Array:
        """True joints (K, n) at stamps (K,) between the last state and this one."""
        last = self._stamp
        if last is None or not 0 < stamp - last <= self._max_gap:
            return joints[None, :]
        share = (np.array(due, dtype=np.int64) - last) / (stamp - last)
        # written so that an arm at rest stays exactly where it is
        between: Array = self._joints + share[:, None] * (joints - self._joints)
        return between


def probe_postures(
    world: World, joints: Array, generator: np.random.Generator, readings: int = 1
) -> ProbingSet:
    """The probing set of an arm that stops at each of the postures (N, n), without a graph.

    For tests and studies: the spheres are named by the world itself. `readings` are averaged at
    each posture; postures at which any of them is not OK on all styli are left out. The stamps
    count the postures that were asked for, 1 s apart.

    Raises:
        DataError: not the arm's number of joints, or no reading asked for.
    """
    if readings < 1:
        raise DataError(f'expected at least one reading per posture, got {readings}')
    joints = world.arm.check_joints(joints)
    of_joints, of_psds = generator.spawn(2)
    unseen = world.repeatability().draw(joints, of_joints)
    true_joints = world.encoders.true(joints) + unseen
    seen = world.sight(true_joints)
    still = world.contact(seen.p_probe_sphere)
    count, styli = still.displacement.shape
    read = world.read(still.repeated(readings), of_psds)
    usable = (read.status == Status.OK).reshape(count, readings * styli).all(axis=1)
    every = ProbingSet(
        seen.location,
        seen.sphere,
        joints,
        read.displacement.reshape(count, readings, styli).mean(axis=1),
        np.arange(count, dtype=np.int64) * SECOND,
        np.full(count, readings, dtype=np.int64),
    )
    return every.take(usable)
