# SPDX-License-Identifier: Apache-2.0
"""`uncertainty.json`: where the errors of a calibration's parameters come from, and its gauge.

Kept apart from `result.json`, which people read: what `verify` and `compare` need of a calibration
to say what it can tell from another one and what it cannot.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import gauge_yaml, parse_gauge
from calib_model.errors import CalibrationError
from calib_model.files import file_content
from calib_model.instruments import Gauge
from calib_model.kinematics import ParameterTable
from calib_solver.fitting import ErrorShares, PoseNoise
from calib_solver.left_out import LeftOut
from calib_solver.points import PlaceShares, StationShare

UNCERTAINTY = 'uncertainty.json'


@dataclass(frozen=True)
class StatedErrors:
    """The errors of the free parameters `names` (F,) by where they come from, those by noise
    enlarged as all stated uncertainties are; `gauge` is as long as it was taken to be, None of
    measured points, of which targets and stations err as `places` says."""

    names: tuple[str, ...]
    shares: ErrorShares
    gauge: Gauge | None
    places: PlaceShares | None = None


class Stating(Protocol):
    """An identification of either kind, as far as its uncertainties go."""

    @property
    def table(self) -> ParameterTable:
        """All parameters, free ones among them."""
        ...

    @property
    def error_shares(self) -> ErrorShares:
        """Where the error of the free parameters comes from."""
        ...

    @property
    def left_out(self) -> LeftOut | None:
        """What parts left out say of it."""
        ...

    @property
    def place_shares(self) -> PlaceShares | None:
        """Where the errors of targets and stations come from, where there are any."""
        ...

    @property
    def gauge(self) -> Gauge | None:
        """What was probed; measured points have none."""
        ...


def uncertainty_text(done: Stating) -> str:
    """The file's content."""
    shares = done.error_shares
    factor = done.left_out.factor if done.left_out is not None else 1.0
    gauge = done.gauge
    record = {
        'schema': 1,
        'parameters': [parameter.name for parameter in done.table.free],
        'noise': (factor**2 * shares.noise).tolist(),
        'certificate': shares.certificate.tolist(),
        'prior': shares.prior.tolist(),
        'width': shares.width.tolist(),
        'poses': {
            'point': float(np.sqrt(shares.poses.point)),
            'joints': np.sqrt(shares.poses.joints).tolist(),
            'freedom': shares.poses.freedom,
        },
        'gauge': gauge_yaml(gauge.as_certified()) if gauge is not None else None,
        'temperature': _temperature(gauge) if gauge is not None else None,
        'places': _places_record(done.place_shares, factor**2),
    }
    return json.dumps(record, allow_nan=False) + '\n'


def _places_record(places: PlaceShares | None, times: float) -> dict[str, Any] | None:
    if places is None:
        return None
    return {
        'unit_sigma': places.unit_sigma,
        'scatter': [
            {'target': target, 'station': station, 'times': times}
            for target, station, times in places.scatter
        ],
        'targets': list(places.targets),
        'noise': (times * places.noise).tolist(),
        'prior': places.prior.tolist(),
        'stations': [
            {
                'station': one.number,
                'along': one.along.tolist(),
                'own': (times * one.own).tolist(),
                'common': (times * one.common).tolist(),
            }
            for one in places.stations
        ],
    }


def _temperature(gauge: Gauge) -> dict[str, float] | None:
    if gauge.scale is None:
        return None
    return {
        'celsius': gauge.scale.temperature,
        'uncertainty': gauge.temperature_uncertainty,
    }


def needed_content(path: Path) -> bytes:
    """A file of a result that older versions did not write.

    Raises:
        CalibrationError: it is missing or cannot be read.
    """
    try:
        return file_content(path)
    except FileNotFoundError as error:
        raise CalibrationError(
            f'{path}: there is none: the result is of a version without it, identify it anew'
        ) from error
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be read: {error.strerror}') from error


def read_uncertainty(folder: str | Path) -> StatedErrors:
    """The errors that the calibration in a folder states.

    Raises:
        CalibrationError: the file is missing, as in results of older versions, or is no such file.
    """
    path = Path(folder) / UNCERTAINTY
    content = needed_content(path)
    try:
        return _stated(json.loads(content.decode('utf-8')), str(path))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error


def _stated(record: dict[str, Any], source: str) -> StatedErrors:
    names = tuple(map(str, record['parameters']))
    gauge = parse_gauge(record['gauge'], source) if record['gauge'] is not None else None
    free, centers = len(names), 3 * len(gauge.spheres) if gauge is not None else 0
    warmth = record['temperature']
    if warmth is not None and gauge is not None:
        gauge = gauge.at(float(warmth['celsius']), float(warmth['uncertainty']))
    poses = record['poses']
    noise = PoseNoise(
        float(poses['point']) ** 2,
        np.array(poses['joints'], dtype=float) ** 2,
        int(poses['freedom']),
    )
    shares = ErrorShares(
        _matrix(record, 'noise', (free, free)),
        _matrix(record, 'certificate', (free, centers)),
        _matrix(record, 'prior', (free, free)),
        _matrix(record, 'width', (free,)),
        noise,
    )
    return StatedErrors(names, shares, gauge, _places(record.get('places'), free))


def _places(record: dict[str, Any] | None, free: int) -> PlaceShares | None:
    if record is None:
        return None
    targets = tuple(map(str, record['targets']))
    size = free + 6 * len(targets)
    stations = tuple(
        StationShare(
            int(one['station']),
            _matrix(one, 'along', (6, size)),
            _matrix(one, 'own', (6, 6)),
            _matrix(one, 'common', (size, 6)) if 'common' in one else np.zeros((size, 6)),
        )
        for one in record['stations']
    )
    noise, prior = _matrix(record, 'noise', (size, size)), _matrix(record, 'prior', (size, free))
    scatter = tuple(
        (str(one['target']), int(one['station']), float(one['times']))
        for one in record.get('scatter', ())
    )
    unit_sigma = float(record.get('unit_sigma', 0.0))
    return PlaceShares(targets, noise, prior, stations, unit_sigma, scatter)


def _matrix(record: dict[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    values = np.array(record[name], dtype=float)
    if values.shape != shape:
        raise ValueError(f'{name}: expected {shape} numbers, got {values.shape}')
    return values
