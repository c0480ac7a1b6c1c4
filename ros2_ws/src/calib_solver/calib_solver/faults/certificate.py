# SPDX-License-Identifier: Apache-2.0
"""Distances that do not come out as certified, and what the certificate or its use has to do with
it: lengths in other units, a sphere out of place, numbers counted otherwise, a wrong scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from calib_model.arrays import Array, median
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
#: or by so many times what the certificate and the poses' noise make them
FAR_BEYOND = 10.0
LEAST = 1e-9  # m
#: sets of spheres that are tried, sets that explain as much, and shifts that are as likely
MOST_SETS, ALIKE, NEARLY = 500, 0.02, 1.3
#: of the change of all lengths, the share that one scale explains
ONE_SCALE = 0.7
#: lengths that grew by so many times what arms do, all together, are a matter of scale
FAR = 5.0


def refuse_other_units(problem: Problem, center: Array) -> None:
    """Raise where distances between the centres (S, 3), m, are a thousand times the certificate's.

    Raises:
        DataError: arm and gauge are described in different units.
    """
    if len(problem.pairs) == 0:
        return
    ratio = float(median(_distances(problem, center) / problem.nominal))
    if 500 < ratio < 2000 or 0.0005 < ratio < 0.002:
        raise DataError(
            f'{problem.measured.source}: distances between spheres come out {ratio:.4g} times the '
            f"certificate's: are the lengths of {problem.measured.arm.name} and "
            f'{problem.measured.gauge.name} both in m?'
        )


def certificate_warnings(
    problem: Problem,
    sums: SphereSums,
    held: Array,
    misfit: float,
    noise: float,
    apart: bool = False,
) -> tuple[str, ...]:
    """A line where the distances do not come out as certified, and whose spheres' fault it is.

    `sums` at the identified parameters, `held` (F,) what the prior adds to eq. 11's J'J; `misfit`
    is how many times larger the errors are than the poses' noise and the certificate make them,
    and `noise` (m^2) a pose's variance. Where the poses of a sphere lie `apart` anyhow, nothing but
    a single sphere out of its place is named.
    """
    error, slope = distance_errors(problem, sums)
    size = _rms(error) if len(error) else 0.0
    times = size / _expected(problem, noise) if len(error) else 0.0
    if misfit >= MISFIT:
        # where all is far off it is another gauge, not several of its spheres
        most = 1 if apart or size >= BEYOND else None
        named = _named_spheres(problem, sums, held, (error, slope), most)
        if named:
            return named
    if apart:
        return ()
    if size >= BEYOND:
        return (
            f'distances between spheres still differ by {size * 1e3:.3f} mm (rms) from the '
            "certificate's after the fit: another gauge, or other numbers than it has; "
            'not to be used',
        )
    if times < FAR_BEYOND:
        return ()
    return (
        f'distances between spheres differ by {size * 1e3:.4f} mm (rms) from the certificate, '
        f'{times:.0f} times what it states and the poses scatter: one of a wrong certificate, '
        'bodies that bend, errors of the arm that D-H parameters do not hold',
    )


def _expected(problem: Problem, noise: float) -> float:
    """The rms error (m) of the distances that the certificate and the poses' noise make."""
    gauge = problem.measured.gauge
    stated = np.array([gauge.distance_uncertainty(length) / 2 for length in problem.nominal])
    of_centers = (noise / problem.counts)[problem.pairs].sum(axis=1)
    return max(float(np.sqrt(np.mean(stated**2 + of_centers))), LEAST)


def _named_spheres(
    problem: Problem,
    sums: SphereSums,
    held: Array,
    distances: tuple[Array, Array],
    most: int | None,
) -> tuple[str, ...]:
    """A line for the spheres whose certified centres are wrong, `most` at the most or half of
    them, if these explain most errors.

    What the parameters have taken up of a wrong centre is given back: both are solved together. As
    few spheres as explain them are named; of sets that do so alike, that of the smallest shifts.
    """
    error, slope = distances
    numbers = [int(number) for number in np.unique(problem.keys[:, 1])]
    if len(problem.pairs) < FEWEST or len(held) == 0 or not error.any():
        return ()
    normal = distance_repeatability(problem, sums).normal + np.diag(held)
    columns = {number: _by_center(problem, number) for number in numbers}
    for count in range(1, (most or max(1, len(numbers) // 2)) + 1):
        sets = list(combinations(numbers, count))
        if len(sets) > MOST_SETS:
            return ()
        tried = {
            spheres: _explained([columns[one] for one in spheres], error, slope, normal)
            for spheres in sets
        }
        best = max(share for share, _ in tried.values())
        if best >= SHARE:
            alike = {one: sizes for one, (share, sizes) in tried.items() if share > best - ALIKE}
            return (_spheres_line(alike, best),)
    return ()


def _spheres_line(found: Mapping[tuple[int, ...], Array], share: float) -> str:
    """The set (K,) of spheres whose shifts (K,), m, are the smallest, and what comes near it."""
    norms = {spheres: float(np.linalg.norm(sizes)) for spheres, sizes in found.items()}
    spheres = min(norms, key=lambda one: norms[one])
    explains = f'that alone explains {min(share, 1):.0%} of the distance errors'
    if len(spheres) == 1:
        return (
            f'sphere {spheres[0]} is {norms[spheres] * 1e3:.4f} mm from its place on the '
            f'certificate at every location: {explains}'
        )
    apart = ' and '.join(f'{size * 1e3:.4f}' for size in found[spheres])
    others = [
        ' and '.join(map(str, one))
        for one in sorted(norms, key=lambda one: norms[one])
        if one != spheres and norms[one] < NEARLY * norms[spheres]
    ]
    also = f' (or spheres {", or ".join(others)})' if others else ''
    return (
        'the distances do not agree with the certificate within what it states: spheres '
        f'{" and ".join(map(str, spheres))} are {apart} mm from their places there at every '
        f'location{also}: {explains}'
    )


def _explained(
    columns: Sequence[Array], error: Array, slope: Array, normal: Array
) -> tuple[float, Array]:
    """The share of the errors (M,) that shifts of some centres explain, and their sizes (K,), m."""
    by_center = np.concatenate(columns, axis=1)
    seen = by_center - slope @ np.linalg.lstsq(normal, slope.T @ by_center, rcond=None)[0]
    shift, _, rank, _ = np.linalg.lstsq(by_center.T @ seen, by_center.T @ error, rcond=FLAT**2)
    share = float(shift @ by_center.T @ error) / float(error @ error) if rank else 0.0
    return share, np.linalg.norm(shift.reshape(-1, 3), axis=1)


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
    # a single length that is far off looks like a scale to some part
    if scale**2 * information < ONE_SCALE * float(change @ change):
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
