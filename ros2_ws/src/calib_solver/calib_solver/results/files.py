# SPDX-License-Identifier: Apache-2.0
"""Results as the contract lists them: `result.json` and the files beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from calib_model import urdf
from calib_model.descriptions import arm_yaml, correction_yaml, probe_yaml
from calib_model.errors import CalibrationError
from calib_model.files import RESULT_FILES, encoded, file_hashes, refuse_unwritable, replace_set
from calib_model.instruments import CLASSIC, MODIFIED, Arm, Probe
from calib_model.kinematics import KINDS, Correction
from calib_model.transforms import RigidTransform
from calib_solver.fitting import Fit, ParameterEstimate, ProbeFit
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.results.corrections import correction_record, estimate_record, joint_errors_record
from calib_solver.results.diagnostics import diagnostics_record
from calib_solver.results.quality import (
    Record,
    left_out_record,
    quality_record,
    sphere_records,
)
from calib_solver.results.readings import readings_record
from calib_solver.results.resampling import resampling_record
from calib_solver.results.uncertainty import UNCERTAINTY, Stating, uncertainty_text

if TYPE_CHECKING:
    from calib_solver.resampling import Resampled

SCHEMA = 1


class Corrected(Stating, Protocol):
    """An identification of either kind, as far as its files go."""

    @property
    def arm(self) -> Arm:
        """The arm as it is."""
        ...

    @property
    def probe(self) -> Probe:
        """The probe, or the first target, on its flange."""
        ...

    @property
    def correction(self) -> Correction | None:
        """What is corrected beyond the D-H parameters."""
        ...


def result_record(
    done: Identification, held_out: HeldOut | None = None, resampled: Resampled | None = None
) -> Record:
    """The content of `result.json`; `resampled` is what repetitions say of the uncertainties."""
    corrected = held_out.corrected if held_out is not None else None
    return {
        'schema': SCHEMA,
        'arm': done.arm.name,
        'objective': done.options.objective,
        'convention': {'parameters': CLASSIC, 'described_in': done.arm.described_in},
        'parameters': parameter_records(done.estimates),
        'flange_T_probe': transform_record(done.probe.flange_T_probe),
        'spheres': sphere_records(done.identified.spheres),
        'quality': {
            'initial': quality_record(done.initial),
            'identified': quality_record(done.identified),
            'test': quality_record(held_out.identified) if held_out is not None else None,
            'test_initial': quality_record(held_out.initial) if held_out is not None else None,
            'left_out': left_out_record(done.left_out) if done.left_out is not None else None,
        },
        'solver': solver_record(done.fit, done.seconds),
        'probe_fit': probe_fit_record(done.probe_fit) if done.probe_fit is not None else None,
        'warnings': list(done.warnings),
        'rejected': [vars(one) for one in done.rejected],
        'diagnostics': diagnostics_record(done),
        'resampling': resampling_record(done, resampled) if resampled is not None else None,
        'joint_errors': joint_errors_record(done),
        'correction': correction_record(done, corrected),
        'readings': readings_record(done.problem.measured.poses),
    }


def convention_words(record: Record) -> str:
    """What the parameters' names mean where the description has others; '' where it has not."""
    if record['convention']['described_in'] != MODIFIED:
        return ''
    return (
        'parameters are in classic Denavit-Hartenberg form; the description gave modified ones '
        "(Craig's), where a, alpha and beta of each joint here are those of the next one"
    )


def solver_record(fit: Fit, seconds: float) -> Record:
    """How the solution was come to, in `seconds` in all."""
    return {
        'iterations': fit.iterations,
        'evaluations': fit.evaluations,
        'phi_initial': fit.phi_initial,
        'phi_final': fit.quadratic.phi,
        'seconds': seconds,
        'converged': fit.converged,
        'reason': fit.reason,
    }


def parameter_records(estimates: Sequence[ParameterEstimate]) -> list[Record]:
    """Every D-H and probe parameter of the table that is in use, in its order."""
    return [
        estimate_record(estimate) for estimate in estimates if estimate.parameter.kind not in KINDS
    ]


def transform_record(transform: RigidTransform) -> Record:
    """A rigid transform, m and rad."""
    return {
        'translation': transform.translation.tolist(),
        'rotation_vector': transform.rotation_vector.tolist(),
    }


def probe_fit_record(fit: ProbeFit) -> Record:
    """What eq. 15 says of itself."""
    return {
        'spheres': fit.spheres,
        'poses': fit.poses,
        'residual_rms': fit.residual_rms,
        'orthogonality_error': fit.orthogonality_error,
        'condition': fit.condition,
    }


def refuse_no_place(folder: str | Path) -> None:
    """Nothing, when results could be written to `folder` now: known before the work.

    Raises:
        CalibrationError: it is a file, may not be written, or a folder has a result's name there.
    """
    try:
        refuse_unwritable(folder, RESULT_FILES)
    except OSError as error:
        raise CalibrationError(f'{folder}: results cannot be written: {error.strerror}') from error


def write_results(
    folder: str | Path,
    done: Corrected,
    record: Record,
    report: str,
    more: Mapping[str, bytes] | None = None,
) -> list[Path]:
    """Write `result.json`, `arm.yaml`, `probe.yaml`, `arm.urdf`, `report.html`,
    `uncertainty.json`, and `correction.yaml` where there is something beyond the D-H parameters.

    They take the place of an earlier result's files in one step, and those that this one has not
    are taken away; `files` of the record says what belongs together. `more` are further files of
    the result; `report` is the page's text.

    Raises:
        CalibrationError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    texts = {
        'arm.yaml': arm_yaml(done.arm),
        # what simulates it is not what it is
        'probe.yaml': probe_yaml(replace(done.probe, simulated=False)),
        'arm.urdf': urdf.arm_urdf(done.arm),
        'report.html': report,
        UNCERTAINTY: uncertainty_text(done),
    }
    if done.correction is not None:
        texts['correction.yaml'] = correction_yaml(done.correction)
    contents = {name: encoded(text) for name, text in texts.items()} | dict(more or {})
    listed = {**record, 'files': file_hashes(contents)}
    text = json.dumps(listed, indent=1, allow_nan=False) + '\n'
    contents['result.json'] = text.encode('utf-8')
    try:
        replace_set(folder, contents, RESULT_FILES)
    except OSError as error:
        raise CalibrationError(f'{folder}: results cannot be written: {error.strerror}') from error
    return [folder / name for name in contents]
