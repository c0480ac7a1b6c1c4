# SPDX-License-Identifier: Apache-2.0
"""Eq. 15 from bags: what `/fit_probe` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib_model.descriptions import probe_yaml
from calib_model.errors import CalibrationError
from calib_model.files import HeldFolder, encoded, is_there
from calib_solver.calibration.sources import Sources, load
from calib_solver.fitting import fit_probe, with_the_arms_share
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.results import Record, probe_fit_record, sphere_records, transform_record


@dataclass(frozen=True)
class Fitted:
    """The fit as a record, a sentence about it, and the files written."""

    record: Record
    verdict: str
    written: tuple[Path, ...]


def fit_probe_from(sources: Sources, output: str = '') -> Fitted:
    """Fit P by eq. 15 and, when `output` names a folder, write `probe.yaml` there.

    Raises:
        CalibrationError: the bag cannot be used, the readings leave P undetermined, or the file
            cannot be written.
    """
    if output and is_there(Path(output) / 'result.json', writing=True):
        raise CalibrationError(
            f'{output}: holds what identify wrote, and its probe.yaml: name another folder'
        )
    measured = load(sources)
    problem = Problem.of(measured)
    fit = with_the_arms_share(problem, fit_probe(problem))
    probe = measured.probe.mounted(fit.flange_T_probe)
    record: Record = {
        'flange_T_probe': transform_record(fit.flange_T_probe),
        'standard_uncertainty': fit.standard_uncertainty.tolist(),
        'spheres': sphere_records(assess(problem, measured.arm, probe).spheres),
        'probe_fit': probe_fit_record(fit),
    }
    written: tuple[Path, ...] = ()
    if output:
        path = Path(output) / 'probe.yaml'
        try:
            with HeldFolder(output, make=True) as folder:
                folder.write_together({path.name: encoded(probe_yaml(probe))})
        except OSError as error:
            raise CalibrationError(f'{output}: cannot be written: {error.strerror}') from error
        written = (path,)
    verdict = (
        f'P from {fit.poses} poses of {fit.spheres} spheres, '
        f'residual {fit.residual_rms * 1e3:.4f} mm rms; '
        'the uncertainty takes it for errors of the arm, which is not calibrated here'
    )
    return Fitted(record, verdict, written)
