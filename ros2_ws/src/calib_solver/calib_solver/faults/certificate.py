# SPDX-License-Identifier: Apache-2.0
"""Distances that do not come out as certified, and what the certificate or its use has to do with
it: lengths in other units, a sphere out of place, numbers counted otherwise, a wrong scale."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.kinematics import LENGTHS, ParameterTable
from calib_solver.fitting import distance_errors, distance_repeatability
from calib_solver.problem import Problem, SphereSums

#: distance errors that one sphere's place explains to this share are its fault
SHARE = 0.7
#: distance errors are looked into when they are so many times what they should be
MISFIT = 2.0
#: fewer distances let anything explain everything
FEWEST = 12
#: spheres nearer to one line than this say nothing about places beside it
FLAT = 0.05
#: other numbers of the spheres are named when distances come out so many times better with them
BETTER = 4.0
#: unless one sphere out of its place leaves no more than so many times as much
SIMPLER = 2.0
#: by how many numbers spheres may have been counted wrong
SHIFTS = (-3, -2, -1, 1, 2, 3)
#: distances that are off by more than this (m) after the fit are another gauge's
BEYOND = 1e-3
#: lengths that grew by so many times what arms do, all together, are a matter of scale
FAR = 5.0


def refuse_other_units(problem: Problem, center: Array) -> None:
    """Raise where distances between the centres (S, 3), m, are a thousand times the certificate's.

    Raises:
        DataError: arm and gauge are described in different units.
    """
    if len(problem.pairs) == 0:
        return
    ratio = float(np.median(_distances(problem, center) / problem.nominal))
    if 500 < ratio < 2000 or 0.0005 < ratio < 0.002:
        raise DataError(
            f'{problem.measured.source}: distances between spheres come out {ratio:.4g} times the '
            f"certificate's: are the lengths of {problem.measured.arm.name} and "
            f'{problem.measured.gauge.name} both in m?'
        )


def named_sphere(problem: Problem, sums: SphereSums, held: Array, misfit: float) -> tuple[str, ...]:
    """A line for the sphere whose certified centre is wrong, if that explains most distance errors.

    `sums` at the identified parameters, `held` (F,) what the prior adds to eq. 11's J'J; `misfit`
    is how many times larger the errors are than the poses' noise and the certificate make them.
    What the parameters have taken up of a wrong centre is given back: both are solved together.
    """
    if misfit < MISFIT or len(problem.pairs) < FEWEST or len(held) == 0:
        return ()
    error, slope = distance_errors(problem, sums)
    normal = distance_repeatability(problem, sums).normal + np.diag(held)
    best, number, size = 0.0, 0, 0.0
    for sphere in np.unique(problem.keys[:, 1]):
        by_center = _by_center(problem, int(sphere))
        seen = by_center - slope @ np.linalg.lstsq(normal, slope.T @ by_center, rcond=None)[0]
        shift, _, rank, _ = np.linalg.lstsq(by_center.T @ seen, by_center.T @ error, rcond=FLAT**2)
        share = float(shift @ by_center.T @ error) / float(error @ error)
        if rank and share > best:
            best, number, size = share, int(sphere), float(np.linalg.norm(shift))
    if best < SHARE:
        return ()
    return (
        f'sphere {number} is {size * 1e3:.4f} mm from its place on the certificate at every '
        f'location: that alone explains {min(best, 1):.0%} of the distance errors',
    )


def beyond_certificate(error: Array) -> tuple[str, ...]:
    """Distances whose errors (M,), m, no certificate worth the name leaves after a fit."""
    size = _rms(error) if len(error) else 0.0
    if size < BEYOND:
        return ()
    return (
        f'distances between spheres still differ by {size * 1e3:.3f} mm (rms) from the '
        "certificate's after the fit: another gauge, or other numbers than it has; not to be used",
    )


def _by_center(problem: Problem, sphere: int) -> Array:
    """How the certified distances (M,) change with the centre of one sphere: (M, 3)."""
    gauge = problem.measured.gauge
    apart: Array = np.zeros((len(problem.pairs), 3))
    for row, (i, j) in enumerate(problem.keys[problem.pairs, 1]):
        along = np.subtract(gauge.center(int(i)), gauge.center(int(j)))
        apart[row] = (float(i == sphere) - float(j == sphere)) * along
    return apart / problem.nominal[:, None]


def named_numbers(problem: Problem, center: Array) -> tuple[str, ...]:
    """A line where the nominal arm's centres (S, 3), m, are those of other numbers of the gauge.

    On a gauge whose spheres are evenly apart other numbers change no distance, and do no harm. One
    sphere out of its place is the simpler explanation.
    """
    if len(problem.pairs) < FEWEST:
        return ()
    measured = _distances(problem, center)
    now = _rms(measured - problem.nominal)
    found = [(_rms(measured - nominal), text) for text, nominal in _other_numbers(problem)]
    error, text = min(found, default=(np.inf, ''))
    if not error < now / BETTER or _by_one_sphere(problem, measured) < SIMPLER * error:
        return ()
    return (
        f'distances would come out {now / error:.0f} times better with {text} '
        f'({error * 1e3:.3f} mm instead of {now * 1e3:.3f} mm before any fit): '
        'nothing was changed, this result is not to be used',
    )


def _by_one_sphere(problem: Problem, measured: Array) -> float:
    """The least rms error of the distances (M,), m, with the centre of one sphere elsewhere."""
    error = measured - problem.nominal
    left = [
        error - by @ np.linalg.lstsq(by, error, rcond=FLAT)[0]
        for by in (_by_center(problem, int(number)) for number in np.unique(problem.keys[:, 1]))
    ]
    return min(_rms(each) for each in left)


def _other_numbers(problem: Problem) -> Iterator[tuple[str, Array]]:
    """Ways to have counted the spheres otherwise, and the distances (M,) certified then, m."""
    gauge = problem.measured.gauge
    known = sorted(number for number, _ in gauge.spheres)
    place = {number: row for row, number in enumerate(known)}
    probed = [place[int(number)] for number in problem.keys[:, 1]]
    others = {
        f'every sphere number {"higher" if by > 0 else "lower"} by {abs(by)}': [
            row + by for row in probed
        ]
        for by in SHIFTS
    }
    others['spheres counted from the other end'] = [len(known) - 1 - row for row in probed]
    for text, rows in others.items():
        if min(rows) < 0 or max(rows) >= len(known):
            continue
        at = np.array([gauge.center(known[row]) for row in rows])
        yield text, _distances(problem, at)


def named_scale(table: ParameterTable, full: Array, sigma: Array) -> tuple[str, ...]:
    """A line where all lengths of the arm have changed by one share, more than arms do.

    `full` (C,) are the identified parameters, `sigma` (F,) what the free ones usually are off.
    """
    free = table.free_columns
    lengths = np.array([parameter.kind in LENGTHS for parameter in table.free], dtype=bool)
    nominal = table.nominal[free][lengths] / sigma[lengths]
    change = (full - table.nominal)[free][lengths] / sigma[lengths]
    information = float(nominal @ nominal)
    if information == 0:
        return ()
    scale = float(nominal @ change) / information
    if abs(scale) * np.sqrt(information) < FAR:
        return ()
    longer = 'longer' if scale > 0 else 'shorter'
    return (
        f'the lengths of the arm come out {abs(scale):.2%} {longer} throughout: a certificate '
        'wrong in scale looks like that',
    )


def _distances(problem: Problem, center: Array) -> Array:
    """Between the centres (S, 3) of each pair: (M,)."""
    first, second = problem.pairs.T
    distances: Array = np.linalg.norm(center[first] - center[second], axis=1)
    return distances


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
