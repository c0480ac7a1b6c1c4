# SPDX-License-Identifier: Apache-2.0
"""Quality as `result.json` has it: the chapter's Fig. 6, and the arm as a measuring arm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_solver.left_out import LeftOut
from calib_solver.quality import (
    BASIS,
    COORDINATES,
    STANDARDS_BASIS,
    ProbedSpheres,
    Quality,
    articulation,
    lengths,
    standard_figures,
)

Record = dict[str, Any]
#: by what was left out: where that is, and the parts
LEFT_OUT_WORDS = {
    'location': ('at a place never probed', 'locations'),
    'posture': ('in postures never probed', 'regions of postures'),
    'station': ('from a station never used', 'groups of stations'),
}
SINGLE_POINT = (
    'spheres',
    'points',
    'max_deviation',
    'max_location',
    'max_sphere',
    'two_s_max',
    'two_s_mean',
    'two_s_location',
    'two_s_sphere',
)
LENGTH = (
    'count',
    'max_deviation',
    'max_location',
    'max_pair',
    'max_length',
    'mean',
    'two_rms',
    'span',
)


def sphere_records(spheres: ProbedSpheres) -> list[Record]:
    """One record a probed sphere; no 2 sigma where there is a single pose."""
    return [
        {
            'location': int(location),
            'sphere': int(sphere),
            'poses': int(poses),
            'center': center.tolist(),
            'two_sigma': _numbers(two_sigma),
        }
        for (location, sphere), poses, center, two_sigma in zip(
            spheres.keys, spheres.poses, spheres.center, spheres.two_sigma, strict=True
        )
    ]


def quality_record(quality: Quality) -> Record:
    """Q of the contract, SI; null where there is nothing to say."""
    return {
        'phi': quality.phi,
        'distance': _distance_record(quality),
        'two_sigma': _two_sigma_record(quality.spheres),
        'position': {
            'rms': float(np.sqrt(np.mean(quality.position**2))),
            'mean': float(quality.position.mean()),
            'max': float(quality.position.max()),
        },
        'measuring_arm': {
            'basis': BASIS,
            'single_point': _single_point_record(quality),
            'length': _length_record(quality),
        },
        'standards': standards_record(quality),
    }


def standards_record(quality: Quality) -> Record:
    """Quantities of ISO 10360-12 and ISO 9283, m; null where the poses do not tell them."""
    found, length = standard_figures(quality), _length_record(quality)
    located = _largest(quality, found.location_error)
    accuracy = _largest(quality, found.accuracy)
    repeated = _largest(quality, found.repeatability)
    known = found.location_error[np.isfinite(found.location_error)]
    distances = found.distance_accuracy
    spread = found.distance_repeatability[np.isfinite(found.distance_repeatability)]
    return {
        'basis': STANDARDS_BASIS,
        'location_error': located[0],
        'location_error_mean': float(known.mean()) if len(known) else None,
        'location_error_location': located[1],
        'location_error_sphere': located[2],
        'length_error': length['max_deviation'] if length is not None else None,
        'pose_accuracy': accuracy[0],
        'pose_accuracy_location': accuracy[1],
        'pose_accuracy_sphere': accuracy[2],
        'pose_repeatability': repeated[0],
        'pose_repeatability_location': repeated[1],
        'pose_repeatability_sphere': repeated[2],
        'distance_accuracy': float(distances[np.argmax(np.abs(distances))])
        if len(distances)
        else None,
        'distance_repeatability': float(spread.max()) if len(spread) else None,
    }


def _largest(quality: Quality, values: Array) -> tuple[float | None, int | None, int | None]:
    """The largest of values by sphere (S,), and its location and sphere."""
    if not np.isfinite(values).any():
        return None, None, None
    row = int(np.nanargmax(values))
    location, sphere = quality.spheres.keys[row]
    return float(values[row]), int(location), int(sphere)


def left_out_record(left_out: LeftOut) -> Record:
    """How a calibration does on what it is not told, m; the `factor` has no unit."""
    distance = left_out.distance
    return {
        'by': left_out.by,
        'folds': left_out.folds,
        'position': vars(left_out.position),
        'distance': vars(distance) if distance is not None else None,
        'factor': left_out.factor,
    }


def left_out_words(record: Record) -> str:
    """The same in a sentence: what is to be expected where nobody probed."""
    position = record['position']
    where, part = LEFT_OUT_WORDS[record['by']]
    text = (
        f'{where}: {position["rms"] * 1e3:.4f} mm, stated {position["stated"] * 1e3:.4f} mm '
        f'(rms of poses, {record["folds"]} {part} left out in turn)'
    )
    if record['factor'] > 1:
        text += f'; all stated uncertainties are {record["factor"]:.2g} times as large for it'
    return text


def _distance_record(quality: Quality) -> Record:
    error = quality.distance
    if len(error) == 0:
        ends = [f'{end}_{name}' for end in ('max', 'min') for name in ('location', 'pair')]
        return {'count': 0, **dict.fromkeys(('max', 'mean', 'rms', 'min', *ends))}
    record: Record = {
        'count': len(error),
        'max': float(error.max()),
        'mean': float(error.mean()),
        'rms': float(np.sqrt(np.mean(error**2))),
        'min': float(error.min()),
    }
    for end, row in (('max', int(np.argmax(error))), ('min', int(np.argmin(error)))):
        record[f'{end}_location'], record[f'{end}_pair'] = _pair(quality, row)
    return record


def _pair(quality: Quality, row: int) -> tuple[int, list[int]]:
    """The location and the two sphere numbers of a distance."""
    first, second = quality.spheres.keys[quality.pairs[row]]
    return int(first[0]), [int(first[1]), int(second[1])]


def _two_sigma_record(spheres: ProbedSpheres) -> Record:
    known = np.isfinite(spheres.two_sigma).all(axis=1)
    if not known.any():
        names = ('location', 'sphere', 'coordinate')
        ends = [f'{end}_{name}' for end in ('max', 'min') for name in names]
        return {**dict.fromkeys(('max', 'mean', 'min', *ends)), 'mean_xyz': [None] * 3}
    values, keys = spheres.two_sigma[known], spheres.keys[known]
    record: Record = {
        'max': float(values.max()),
        'mean': float(values.mean()),
        'min': float(values.min()),
        'mean_xyz': values.mean(axis=0).tolist(),
    }
    for end, place in (('max', np.argmax(values)), ('min', np.argmin(values))):
        row, coordinate = np.unravel_index(int(place), values.shape)
        record[f'{end}_location'], record[f'{end}_sphere'] = map(int, keys[row])
        record[f'{end}_coordinate'] = COORDINATES[int(coordinate)]
    return record


def _single_point_record(quality: Quality) -> Record | None:
    """The worst of all seats; null where no sphere was probed twice."""
    found = articulation(quality)
    if len(found.sphere) == 0:
        return None
    farthest, widest = int(np.argmax(found.max_deviation)), int(np.argmax(found.two_s))
    at_max, at_two_s = quality.spheres.keys[found.sphere[[farthest, widest]]].tolist()
    values = (
        len(found.sphere),
        int(found.points.sum()),
        float(found.max_deviation[farthest]),
        *at_max,
        float(found.two_s[widest]),
        float(found.two_s.mean()),
        *at_two_s,
    )
    return dict(zip(SINGLE_POINT, values, strict=True))


def _length_record(quality: Quality) -> Record | None:
    """The lengths measured between single probings; null where there is no certified distance."""
    found = lengths(quality)
    if len(found.deviation) == 0:
        return None
    worst = int(np.argmax(np.abs(found.deviation)))
    row = int(found.pair[worst])
    values = (
        len(found.deviation),
        float(found.deviation[worst]),
        *_pair(quality, row),
        float(quality.nominal[row]),
        float(found.deviation.mean()),
        found.two_rms,
        found.span,
    )
    return dict(zip(LENGTH, values, strict=True))


def _numbers(values: Array) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]
