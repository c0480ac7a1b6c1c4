# SPDX-License-Identifier: Apache-2.0
"""Five public URDFs all the way: described, identified, corrected, and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from simulated_calibration import active, passive, simulate
from urdf_files import PUBLIC, public_urdf, through_pinocchio

from calib_model.bags import write_measurement
from calib_model.commands.arm_from_urdf import main as arm_from_urdf
from calib_model.descriptions import parse_arm, read_description
from calib_model.kinematics import forward_kinematics
from calib_solver.commands.identify import main as identify_command, run as identify

pytestmark = pytest.mark.timeout(60)


@pytest.mark.slow
@pytest.mark.parametrize('name', PUBLIC)
def test_a_public_urdf_is_described_identified_and_corrected(name: str, tmp_path: Path) -> None:
    urdf, base, flange = public_urdf(name)
    described = tmp_path / 'arm.yaml'
    given = [str(urdf), '--base', base, '--flange', flange, str(described)]
    assert arm_from_urdf(given) == 0
    nominal = read_description(described, parse_arm)
    probe = passive() if name == 'panda' else active()
    scene = simulate(nominal, probe, seed=1, locations=3, poses=8, noise=1e-5)
    write_measurement(tmp_path / 'bag', scene.measured)
    output = tmp_path / 'result'
    done = identify([str(tmp_path / 'bag'), '--output', str(output), '--urdf', str(urdf)]).done
    assert done.identified.phi < 1e-2 * done.initial.phi
    arm = read_description(output / 'arm.yaml', parse_arm)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, arm.n))
    text = (output / 'robot.urdf').read_text()
    read = through_pinocchio(text, base, flange, arm.joint_names, q)
    assert np.abs(read - forward_kinematics(arm, q)).max() < 1e-9
    # and it is not simply the file that came in
    assert np.abs(read - forward_kinematics(nominal, q)).max() > 1e-5
    before, after = (t.splitlines() for t in (urdf.read_text(), text))
    changed = [old for old, new in zip(before, after, strict=True) if old != new]
    assert 0 < len(changed) <= arm.n
    assert all('<origin' in line for line in changed)


@pytest.mark.parametrize(
    ('urdf', 'said'),
    [
        (None, 'no.urdf: cannot be read: No such file or directory'),
        ('<robot name="r"><link name="hand"/></robot>', "no link 'base_link' (there are hand)"),
    ],
)
def test_a_urdf_that_cannot_be_corrected_is_one_line(
    urdf: str | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = Path(__file__).resolve().parents[1] / 'bags' / 'demo' / 'identification'
    path = tmp_path / ('no.urdf' if urdf is None else 'my.urdf')
    if urdf is not None:
        path.write_text(urdf)
    given = [str(bag), '--urdf', str(path)]
    assert identify_command([*given, '--output', str(tmp_path / 'out')]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / 'out' / 'robot.urdf').exists()
    assert identify_command(given) == 2
    assert '--urdf needs --output DIR' in capsys.readouterr().err
