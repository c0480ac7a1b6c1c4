# SPDX-License-Identifier: Apache-2.0
"""An arm as its controller has it and as it is: what `identify --output` wrote, read again."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

from calib_model.arrays import Array
from calib_model.descriptions import parse_arm, parse_correction, parse_probe, read_description
from calib_model.errors import CalibrationError, DataError
from calib_model.files import file_content, is_there, refuse_mixture
from calib_model.instruments import Arm, PassiveProbe, Probe
from calib_model.kinematics import Correction, ParameterTable, tool_motion
from calib_model.transforms import RigidTransform


@dataclass(frozen=True)
class Calibrated:
    """An arm with its tool as its controller has them (nominal) and as they are (identified), and
    what was found beyond the D-H parameters."""

    nominal: Arm
    identified: Arm
    nominal_tool: RigidTransform
    identified_tool: RigidTransform
    correction: Correction | None = None

    def with_tool(self, flange_T_tool: RigidTransform) -> Calibrated:
        """The same arm with another tool, whose place on the flange is known."""
        return replace(self, nominal_tool=flange_T_tool, identified_tool=flange_T_tool)

    def tool_at(self, q: Array) -> Array:
        """Where the identified tool is (N, 3), m, when the encoders read q (N, n), rad."""
        arm = self.identified
        there = self.correction.joints(arm, q) if self.correction else q
        position = tool_motion(arm, there, self.identified_tool).position
        return position + self.correction.shifts(arm, q) if self.correction else position


def read_calibrated(folder: str | Path) -> Calibrated:
    """The calibration that `identify --output` wrote, the probe's tip as the tool.

    Raises:
        CalibrationError: a file is missing, is not what `identify` writes, or is of another result.
    """
    folder = Path(folder)
    arm = read_description(folder / 'arm.yaml', parse_arm)
    probe = read_description(folder / 'probe.yaml', parse_probe)
    refuse_mixture(folder)
    path = folder / 'result.json'
    table = ParameterTable.of(arm, probe)
    full = table.nominal.copy()
    try:
        for row in json.loads(file_content(path).decode('utf-8'))['parameters']:
            full[table.column(row['name'])] = float(row['initial'])
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be read: {error.strerror}') from error
    except (ValueError, KeyError, TypeError, RecursionError, DataError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error
    nominal, nominal_probe = table.apply(full, arm, probe)
    correction = None
    if is_there(folder / 'correction.yaml'):
        correction = read_description(folder / 'correction.yaml', parse_correction).checked(arm)
    return Calibrated(nominal, arm, tip(nominal_probe), tip(probe), correction)


def tip(probe: Probe) -> RigidTransform:
    """`flange_T_tool` of a probe: its frame, at the seated sphere's centre where it has a seat."""
    mount = probe.flange_T_probe
    if not isinstance(probe, PassiveProbe):
        return mount
    return RigidTransform(mount.apply(probe.center), mount.rotation_vector)
