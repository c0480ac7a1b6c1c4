# SPDX-License-Identifier: Apache-2.0
"""The simulated world in processes of its own: one seed, one measurement."""

import time

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from process_graph import Graph, graph as graph  # noqa: F401

from calib_bringup.processes import Child
from calib_model.bags import read_measurement

pytestmark = [pytest.mark.system, pytest.mark.timeout(150)]


def ended(node: Child) -> None:
    node.process.terminate()
    node.process.wait(20)


def test_one_seed_gives_the_same_poses_however_long_the_arm_stood_before(graph: Graph):
    graph.world.write_text('seed: 7\npsd: {amplifier_noise: 3.0e-10, photocurrent: 1.0e-6}\n')
    bags = []
    for number, idle in enumerate((0.0, 0.7)):
        arm = graph.arm(f'arm_{number}', scale=0.0, noise=2e-6)
        probe = graph.probe(f'probe_{number}')
        graph.until(arm, 'simulated arm')
        time.sleep(idle)
        output = graph.folder / f'bag_{number}'
        capture = graph.capture(f'capture_{number}', poses=4, output=output)
        code, line = graph.ended(capture)
        assert code == 0, line
        ended(probe)
        ended(arm)
        bags.append(read_measurement(output).poses)
    first, second = bags
    assert len(first) == 8
    # noise is micrometres and microradians; where the first way begins, the encoders are asked
    assert first.displacement == pytest.approx(second.displacement, abs=1e-9)
    assert first.joints == pytest.approx(second.joints, abs=1e-9)
