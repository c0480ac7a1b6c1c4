# SPDX-License-Identifier: Apache-2.0
"""Arm, probe, operator and capture as processes on a graph of their own, for tests of what happens
when it misbehaves. In this world the arm and the gauge are as described, so what is right is known.
"""

from __future__ import annotations

import signal
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

from calib_bringup.processes import Child, Children, graph_environment
from calib_model.bags import read_measurement, read_messages, recover
from calib_model.descriptions import parse_placements, probe_yaml
from calib_model.errors import BagError
from calib_model.kinematics import points
from calib_model.measurement import Measurement, ProbingSet

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'ros2_ws/src/calib_bringup/config'
PLACES = CONFIG / 'locations/kr5.yaml'
ARM, PROBE = 'calib_capture.nodes.arm_node', 'selfcenter_probe.nodes.probe_node'
OPERATOR, CAPTURE = 'selfcenter_probe.nodes.operator_node', 'calib_capture.nodes.capture_node'
RIGHT = 1e-6  # m: what PSDs of 16 bits round to is less


class Graph:
    """Starts nodes on one domain, and reads what they say."""

    def __init__(self, children: Children, domain: int, folder: Path) -> None:
        self.env, self.folder = graph_environment(domain), folder
        self._children = children
        self.world = folder / 'world.yaml'
        self.world.write_text('seed: 1\nnoise: none\n')  # and nothing is off

    def start(
        self, name: str, module: str, *more: str, terminal: int | None = None, **parameters: object
    ) -> Child:
        given = ['--ros-args', *more]
        for key, value in parameters.items():
            given += ['-p', f'{key}:={value}']
        log = self.folder / f'{name}.log'
        child = Child(name, module, given, self.env, log, terminal=terminal)
        return self._children.start(child)

    def arm(self, name: str = 'arm', *more: str, scale: float = 5.0, **described: object) -> Child:
        # encoders too tell the truth: their steps and noise alone would be more than RIGHT
        given = {'time_scale': scale, 'noise': 0.0, 'step': 0.0, **described}
        return self.start(name, ARM, *more, **given)

    def probe(self, name: str = 'probe', *more: str, **described: object) -> Child:
        return self.start(name, PROBE, *more, world=self.world, **described)

    def capture(self, name: str = 'capture', poses: int = 6, **asked: object) -> Child:
        return self.start(
            name,
            CAPTURE,
            **{
                'placements': PLACES,
                'output': self.folder / 'bag',
                'locations': '[3]',
                'spheres': '[1, 10]',
                'poses_per_sphere': poses,
                'pool': 1,
                **asked,
            },
        )

    def said(self, child: Child) -> str:
        return (self.folder / f'{child.name}.log').read_text()

    def relay(self) -> Child:
        """Passes the streams on from /raw, with faults."""
        env = {**self.env, 'PYTHONPATH': f'{ROOT}:{self.env.get("PYTHONPATH", "")}'}
        log = self.folder / 'relay.log'
        return self._children.start(Child('relay', 'tests.faulty_relay', ['1'], env, log))

    def provoked(self, relay: Child) -> None:
        """Ends the relay; it did all that it is there for."""
        relay.process.send_signal(signal.SIGINT)
        relay.process.wait(10)
        said = self.said(relay)
        assert all(
            f"'{topic} {fault}'" in said
            for topic in ('/joint_states', '/probe/displacements')
            for fault in ('dropped', 'doubled', 'out of order')
        ), said

    def until(self, child: Child, done, seconds: float = 40.0) -> None:
        """Until `done`: a text that the process says, or a function."""
        end = time.monotonic() + seconds
        while not (done in self.said(child) if isinstance(done, str) else done()):
            assert child.process.poll() is None, self.said(child)
            assert time.monotonic() < end, f'{done} did not come: {self.said(child)}'
            time.sleep(0.05)

    def ended(self, child: Child, seconds: float = 60.0) -> tuple[int, str]:
        """The exit code and the last line."""
        code = child.process.wait(seconds)
        said = self.said(child)
        assert 'Traceback' not in said, said
        return code, said.strip().splitlines()[-1]

    def poses(self, bag: str = 'bag') -> int:
        """How many there are by now."""
        files = self.folder / bag
        try:
            return sum(each.topic == '/capture/poses' for each in read_messages(files))
        except BagError:  # not there yet, or just begun
            return 0

    def recovered(self, bag: str = 'bag') -> Measurement:
        """The bag opens, nothing is missing in it, and `recover` gives the same."""
        again = self.folder / f'{bag}_recovered_{time.monotonic_ns()}'
        found = recover(self.folder / bag, again)
        assert not found.lossy, found.loss()
        measured, back = read_measurement(self.folder / bag), read_measurement(again)
        assert back.arm == measured.arm
        assert probe_yaml(back.probe) == probe_yaml(measured.probe)
        assert back.gauge == measured.gauge
        for column in fields(ProbingSet):
            theirs, ours = (getattr(each.poses, column.name) for each in (back, measured))
            assert theirs.tobytes() == ours.tobytes(), column.name
        return measured

    def right(self, bag: str = 'bag') -> int:
        """How many poses are in the bag, each with its sphere where that really is."""
        measured = self.recovered(bag)
        poses, gauge = measured.poses, measured.gauge
        places = parse_placements(PLACES.read_text(), 'kr5.yaml')
        truth = np.array(
            [
                places[int(location)].apply(gauge.center(int(sphere)))
                for location, sphere in zip(poses.location, poses.sphere, strict=True)
            ]
        )
        seen = points(
            measured.arm, poses.joints, measured.probe.flange_T_probe.apply(measured.centers())
        )
        off = np.linalg.norm(seen - truth, axis=1)
        assert off.max() < RIGHT, off
        return len(poses)


class Peer:
    """A node of the test's own on the graph."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('gripper', context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def heard(self, kind: type, topic: str) -> list:
        """Fills with the messages of a topic."""
        heard: list = []
        qos = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def graph(domain, tmp_path):
    with Children() as children:
        yield Graph(children, domain, tmp_path)


@pytest.fixture
def peer(graph, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    peer = Peer(int(graph.env['ROS_DOMAIN_ID']))
    yield peer
    peer.close()
