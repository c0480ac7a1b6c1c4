# SPDX-License-Identifier: Apache-2.0
"""Design a measuring program: how sure is the arm after one, two, ... places of the bar?

python examples/measuring_program.py

Needs what plans: Pinocchio and EAIK (`pip install '.[planning]'` without ROS).
"""

from pathlib import Path

from calib_capture import Planner, ProgramSettings
from calib_model import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.descriptions import parse_placements

config = Path('ros2_ws/src/calib_bringup/config')
arm = read_description(config / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
probe = read_description(config / 'probes/active_trihedron.yaml', parse_probe)
gauge = read_description(config / 'gauges/ball_bar_kr5.yaml', parse_gauge)
places = read_description(config / 'locations/kr5.yaml', parse_placements)

# few poses, chosen at random (pool=1), so that this takes seconds; a real program chooses
planner = Planner(arm, probe, gauge, ProgramSettings(poses_per_sphere=6, pool=1, seed=1))
print('places       poses   expected standard uncertainty of a position')
for count in (1, 2, 4):
    chosen = sorted(places)[:count]
    program = planner.program(places, chosen)
    assert program.expected is not None
    named = ' '.join(map(str, chosen))
    print(f'{named:10} {len(program.poses):7} {program.expected.after * 1e3:11.4f} mm')
