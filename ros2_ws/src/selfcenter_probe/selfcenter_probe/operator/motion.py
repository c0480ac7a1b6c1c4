# SPDX-License-Identifier: Apache-2.0
"""The operator's whole motion: which sphere is held when, how, and where poses are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import PassiveProbe
from calib_model.stamps import SECOND
from calib_model.transforms import RigidTransform
from selfcenter_probe.operator.path import Hold, postures, ways
from selfcenter_probe.simulation import World

TICK = 4_000_000  # ns: joint states come at 250 Hz, and poses are taken at stamps that have one
START = 1_700_000_000 * SECOND
LIFT = 1 * SECOND  # from one seating to the next
SEATINGS = 6  # per sphere, spread over the elbow's branches
CAP = np.radians(70.0)
OFFSET = 0.5e-3  # m rms, per coordinate: no hand holds a sphere at the middle of the styli
WAVES = 3
SLOW = (0.1, 0.5)  # Hz: how fast a hand changes its force and its hold


@dataclass(frozen=True)
class Wander:
    """Smooth random signals (D) of unit variance: sums of slow waves (D, 3), Hz and rad."""

    frequency: Array
    phase: Array

    @classmethod
    def drawn(cls, signals: int, generator: np.random.Generator) -> Wander:
        """Signals that have nothing to do with one another."""
        shape = (signals, WAVES)
        return cls(generator.uniform(*SLOW, shape), generator.uniform(0, 2 * np.pi, shape))

    def at(self, seconds: Array) -> Array:
        """The signals (N, D) at times (N,), s."""
        turns = 2 * np.pi * self.frequency * seconds[:, None, None] + self.phase
        values: Array = np.sqrt(2 / WAVES) * np.sin(turns).sum(axis=2)
        return values


@dataclass(frozen=True)
class Seating:
    """One sphere held from seating the probe on it to lifting it off.

    `poses` are taken every `period` (ns) from `begin` (ns) on, while the hand goes along `way`.
    """

    location: int
    sphere: int
    hold: Hold
    way: CubicSpline
    level: float
    effort: Wander
    offset: Wander
    begin: int = 0
    poses: int = 0
    period: int = TICK

    @property
    def end(self) -> int:
        """The stamp of the last pose, ns."""
        return self.begin + (self.poses - 1) * self.period

    @property
    def stamps(self) -> NDArray[np.int64]:
        """When poses are taken, (poses,), ns."""
        return self.begin + self.period * np.arange(self.poses, dtype=np.int64)

    def joints(self, stamps: NDArray[np.int64]) -> Array:
        """About where the joints (N, n) are at stamps (N,), ns; `seated` makes it exact."""
        share = (stamps - self.begin) / max(self.end - self.begin, 1)
        joints: Array = self.way(share * self.way.x[-1])
        return joints

    def seconds(self, stamps: NDArray[np.int64]) -> Array:
        """Times (N,) since the probe was seated, s."""
        since: Array = (stamps - self.begin) / SECOND
        return since


@dataclass(frozen=True)
class HandMotion:
    """All seatings in time order, and the spheres (location, number) that were out of reach."""

    seatings: tuple[Seating, ...]
    absent: tuple[tuple[int, int], ...]

    @property
    def poses(self) -> int:
        """How many poses are taken in all."""
        return sum(seating.poses for seating in self.seatings)


@dataclass(frozen=True)
class MotionSettings:
    """What the operator is asked for: `poses` per sphere on average, moving at `speed` (rad/s).

    The speed is that of all joints together. The poses of a sphere that is out of reach are taken
    at the others. `seed` is the hand's own.
    """

    poses: int = 385
    speed: float = 1.0
    seed: int = 1


Told = Callable[[int, int, str], None]


def guided(
    world: World,
    sides: dict[int, RigidTransform],
    spheres: Sequence[int],
    settings: MotionSettings,
    told: Told = lambda done, planned, where: None,
) -> HandMotion:
    """The operator's motion around `spheres` of the gauge locations in `sides` (`T_base_gauge`).

    A sphere's motion depends on the seed, its location and its number alone, so the same hand
    comes back whatever else is measured.

    Raises:
        DataError: no sphere is within reach, or one is not on the gauge.
    """
    wanted = [(location, sphere) for location in sorted(sides) for sphere in spheres]
    found: list[list[Seating]] = []
    absent: list[tuple[int, int]] = []
    for done, (location, sphere) in enumerate(wanted):
        told(done, len(wanted), f'location {location} sphere {sphere}')
        generator = np.random.default_rng([settings.seed, location, sphere])
        hold = _hold(world, location, sphere, sides[location].rotation[:, 2])
        held = list(_seatings(location, sphere, hold, world, generator))
        if held:
            found.append(held)
        else:
            absent.append((location, sphere))
    if not found:
        raise DataError(f'none of the {len(wanted)} spheres is within reach of {world.arm.name}')
    shares = _shared(settings.poses * len(wanted), np.ones(len(found)))
    return HandMotion(tuple(_timed(found, shares, settings.speed)), tuple(absent))


def hand_axis(world: World) -> Array:
    """The unit vector (3,) in the flange's frame along which a hand pushes the probe.

    From the flange's origin, where the last two axes of a measuring arm meet and the hand is,
    to the sphere.
    """
    p_flange = world.probe.flange_T_probe.apply(world.p_probe_middle)
    length = np.linalg.norm(p_flange)
    if length < 1e-6:
        raise DataError(f'{world.probe.name}: sits on the flange, where the hand is')
    axis: Array = p_flange / length
    return axis


def _hold(world: World, location: int, sphere: int, side: Array) -> Hold:
    row = np.flatnonzero((world.location == location) & (world.sphere == sphere))
    if len(row) != 1:
        raise DataError(f'location {location} has no sphere {sphere}')
    p_flange = world.probe.flange_T_probe.apply(world.p_probe_middle)
    p_base = world.p_base_sphere[row[0]]
    return Hold(world.arm, p_flange, p_base, hand_axis(world), side, CAP)


def _seatings(
    location: int, sphere: int, hold: Hold, world: World, generator: np.random.Generator
) -> Iterator[Seating]:
    """The seatings of one sphere, none if it is out of reach, with neither time nor poses yet."""
    found = postures(hold, generator)
    if not len(found):
        return
    variation = world.magnitudes.hand.variation
    for way in ways(hold, found, SEATINGS, generator):
        level = float(np.exp(variation * np.clip(generator.standard_normal(), -2, 2)))
        effort, offset = Wander.drawn(1, generator), Wander.drawn(3, generator)
        yield Seating(location, sphere, hold, way, level, effort, offset)


def _shared(total: int, weight: Array) -> list[int]:
    """`total` in whole parts that go by weight (N,)."""
    ends = np.round(np.cumsum(weight) / np.sum(weight) * total).astype(np.int64)
    return [int(part) for part in np.diff(ends, prepend=0)]


def _timed(
    spheres: Sequence[Sequence[Seating]], shares: Sequence[int], speed: float
) -> Iterator[Seating]:
    """Seatings with their times and their poses, which go by the lengths of the ways."""
    begin = START
    for held, total in zip(spheres, shares, strict=True):
        lengths = np.array([seating.way.x[-1] for seating in held])
        for seating, poses in zip(held, _shared(total, lengths), strict=True):
            if poses > 0:
                apart = seating.way.x[-1] / speed / max(poses - 1, 1)
                period = max(round(apart * SECOND / TICK), 1) * TICK  # whole ticks
                timed = replace(seating, begin=begin, poses=poses, period=period)
                begin = timed.end + LIFT
                yield timed


def effort_of(world: World, seating: Seating, stamps: NDArray[np.int64]) -> Array:
    """How hard the hand pushes (N,) at stamps (N,), ns, as a ratio to the mean force."""
    change = world.magnitudes.hand.variation * seating.effort.at(seating.seconds(stamps))[:, 0]
    effort: Array = seating.level * np.maximum(1 + change, 0)
    return effort


def p_probe_of(world: World, seating: Seating, stamps: NDArray[np.int64]) -> Array:
    """Where the hand holds the sphere (N, 3) in the probe's frame at stamps (N,), ns, m."""
    middle = np.tile(world.p_probe_middle, (len(stamps), 1))
    if isinstance(world.probe, PassiveProbe):
        return middle
    held: Array = middle + OFFSET * seating.offset.at(seating.seconds(stamps))
    return held
