# SPDX-License-Identifier: Apache-2.0
"""`check` and the first seconds of a capture, on a graph with the simulated arm and probe."""

from dataclasses import replace

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
import numpy as np
from builtin_interfaces.msg import Duration
from process_graph import CONFIG, PLACES, Graph, graph as graph, peer as peer  # noqa: F401
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from calib_capture.motion import InverseKinematics
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    probe_yaml,
    read_description,
)

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]
CHECK = 'calib_capture.nodes.check_node'
WAY = 4  # s


@pytest.fixture
def arm():
    return read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)


@pytest.fixture
def probe():
    return read_description(CONFIG / 'probes/active_trihedron.yaml', parse_probe)


def on_a_sphere(arm, probe, location=3, sphere=6):
    """A posture in which the probe holds a sphere half a mm off its middle, from above."""
    gauge = read_description(CONFIG / 'gauges/ball_bar_kr5.yaml', parse_gauge)
    place = parse_placements(PLACES.read_text(), 'kr5.yaml')[location]
    wanted = np.eye(4)
    wanted[:3, :3] = place.rotation @ np.diag([1.0, -1.0, -1.0])
    reach = probe.flange_T_probe.apply(np.array([3e-4, -2e-4, 4e-4]))
    wanted[:3, 3] = place.apply(gauge.center(sphere)) - wanted[:3, :3] @ reach
    postures = InverseKinematics(arm).branches_of([wanted], [None])[0]
    return postures[int(np.argmin(np.abs(postures).max(axis=1)))]


def bring(peer, arm, posture):
    """The arm to a posture, gently, and wait until it is there."""
    states = peer.heard(JointState, '/joint_states')
    commands = peer.node.create_publisher(JointTrajectory, '/arm_controller/joint_trajectory', 1)
    rest = [0.0] * arm.n
    point = JointTrajectoryPoint(
        positions=posture.tolist(),
        velocities=rest,
        accelerations=rest,
        time_from_start=Duration(sec=WAY),
    )
    while not commands.get_subscription_count():
        peer.spin(0.1)
    commands.publish(JointTrajectory(joint_names=list(arm.joint_names), points=[point]))
    for _ in range(200):
        peer.spin(0.1)
        if states and np.abs(np.array(states[-1].position) - posture).max() < 1e-3:
            break
    else:
        raise AssertionError('the arm did not come')
    peer.node.destroy_publisher(commands)


def test_check_and_capture_name_what_is_wrong_and_nothing_else(graph: Graph, peer, arm, probe):
    first, second, third = probe.styli
    swapped = graph.folder / 'swapped.yaml'
    swapped.write_text(probe_yaml(replace(probe, styli=(second, first, third))))
    graph.arm(scale=1.0)
    graph.probe()
    bring(peer, arm, on_a_sphere(arm, probe))

    code, _ = graph.ended(well := graph.start('check', CHECK))
    said = graph.said(well).splitlines()
    assert code == 0, said
    assert not [line for line in said if line.startswith('wrong')]
    assert any('mounting: the sphere stands still to 0.00' in line for line in said)

    code, _ = graph.ended(crossed := graph.start('crossed', CHECK, probe=swapped))
    said = graph.said(crossed)
    assert code == 1, said
    assert 'mounting: styli in the order 2 1 3: then the sphere stands still' in said

    code, line = graph.ended(graph.capture(probe=swapped, speed=1.0))
    assert code == 2
    assert 'styli in the order 2 1 3' in line
    assert line.endswith('`ros2 run calib_capture check` tells more')
