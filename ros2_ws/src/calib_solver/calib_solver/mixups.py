# SPDX-License-Identifier: Apache-2.0
"""Mix-ups: what a measurement would be if something had been wired, counted or named otherwise.

A calibration that leaves large residuals is asked whether its poses would fit far better with two
styli exchanged, a joint counted the other way, degrees for radians. What does is named to the user
and never put right behind his back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from calib_model.errors import CalibrationError, DataError
from calib_model.probe import ActiveProbe
from calib_model.probing import Measurement, ProbingSet
from calib_model.rotation import Array
from calib_solver.problem import Problem

#: so many poses are enough to tell a mix-up
POSES = 280
#: a pose's usual distance from its sphere's centre (m) below which nothing is mixed up
SMALL = 3e-4
#: a mix-up is named when the poses fit so many times better with it
FACTOR = 4.0
#: and no better than this (m) it explains nothing
EXPLAINED = 1e-3
#: another that comes so near the best cannot be told from it
NEARLY = 1.2
#: how far styli have to move (m) for one that does not to be stuck
MOVES = 1e-5

#: a problem's usual distance (m) of a pose from its sphere's centre, when it is solved
Spread = Callable[[Problem], float]
Change = Callable[[ProbingSet], ProbingSet]


@dataclass(frozen=True)
class Mixup:
    """Something that may have been done otherwise than the descriptions say."""

    text: str
    change: Change


def stuck_styli(measured: Measurement) -> tuple[str, ...]:
    """A line for each stylus that reads one value in all poses while others move."""
    if not isinstance(measured.probe, ActiveProbe):
        return ()
    read = measured.poses.displacement
    moves = np.ptp(read, axis=0)
    if len(read) < 3 or moves.max() < MOVES:
        return ()
    return tuple(
        f'stylus {number + 1} reads {read[0, number] * 1e3:.4f} mm in every pose while others '
        f'move by {moves.max() * 1e3:.4f} mm: stuck, or not connected'
        for number in np.flatnonzero(moves == 0)
    )


def named_mixups(measured: Measurement, spread: float, spread_of: Spread) -> tuple[str, ...]:
    """A line for what would make the poses fit FACTOR times better than their `spread` (m)."""
    if spread < SMALL:
        return ()
    few = _few(measured)
    found: list[tuple[float, str]] = []
    for mixup in mixups(measured):
        poses = mixup.change(few.poses)
        try:
            found.append((spread_of(Problem.of(replace(few, poses=poses))), mixup.text))
        except CalibrationError:
            continue  # poses that fit no probe or no arm explain nothing
    best = min((size for size, _ in found), default=np.inf)
    if best > min(EXPLAINED, spread / FACTOR):
        return ()
    likely = [text for size, text in sorted(found) if size <= NEARLY * best]
    return (
        f'the poses would fit {spread / best:.0f} times better with {" or ".join(likely)} '
        f'({best * 1e3:.4f} mm instead of {spread * 1e3:.4f} mm from pose to pose): '
        'nothing was changed, this result is not to be used',
    )


def refuse_other_units(problem: Problem, center: Array) -> None:
    """Raise where distances between the centres (S, 3), m, are a thousand times the certificate's.

    Raises:
        DataError: arm and gauge are described in different units.
    """
    if len(problem.pairs) == 0:
        return
    between = center[problem.pairs[:, 0]] - center[problem.pairs[:, 1]]
    ratio = float(np.median(np.linalg.norm(between, axis=1) / problem.nominal))
    if 500 < ratio < 2000 or 500 < 1 / ratio < 2000:
        raise DataError(
            f'{problem.measured.source}: distances between spheres come out {ratio:.4g} times the '
            f"certificate's: are the lengths of {problem.measured.arm.name} and "
            f'{problem.measured.gauge.name} both in m?'
        )


def beyond_belief(spread: float) -> tuple[str, ...]:
    """Poses that no arm worth calibrating would leave so far apart."""
    if spread < EXPLAINED:
        return ()
    return (
        f'the poses of one sphere still lie {spread * 1e3:.3f} mm apart (rms) after the fit: this '
        'is not the arm, the probe or the numbering that the descriptions tell of (order, signs '
        'and units of joints and readings; two places under one location number); not to be used',
    )


def mixups(measured: Measurement) -> Iterator[Mixup]:
    """What can be mixed up in this arm and probe."""
    names = measured.arm.joint_names
    yield Mixup('joint positions taken as degrees', _as_degrees)
    for i, name in enumerate(names):
        yield Mixup(f'joint {name} counted the other way', _scaled_joint(i, -1.0))
    for i, j in combinations(range(len(names)), 2):
        yield Mixup(f'joints {names[i]} and {names[j]} exchanged', _swapped('joints', i, j))
    if isinstance(measured.probe, ActiveProbe):
        for i, j in combinations(range(3), 2):
            yield Mixup(f'styli {i + 1} and {j + 1} exchanged', _swapped('displacement', i, j))
        for i in range(3):
            yield Mixup(f'the sign of stylus {i + 1} reversed', _reversed_stylus(i))


def _as_degrees(poses: ProbingSet) -> ProbingSet:
    return replace(poses, joints=np.radians(poses.joints))


def _swapped(column: str, i: int, j: int) -> Change:
    def change(poses: ProbingSet) -> ProbingSet:
        values: Any = np.array(getattr(poses, column))
        values[:, [i, j]] = values[:, [j, i]]
        return replace(poses, **{column: values})

    return change


def _scaled_joint(joint: int, factor: float) -> Change:
    def change(poses: ProbingSet) -> ProbingSet:
        joints = np.array(poses.joints)
        joints[:, joint] *= factor
        return replace(poses, joints=joints)

    return change


def _reversed_stylus(stylus: int) -> Change:
    def change(poses: ProbingSet) -> ProbingSet:
        read = np.array(poses.displacement)
        read[:, stylus] *= -1
        return replace(poses, displacement=read)

    return change


def _few(measured: Measurement) -> Measurement:
    """At most POSES of the poses, the same share of every stretch of the measurement."""
    count = len(measured.poses)
    if count <= POSES:
        return measured
    chosen = np.linspace(0, count - 1, POSES).astype(np.int64)
    return replace(measured, poses=measured.poses.take(chosen))
