# SPDX-License-Identifier: Apache-2.0
"""Postures planned for a tracker, measured, imported and identified: as sure as was expected."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands import import_points, plan
from calib_model.descriptions import arm_yaml, parse_arm, read_description
from calib_model.files import shared_file
from calib_model.kinematics import points
from calib_model.transforms import RigidTransform
from calib_solver.commands import identify

NOISE = 4e-5
STATION = RigidTransform(np.array([1.8, -2.1, 0.4]), np.array([0.3, -0.5, 1.9]))
TARGET = np.array([0.03, -0.05, 0.12])


def commanded(command, monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr('sys.argv', ['command', *words])
    code: int = command.main()
    return code


def test_positions_come_out_as_sure_as_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal = read_description(
        shared_file('calib_bringup', 'config/arms/kuka_kr5_sixx_r650.yaml'), parse_arm
    )
    described, table = tmp_path / 'arm.yaml', tmp_path / 'postures.csv'
    described.write_text(arm_yaml(nominal))
    words = ['--tracker', str(NOISE), '--target', *map(str, TARGET), '--poses', '90']
    words += ['--arm', str(described), '--output', str(table), '--seed', '6']
    assert commanded(plan, monkeypatch, *words) == 0
    found = re.search(r'after calibration: ([0-9.]+) mm', capsys.readouterr().out)
    assert found
    expected = 1e-3 * float(found.group(1))

    generator = np.random.default_rng(12)
    sigma = np.array([5e-4, 1e-3, 5e-4, 2e-3, 0.0])[:, None]
    truth = nominal.with_geometry(nominal.geometry + sigma * generator.normal(size=(5, 6)))
    header, *rows = table.read_text().splitlines()
    joints = np.array([row.split(',') for row in rows], dtype=float)
    seen = STATION.apply(points(truth, joints, TARGET)) + NOISE * generator.normal(size=(90, 3))
    told = (f'{row},{x:.9f},{y:.9f},{z:.9f}' for row, (x, y, z) in zip(rows, seen, strict=True))
    table.write_text('\n'.join([f'{header},x,y,z', *told]) + '\n')

    bag, output = tmp_path / 'bag', tmp_path / 'out'
    words = [str(table), str(bag), '--arm', str(described)]
    assert commanded(import_points, monkeypatch, *words) == 0
    assert identify.main([str(bag), '--output', str(output), '--quick']) == 0
    record = json.loads((output / 'result.json').read_text())
    stated = record['diagnostics']['position_uncertainty_rms']
    # the noise is estimated from 270 numbers
    assert stated == pytest.approx(expected, rel=0.2)
    assert record['quality']['identified']['position']['count'] == 90
