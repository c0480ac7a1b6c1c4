# SPDX-License-Identifier: Apache-2.0
"""A calibration read back from its folder, with what it states of its errors."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import parse_probe, read_description
from calib_model.errors import CalibrationError
from calib_model.files import file_content
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import PROBE_PARAMETERS, JointTerms, ParameterTable
from calib_model.transforms import RigidTransform
from calib_solver.compensation import Calibrated, read_calibrated
from calib_solver.results import Record, StatedErrors, read_uncertainty


@dataclass(frozen=True)
class StoredResult:
    """What `identify --output` wrote to `folder`: its `record`, the arm and probe as they were
    identified, and where the errors of the parameters come from."""

    folder: str
    record: Record
    calibrated: Calibrated
    probe: Probe
    stated: StatedErrors

    @property
    def arm(self) -> Arm:
        """The arm as identified."""
        return self.calibrated.identified

    @cached_property
    def nominal_probe(self) -> Probe:
        """The probe where it was taken to be before."""
        rows = {row['name']: float(row['initial']) for row in self.record['parameters']}
        if PROBE_PARAMETERS[0] not in rows:
            return self.probe.mounted(RigidTransform())  # a target is no part of the parameters
        mount = np.array([rows[name] for name in PROBE_PARAMETERS])
        return self.probe.mounted(RigidTransform(mount[:3], mount[3:]))

    @property
    def date(self) -> str | None:
        """When the last reading was taken, ISO 8601; None where the readings have no date."""
        last = (self.record.get('readings') or {}).get('last')
        return str(last) if last is not None else None

    @property
    def terms(self) -> JointTerms | None:
        """Which joint errors were identified with the arm."""
        correction = self.calibrated.correction
        if correction is None or correction.joint_errors is None:
            return None
        return correction.joint_errors.terms

    @cached_property
    def table(self) -> ParameterTable:
        """All columns, the free ones those that were identified."""
        return self.table_with(self.terms)

    @cached_property
    def full(self) -> Array:
        """The identified values of all columns of the table."""
        return self.full_with(self.terms)

    def table_with(self, terms: JointTerms | None) -> ParameterTable:
        """The table at the nominal values, with columns for these joint errors."""
        table = ParameterTable.of(self.calibrated.nominal, self.nominal_probe)
        if terms is not None:
            table = table.with_joint_terms(terms)
        held = [i for i, name in enumerate(table.names) if name not in self.stated.names]
        return table.frozen_at(held, 'held')

    def full_with(self, terms: JointTerms | None) -> Array:
        """The identified values of a table with columns for these joint errors, by their names."""
        table = self.table_with(terms)
        own = ParameterTable.of(self.arm, self.probe)
        full = table.nominal.copy()
        full[: own.mount.stop] = own.nominal
        correction = self.calibrated.correction
        if self.terms is not None and correction is not None and correction.joint_errors:
            names = ParameterTable.of(self.arm, self.probe).with_joint_terms(self.terms).names
            values = correction.joint_errors.values.reshape(-1)
            for name, value in zip(names[own.mount.stop :], values, strict=True):
                full[table.column(name)] = value
        return full


def read_result(folder: str | Path) -> StoredResult:
    """The calibration in a folder.

    Raises:
        CalibrationError: a file is missing, is not what `identify` writes, or is of another
            result; names it.
    """
    calibrated = read_calibrated(folder)
    path = Path(folder) / 'result.json'
    try:
        record = json.loads(file_content(path).decode('utf-8'))
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be read: {error.strerror}') from error
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error
    probe = read_description(Path(folder) / 'probe.yaml', parse_probe)
    stated = read_uncertainty(folder)
    result = StoredResult(str(folder), record, calibrated, probe, stated)
    missing = set(stated.names) - set(result.table.names)
    if missing or not np.array_equal(
        [name for name in result.table.names if name in stated.names], stated.names
    ):
        raise CalibrationError(
            f'{path}: its parameters are not those of uncertainty.json beside it'
        )
    return result
