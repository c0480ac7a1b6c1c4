# SPDX-License-Identifier: Apache-2.0
"""Results as the contract lists them: `result.json` and the files beside it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from calib_model.bag_writer import write_whole
from calib_model.description import arm_yaml, probe_yaml
from calib_model.errors import CalibrationError
from calib_model.rotation import Array, RigidTransform
from calib_model.urdf import arm_urdf
from calib_solver.account import accounts
from calib_solver.diagnostics import diagnostics_record
from calib_solver.identification import Identification
from calib_solver.probe_fit import ProbeFit
from calib_solver.quality import COORDINATES, ProbedSpheres, Quality
from calib_solver.resampling import Resampled
from calib_solver.resampling_record import resampling_record

SCHEMA = 1
Record = dict[str, Any]


def result_record(
    done: Identification, test: Quality | None = None, resampled: Resampled | None = None
) -> Record:
    """The content of `result.json`; `test` is the quality on a held-out bag, `resampled` what
    repetitions say of the uncertainties."""
    return {
        'schema': SCHEMA,
        'arm': done.arm.name,
        'objective': done.options.objective,
        'parameters': parameter_records(done),
        'flange_T_probe': transform_record(done.probe.flange_T_probe),
        'spheres': sphere_records(done.identified.spheres),
        'quality': {
            'initial': quality_record(done.initial),
            'identified': quality_record(done.identified),
            'test': quality_record(test) if test is not None else None,
        },
        'solver': {
            'iterations': done.fit.iterations,
            'evaluations': done.fit.evaluations,
            'phi_initial': done.fit.phi_initial,
            'phi_final': done.fit.quadratic.phi,
            'seconds': done.seconds,
            'converged': done.fit.converged,
            'reason': done.fit.reason,
        },
        'probe_fit': probe_fit_record(done.probe_fit) if done.probe_fit is not None else None,
        'warnings': list(done.warnings),
        'rejected': [vars(one) for one in done.rejected],
        'diagnostics': diagnostics_record(done),
        'resampling': resampling_record(done, resampled) if resampled is not None else None,
    }


def parameter_records(done: Identification) -> list[Record]:
    """Every parameter of the table that is in use, in its order."""
    return [
        {
            'name': account.parameter.name,
            'unit': account.parameter.unit,
            'initial': account.parameter.nominal,
            'identified': account.identified,
            'standard_uncertainty': account.standard_uncertainty,
            'free': account.parameter.free,
            'identifiable': account.identifiable,
            'reason': account.reason,
        }
        for account in accounts(done)
    ]


def transform_record(transform: RigidTransform) -> Record:
    """A rigid transform, m and rad."""
    return {
        'translation': transform.translation.tolist(),
        'rotation_vector': transform.rotation_vector.tolist(),
    }


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
    }


def _distance_record(quality: Quality) -> Record:
    error, keys = quality.distance, quality.spheres.keys
    if len(error) == 0:
        nothing = dict.fromkeys(('max', 'mean', 'rms', 'min', 'max_location', 'max_pair'))
        return {'count': 0, **nothing}
    worst = int(np.argmax(error))
    first, second = quality.pairs[worst]
    return {
        'count': len(error),
        'max': float(error.max()),
        'mean': float(error.mean()),
        'rms': float(np.sqrt(np.mean(error**2))),
        'min': float(error.min()),
        'max_location': int(keys[first, 0]),
        'max_pair': [int(keys[first, 1]), int(keys[second, 1])],
    }


def _two_sigma_record(spheres: ProbedSpheres) -> Record:
    known = np.isfinite(spheres.two_sigma).all(axis=1)
    if not known.any():
        names = ('max', 'mean', 'min', 'max_location', 'max_sphere', 'max_coordinate')
        return {**dict.fromkeys(names), 'mean_xyz': [None] * 3}
    values, keys = spheres.two_sigma[known], spheres.keys[known]
    sphere, coordinate = np.unravel_index(int(np.argmax(values)), values.shape)
    return {
        'max': float(values.max()),
        'mean': float(values.mean()),
        'min': float(values.min()),
        'max_location': int(keys[sphere, 0]),
        'max_sphere': int(keys[sphere, 1]),
        'max_coordinate': COORDINATES[int(coordinate)],
        'mean_xyz': values.mean(axis=0).tolist(),
    }


def probe_fit_record(fit: ProbeFit) -> Record:
    """Eq. 15's account of itself."""
    return {
        'spheres': fit.spheres,
        'poses': fit.poses,
        'residual_rms': fit.residual_rms,
        'orthogonality_error': fit.orthogonality_error,
        'condition': fit.condition,
    }


def _numbers(values: Array) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def write_results(
    folder: str | Path, done: Identification, record: Record, report: str
) -> list[Path]:
    """Write `result.json`, `arm.yaml`, `probe.yaml`, `arm.urdf` and `report.html`.

    Each is written whole or not at all; `report` is the page's text.

    Raises:
        CalibrationError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    texts = {
        'arm.yaml': arm_yaml(done.arm),
        'probe.yaml': probe_yaml(done.probe),
        'arm.urdf': arm_urdf(done.arm),
        'report.html': report,
        'result.json': json.dumps(record, indent=1, allow_nan=False) + '\n',
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_whole(folder / name, text)
    except OSError as error:
        raise CalibrationError(f'{folder}: results cannot be written: {error.strerror}') from error
    return [folder / name for name in texts]
