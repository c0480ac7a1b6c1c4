# SPDX-License-Identifier: Apache-2.0
"""Makes `bags/noise_free`: the demo's program probed in a world without any noise.

source env.bash && python bags/make_noise_free.py bags/noise_free
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib_capture.program import Planner, ProgramSettings
from calib_model.bags import write_measurement
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    read_description,
)
from calib_model.measurement import Measurement
from selfcenter_probe.simulation import World, parse_magnitudes, probe_postures

SOURCE = Path(__file__).parents[1] / 'ros2_ws/src'
CONFIG = SOURCE / 'calib_bringup/config'
POSES = 12
SEED = 7


def main() -> None:
    arm = read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
    probe = read_description(CONFIG / 'probes/active_trihedron.yaml', parse_probe)
    gauge = read_description(CONFIG / 'gauges/ball_bar_kr5.yaml', parse_gauge)
    placements = read_description(CONFIG / 'locations/kr5.yaml', parse_placements)
    magnitudes = read_description(SOURCE / 'selfcenter_probe/config/world.yaml', parse_magnitudes)
    settings = ProgramSettings(poses_per_sphere=POSES, pool=1, seed=SEED)
    program = Planner(arm, probe, gauge, settings).program(placements)
    generator = np.random.default_rng(SEED)
    world = World.drawn(arm, probe, gauge, placements, magnitudes.without_noise(), generator)
    joints = np.array([pose.joints for pose in program.poses])
    poses = probe_postures(world, joints, generator)
    told = replace(probe, simulated=True)
    write_measurement(sys.argv[1], Measurement(arm, told, gauge, poses))


if __name__ == '__main__':
    main()
