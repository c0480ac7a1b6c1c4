# SPDX-License-Identifier: Apache-2.0
"""The real KUKA's joint angles become bags that hold exactly what the tables say."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calib_model.bags import read_measurement

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get('CALIB_SHARED_DATA', ROOT.parent / 'shared' / 'data'))
SOCKETS = DATA / 'kuka_iiwa14_sockets'
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not SOCKETS.is_dir(), reason=f'no real data at {SOCKETS}'),
]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(('name', 'location'), [('front', 1), ('raised_left', 2), ('left_back', 3)])
def test_a_table_of_the_real_arm_becomes_a_bag(name: str, location: int, tmp_path: Path) -> None:
    table, bag = SOCKETS / f'{name}.csv', tmp_path / name
    command = [
        sys.executable,
        '-m',
        'calib_capture.commands.import_csv',
        str(table),
        str(bag),
        '--arm',
        str(CONFIG / 'arms' / 'kuka_lbr_iiwa14.yaml'),
        '--probe',
        str(CONFIG / 'probes' / 'seated_ball_iiwa14.yaml'),
        '--gauge',
        str(CONFIG / 'gauges' / 'two_sockets.yaml'),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stderr) == (0, '')
    rows = np.loadtxt(table, delimiter=',', skiprows=1)
    assert f'{len(rows)} poses of kuka_lbr_iiwa14' in done.stdout
    measured = read_measurement(bag)
    assert measured.poses.joints.tobytes() == np.ascontiguousarray(rows[:, 2:]).tobytes()
    assert set(measured.poses.location.tolist()) == {location}
    assert measured.poses.sphere.tolist() == rows[:, 1].astype(int).tolist()
    assert measured.gauge.distance(1, 2) == 0.05
    assert measured.arm.within_limits(measured.poses.joints).all()
