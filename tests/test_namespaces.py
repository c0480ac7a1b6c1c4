# SPDX-License-Identifier: Apache-2.0
"""Two arms in one graph, each in a namespace, measured side by side."""

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from process_graph import (  # noqa: F401
    CAPTURE,
    PLACES,
    Graph,
    graph as graph,
    peer as peer,
)

pytestmark = [pytest.mark.system, pytest.mark.timeout(150)]
SIDES = ('left', 'right')


def test_two_arms_are_measured_side_by_side_and_nothing_is_left_outside(graph: Graph, peer):
    captures = {}
    for side in SIDES:
        there = ('-r', f'__ns:=/{side}')
        graph.arm(f'{side}_arm', *there, scale=0.0)
        graph.probe(f'{side}_probe', *there)
        captures[side] = graph.start(
            side,
            CAPTURE,
            *there,
            placements=PLACES,
            output=graph.folder / side,
            locations='[3]',
            spheres='[1, 10]',
            poses_per_sphere=4,
            pool=1,
        )
    for side, capture in captures.items():
        code, line = graph.ended(capture)
        assert code == 0, line
        assert graph.right(side) == 8
    wanted, names = {f'/{side}/joint_states' for side in SIDES}, set()
    while not wanted <= names:
        peer.spin(0.1)
        names = {name for name, _ in peer.node.get_topic_names_and_types()}
    outside = {name for name in names if not name.startswith(tuple(f'/{s}/' for s in SIDES))}
    assert outside <= {'/parameter_events', '/rosout'}
    assert 'simulated arm, no hardware' in (graph.folder / 'left_arm.log').read_text()
    assert 'simulated probe, no hardware' in (graph.folder / 'left_probe.log').read_text()
