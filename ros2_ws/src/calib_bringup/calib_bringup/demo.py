# SPDX-License-Identifier: Apache-2.0
"""A whole calibration in simulation: `ros2 run calib_bringup demo`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment
from calib_bringup.variants import CAPTURES, DEFAULT, VARIANTS, led_arguments
from calib_model.command_line import CommandParser, UsageError, run_command

ABOUT = """\
Calibrate a simulated arm by probing a ball bar: capture 7 locations and a held-out one, identify,
and say what it brought. Arm and probe are those of the variant:

""" + '\n'.join(f'  {name:9} {each.about}' for name, each in VARIANTS.items())
EXAMPLE = """example:
  ros2 run calib_bringup demo --seed 3 --output output/demo
  ros2 run calib_bringup demo --variant iiwa14 --poses 30
"""
RESULT, FIGURES = 'result.json', 'figures'
LOGS = (
    'arm',
    'probe',
    *(f'{how}_{name}' for how in ('capture', 'hand_guided') for name in CAPTURES),
    'identify',
    'evaluate',
)
WRITTEN = {
    *CAPTURES,
    *(f'{name}.log' for name in LOGS),
    RESULT,
    'arm.yaml',
    'probe.yaml',
    'arm.urdf',
    'correction.yaml',
    'report.html',
    'report.json',
    'report.pdf',
    'uncertainty.json',
    FIGURES,
}
CAPTURE_SECONDS = 600.0
CAPTURED = (0, 1)  # 1: some location has fewer poses than were planned, and says so
SOLVE_SECONDS = 120.0
ROWS = (
    ('distance error, mean', 'distance', 'mean'),
    ('distance error, max', 'distance', 'max'),
    ('2 sigma, mean', 'two_sigma', 'mean'),
    ('2 sigma, max', 'two_sigma', 'max'),
)
Record = dict[str, Any]


def arguments() -> CommandParser:
    """The command line of `demo`."""
    parser = CommandParser('demo', ABOUT, EXAMPLE)
    parser.add_argument(
        '--variant', choices=sorted(VARIANTS), default=DEFAULT, help='default: %(default)s'
    )
    parser.add_argument(
        '--output',
        metavar='DIR',
        help='default: output/demo, output/demo_NAME for another variant',
    )
    parser.add_argument(
        '--seed', metavar='N', type=int, default=1, help='of world and program (default: 1)'
    )
    parser.add_argument(
        '--poses', metavar='N', type=int, help='per sphere (default: 60; faro: 385)'
    )
    return parser


class Demo:
    """The steps, each leaving its files in `folder`."""

    def __init__(self, variant: str, folder: Path, seed: int, poses: int | None) -> None:
        self.variant = VARIANTS[variant]
        self.folder = folder
        self.seed = seed
        self.poses = self.variant.poses if poses is None else poses
        self._env = graph_environment(held_domain())

    def capture(self) -> None:
        """Both bags: through a graph of arm, probe and capture, or from a hand-guided arm."""
        if self.variant.led:
            self._lead()
            return
        paths = self.variant.paths
        with Children() as children:
            told = {'time_scale': 0.0, **paths('arm')}
            self._start(children, 'arm', 'calib_capture.nodes.arm_node', told)
            told = {'seed': self.seed, **paths('arm', 'probe', 'gauge', 'placements')}
            self._start(children, 'probe', 'selfcenter_probe.nodes.probe_node', told)
            for name, (locations, spheres) in CAPTURES.items():
                options = {
                    'locations': list(locations),
                    'spheres': list(spheres),
                    'seed': self.seed,
                    'poses_per_sphere': self.poses,
                    'pool': 1,
                    'between_locations': 'simulated',
                    'output': name,
                    **paths('placements'),
                }
                module = 'calib_capture.nodes.capture_node'
                capture = self._start(children, f'capture_{name}', module, options, shown=True)
                children.wait(capture, CAPTURE_SECONDS, CAPTURED)

    def _lead(self) -> None:
        with Children() as children:
            for name in CAPTURES:
                words = led_arguments(self.variant, name, self.seed, self.poses)
                hand = f'hand_guided_{name}'
                module, log = 'selfcenter_probe.commands.hand_guided', self._log(hand)
                led = children.start(Child(hand, module, words, self._env, log, shown=True))
                children.wait(led, CAPTURE_SECONDS)

    def _start(
        self, children: Children, name: str, module: str, options: Record, shown: bool = False
    ) -> Child:
        given = ['--ros-args']
        for key, value in options.items():
            given += ['-p', f'{key}:={json.dumps(value)}']
        return children.start(Child(name, module, given, self._env, self._log(name), shown))

    def identify(self) -> dict[str, Record]:
        """Identified parameters beside the bags, and the qualities of the table's columns."""
        bag, held_out = CAPTURES
        with Children() as children:
            work = {
                'identify': [bag, '--test', held_out, '--output', '.', '--figures', FIGURES],
                'evaluate': [held_out],
            }
            running = [
                Child(name, f'calib_solver.commands.{name}', given, self._env, self._log(name))
                for name, given in work.items()
            ]
            for child in running:
                children.start(child)
            for child in running:
                children.wait(child, SOLVE_SECONDS)
        quality = json.loads((self.folder / RESULT).read_text(encoding='utf-8'))['quality']
        return {
            'initial': quality['initial'],
            'identified': quality['identified'],
            'held-out initial': json.loads(self._log('evaluate').read_text(encoding='utf-8')),
            'held-out identified': quality['test'],
        }

    def _log(self, name: str) -> Path:
        return self.folder / f'{name}.log'


