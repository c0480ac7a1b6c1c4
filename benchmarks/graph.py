# SPDX-License-Identifier: Apache-2.0
"""The graph at work: nodes as processes, what they say at their ends, and a bare round trip."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measuring import Part, Row, Target
from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment

PATIENCE = 600.0  # s
#: the operator's motion around this sphere takes 61 s
LED = {'locations': [3], 'spheres': [6], 'speed': 0.84, 'probe': 'active', 'wait': 60.0}
ROUND_TRIP = 'round trip of two rclpy processes'
#: poses per second that are asked for
PACE = 300.0
ROUND_TRIPS = 5000


class Graph:
    """Modules as processes on a graph of their own, their logs in `folder`."""

    def __init__(self, folder: Path, children: Children) -> None:
        self._folder, self._children = folder, children
        self._env = graph_environment(held_domain())

    def start(self, name: str, module: str, parameters: Mapping[str, object]) -> Child:
        """`python -m module` with parameters."""
        given = ['--ros-args']
        for key, value in parameters.items():
            given += ['-p', f'{key}:={json.dumps(value)}']
        return self._children.start(
            Child(name, module, given, self._env, self._folder / f'{name}.log')
        )

    def said(self, name: str, pattern: str, seconds: float = 10.0) -> tuple[float, ...]:
        """The numbers in a line of a log that is there already or comes in so many seconds."""
        end = time.monotonic() + seconds
        while True:
            text = (self._folder / f'{name}.log').read_text(encoding='utf-8')
            found = re.search(pattern, text)
            if found is not None:
                return tuple(float(number) for number in found.groups())
            if time.monotonic() > end:
                raise RuntimeError(f'{name} never said {pattern!r} but {text[-300:]!r}')
            time.sleep(0.05)


def streams() -> Part:
    """A minute of 500 Hz displacements and 250 Hz joint states, paired live: is one lost?"""
    with TemporaryDirectory() as name, Children() as children:
        folder = Path(name)
        graph = Graph(folder, children)
        graph.start('operator', 'selfcenter_probe.nodes.operator_node', LED)
        begun = time.monotonic()
        capture = graph.start(
            'capture',
            'calib_capture.nodes.capture_node',
            {
                'mode': 'continuous',
                'output': 'bag',
                'placements': _faro_places(),
            },
        )
        children.wait(capture, PATIENCE)
        seconds = time.monotonic() - begun
        _, readings = graph.said('operator', r'(\d+) joint states, (\d+) readings')
        poses, taken, paired = graph.said(
            'capture', r'(\d+) poses of .* from (\d+) readings, (\d+) paired'
        )
    figures = {
        'published': readings,
        'accounted': taken,
        'paired': paired,
        'refused': taken - paired,
        'poses': poses,
    }
    note = ', '.join(f'{count:.0f} {what}' for what, count in figures.items())
    rows = (Row('operator to bag', seconds, None, '', note, figures),)
    lost = Target('readings neither paired nor refused', abs(readings - taken), 0.0)
    return Part('streams of 500 Hz and 250 Hz, paired live', rows, (lost,))


def stepped_capture(rounds: int = 3) -> Part:
    """A program through arm, probe and capture in stepped simulation, and a bare round trip."""
    runs = []
    with TemporaryDirectory() as name, Children() as children:
        graph = Graph(Path(name), children)
        graph.start('arm', 'calib_capture.nodes.arm_node', {'time_scale': 0.0})
        graph.start('probe', 'selfcenter_probe.nodes.probe_node', {'seed': 1})
        for number in range(rounds):
            capture = graph.start(
                f'capture_{number}',
                'calib_capture.nodes.capture_node',
                {
                    'output': f'bag_{number}',
                    'poses_per_sphere': 200,
                    'pool': 1,
                    'locations': [1, 2],
                    'between_locations': 'simulated',
                },
            )
            children.wait(capture, PATIENCE)
            taken, seconds = graph.said(f'capture_{number}', r'(\d+) poses taken, .* in ([\d.]+) s')
            runs.append((seconds / taken, taken))
    bare = round_trip()
    pose, taken = min(runs)
    rows = (
        Row(ROUND_TRIP, bare),
        Row(
            'a pose, commanded to on disk',
            pose,
            pose / bare,
            ROUND_TRIP,
            f'{1 / pose:.0f} poses per second',
            {'poses': taken, 'poses per second': 1 / pose},
        ),
    )
    limit = Target('seconds per pose', pose, 1 / PACE)
    title = f'{taken:.0f} poses in stepped simulation, three processes, the best of {rounds}'
    return Part(title, rows, (limit,))


def round_trip() -> float:
    """Seconds that a message takes to another process and back, in lock-step."""
    with TemporaryDirectory() as name, Children() as children:
        env, folder = graph_environment(held_domain()), Path(name)
        here = str(Path(__file__).resolve().parents[1])
        env['PYTHONPATH'] = ':'.join(filter(None, (here, env.get('PYTHONPATH', ''))))
        module = 'benchmarks.round_trip_node'
        children.start(Child('echo', module, ['echo'], env, folder / 'echo.log'))
        asker = Child('ask', module, ['ask', str(ROUND_TRIPS)], env, folder / 'ask.log', False)
        children.start(asker)
        children.wait(asker, PATIENCE)
        return float((folder / 'ask.log').read_text(encoding='utf-8').split()[-1])


def _faro_places() -> str:
    from ament_index_python.packages import get_package_share_directory

    return str(Path(get_package_share_directory('calib_bringup')) / 'config/locations/faro.yaml')
