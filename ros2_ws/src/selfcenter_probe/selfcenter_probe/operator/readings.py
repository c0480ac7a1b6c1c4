# SPDX-License-Identifier: Apache-2.0
"""What encoders and styli read while a hand leads the arm around the spheres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.measurement import ProbingSet
from calib_model.stamps import SECOND
from selfcenter_probe.operator.force import HandForce, overhang
from selfcenter_probe.operator.motion import (
    LIFT,
    TICK,
    HandMotion,
    Seating,
    effort_of,
    hand_axis,
    p_probe_of,
)
from selfcenter_probe.operator.seating import reach, seated
from selfcenter_probe.sensing import Contact, Status
from selfcenter_probe.simulation import Readings, World

READ_PERIOD = 2_000_000  # ns: the styli are read at 500 Hz


@dataclass(frozen=True)
class HandReadings:
    """What is read at N stamps (ns): `joints` (N, n), rad, and the probe's `contact`."""

    stamp: NDArray[np.int64]
    joints: Array
    contact: Contact


@dataclass(frozen=True)
class RawStretch:
    """Both raw streams over one stretch of time: joint states at `stamp` (M,), and readings."""

    stamp: NDArray[np.int64]
    joints: Array
    readings: Readings


class HandGuided:
    """The true arm, led along a motion, and what its instruments say.

    The joints are where the probe really holds the sphere, yielded and bent as it all is; the
    encoders read what they see of that. The same seed gives the same poses, with or without the
    raw streams.
    """

    def __init__(self, world: World, motion: HandMotion, seed: int) -> None:
        self.world = world
        self.motion = motion
        self._seed = seed
        self._force = HandForce.on(world.probe, world.magnitudes)

    def true_joints(self, seating: Seating, stamps: NDArray[np.int64]) -> tuple[Array, Array]:
        """True joints (N, n) at stamps (N,) of a seating, and how far they are bent, rad.

        Raises:
            DataError: the arm cannot hold the sphere there.
        """
        world, hold = self.world, seating.hold
        p_flange = world.probe.flange_T_probe.apply(p_probe_of(world, seating, stamps))
        q, there = seated(hold.arm, seating.joints(stamps), p_flange, hold.p_base)
        at = reach(hold.arm, q, p_flange)
        effort = effort_of(world, seating, stamps)
        force = self._force.on_gauge(at.rotation @ hand_axis(world), effort)
        bar = world.p_base_sphere[world.location == seating.location]
        p_base = hold.p_base + self._force.displacement(force, overhang(hold.p_base, bar))
        q, still = seated(hold.arm, q, p_flange, p_base)
        if not (there & still).all():
            raise DataError(f'location {seating.location}: sphere {seating.sphere} was lost')
        return q, self._force.bending(force, effort, at.jacobian)

    def read(
        self, seating: Seating, stamps: NDArray[np.int64], generator: np.random.Generator
    ) -> HandReadings:
        """What is read at stamps (N,), ns, of a seating."""
        q_true, bent = self.true_joints(seating, stamps)
        of_joints, of_psds = generator.spawn(2)
        unseen = self.world.repeatability().draw(q_true, of_joints)
        joints = self.world.encoders.read(q_true - bent - unseen)
        contact = self.world.contact(p_probe_of(self.world, seating, stamps))
        return HandReadings(stamps, joints, self.world.read(contact, of_psds))

    def poses_of(self, number: int) -> HandReadings:
        """The poses of the seating of that number, from 0."""
        seating = self.motion.seatings[number]
        return self.read(seating, seating.stamps, self._generator(number, 0))

    def _generator(self, number: int, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, number, purpose])

    def raw(self) -> Iterator[RawStretch]:
        """Both streams from the first seating to the last, poses and readings equal to the poses'.

        Between two seatings the joints go smoothly from one to the other, and nothing touches.
        """
        before: tuple[Array, Array] | None = None
        for number, seating in enumerate(self.motion.seatings):
            stamps = np.arange(seating.begin, seating.end + 1, READ_PERIOD, dtype=np.int64)
            dense = self.read(seating, stamps, self._generator(number, 1))
            taken = self.poses_of(number)
            joints, contact = dense.joints.copy(), dense.contact
            rows = (taken.stamp - seating.begin) // READ_PERIOD
            displacement, status = contact.displacement.copy(), contact.status.copy()
            joints[rows] = taken.joints
            displacement[rows] = taken.contact.displacement
            status[rows] = taken.contact.status
            way = joints[:: TICK // READ_PERIOD]
            if before is not None:
                last, speed = before
                yield self._lifted(seating, (last, speed), (way[0], _speed(seating, 0)))
            before = way[-1], _speed(seating, -1)
            readings = Readings(stamps, displacement, status)
            yield RawStretch(stamps[:: TICK // READ_PERIOD], way, readings)

    def _lifted(
        self, seating: Seating, last: tuple[Array, Array], first: tuple[Array, Array]
    ) -> RawStretch:
        """The way through the air to a seating, from joints and speeds to joints and speeds."""
        way = CubicHermiteSpline([0.0, LIFT / SECOND], [last[0], first[0]], [last[1], first[1]])
        ticks = np.arange(TICK, LIFT, TICK, dtype=np.int64)
        reads = np.arange(READ_PERIOD, LIFT, READ_PERIOD, dtype=np.int64)
        begin = seating.begin - LIFT
        free = self.world.contact(np.full((len(reads), 3), 1.0))
        readings = Readings(begin + reads, free.displacement, free.status)
        return RawStretch(begin + ticks, way(ticks / SECOND), readings)


def _speed(seating: Seating, end: int) -> Array:
    """The joints' speed (n,), rad/s, at the beginning (0) or the end (-1) of a seating."""
    duration = max((seating.end - seating.begin) / SECOND, TICK / SECOND)
    speed: Array = seating.way(seating.way.x[end], 1) * seating.way.x[-1] / duration
    return speed


def probing_set(readings: list[tuple[Seating, HandReadings]]) -> ProbingSet:
    """The poses of all seatings whose styli read well."""
    parts = []
    for seating, read in readings:
        count = len(read.stamp)
        every = ProbingSet(
            np.full(count, seating.location),
            np.full(count, seating.sphere),
            read.joints,
            read.contact.displacement,
            read.stamp,
            np.ones(count, dtype=np.int64),
        )
        parts.append(every.take((read.contact.status == Status.OK).all(axis=1)))
    return ProbingSet.joined(parts)