def table(columns: dict[str, Record]) -> str:
    """Distance errors and 2 sigma in mm, one column per quality."""
    lines = ['mm'.ljust(22) + ''.join(name.rjust(20) for name in columns)]
    for label, group, key in ROWS:
        cells = ''.join(f'{record[group][key] * 1e3:20.4f}' for record in columns.values())
        lines.append(label.ljust(22) + cells)
    return '\n'.join(lines)


def replaceable(folder: Path) -> bool:
    """Whether nothing is lost with a folder: it is not there, empty, or just an earlier demo's."""
    if not folder.exists():
        return True
    if not folder.is_dir():
        return False
    found = {path.name for path in folder.iterdir()}
    return not found or (found <= WRITTEN and set(CAPTURES) <= found)


def _put_in_place(part: Path, folder: Path) -> None:
    old = folder.with_name(f'.{folder.name}.{os.getpid()}.old')
    if folder.exists():
        folder.rename(old)
    part.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


def run(argv: Sequence[str] | None = None) -> None:
    """The demo; its folder takes the place of an earlier one's only when all went well.

    Raises:
        CalibrationError: something keeps it from being done, in the words of what failed.
    """
    given = arguments().parse_args(argv)
    if given.seed < 0:
        raise UsageError(f'demo: --seed: expected a number from 0 on, got {given.seed}')
    if given.poses is not None and given.poses < 2:
        raise UsageError(f'demo: --poses: expected at least 2, got {given.poses}')
    apart = '' if given.variant == DEFAULT else f'_{given.variant}'
    output = given.output or f'output/demo{apart}'
    folder = Path(output).absolute()
    if not replaceable(folder):
        raise UsageError(f'demo: {output} is there and no earlier demo: not replaced')
    part = folder.with_name(f'.{folder.name}.{os.getpid()}.part')
    begin = time.monotonic()
    try:
        part.mkdir(parents=True)
        demo = Demo(given.variant, part, given.seed, given.poses)
        demo.capture()
        columns = demo.identify()
        _put_in_place(part, folder)
    except OSError as error:
        raise UsageError(f'demo: {error.filename or output}: {error.strerror}') from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    print(
        f'{output}: bags, {RESULT}, report.html, {FIGURES}, arm.yaml, probe.yaml, '
        f'arm.urdf; '
        f'{time.monotonic() - begin:.0f} s in all'
    )
    print(table(columns))


def _interrupt(number: int, _: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, 2 and one line on stderr, or 130 when told to stop."""
    signal.signal(signal.SIGTERM, _interrupt)
    return run_command(lambda: run(argv))


if __name__ == '__main__':
    sys.exit(main())
