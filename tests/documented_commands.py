# SPDX-License-Identifier: Apache-2.0
"""The commands that README and docs show, and the files that a user is taken to have."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from seated_recordings import Recording

from calib_capture.commands.import_csv import import_csv
from calib_model.bags import cdr, read_messages
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.instruments import Arm
from calib_model.kinematics import points
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS
from calib_model.urdf import arm_urdf

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
FENCE = re.compile(r'^ *```(\w*)\s*$')
SHELL = ('', 'bash', 'sh', 'console')
#: what a line of a shell begins with; blocks that begin otherwise are tables and drawings
WORDS = {
    'ros2',
    'calib',
    'make',
    'source',
    'python',
    'python3',
    'pip',
    'export',
    'colcon',
    'git',
    'cp',
    'mkdir',
    'ls',
    'cat',
    'head',
    'dask',
    'rviz2',
    'sudo',
    'apt',
    'curl',
    'cd',
    'printf',
    'echo',
    'docker',
}
DATA = (
    'bags',
    'docs',
    'studies',
    'tools',
    'ros2_ws',
    'env.bash',
    'Makefile',
    '.venv',
    'pyproject.toml',
    'benchmarks',
    'tests',
    'requirements.txt',
    'examples',
)


@dataclass(frozen=True)
class Command:
    """A line of a shell, continuations joined, and where it is written."""

    text: str
    place: str


def documents() -> list[Path]:
    """README and all of docs."""
    return [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]


def fenced(document: Path) -> Iterator[tuple[str, list[tuple[int, str]]]]:
    """Language and numbered lines of each fenced block."""
    lines = iter(enumerate(document.read_text(encoding='utf-8').splitlines(), 1))
    for _, line in lines:
        begin = FENCE.match(line)
        if begin:
            inside = takewhile(lambda each: not FENCE.match(each[1]), lines)
            yield begin[1], list(inside)


def command_blocks(document: Path) -> list[list[Command]]:
    """The commands of each block that is a shell's."""
    found = []
    for language, lines in fenced(document):
        said = [(number, text.strip()) for number, text in lines]
        said = [(number, text) for number, text in said if text and not text.startswith('#')]
        if language in SHELL and said and said[0][1].split()[0] in WORDS:
            found.append(list(_joined(document, said)))
        else:
            lost = [text for _, text in said if text.startswith(('ros2 ', 'make '))]
            assert language or not lost, f'{document.name}: no shell, but a command: {lost[0]}'
    return found


def _joined(document: Path, lines: Sequence[tuple[int, str]]) -> Iterator[Command]:
    begun, first = '', 0
    for number, text in lines:
        first = first if begun else number
        begun += text.removesuffix('\\')
        if not text.endswith('\\'):
            assert begun.split()[0] in WORDS, f'{document.name}:{first}: no known command: {begun}'
            yield Command(begun, f'{document.relative_to(ROOT)}:{first}')
            begun = ''


def python_blocks(document: Path) -> list[str]:
    """Blocks of Python."""
    return [
        '\n'.join(text for _, text in lines)
        for language, lines in fenced(document)
        if language == 'python'
    ]


def furnish(folder: Path) -> None:
    """A working folder as a user of the clone has it, with the files of his own robot."""
    for name in DATA:
        (folder / name).symlink_to(ROOT / name)
    arm = read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
    (folder / 'my_robot.urdf').write_text(arm_urdf(arm), encoding='utf-8')
    for ours, theirs in (
        ('probes/active_trihedron.yaml', 'probe.yaml'),
        ('gauges/ball_bar_kr5.yaml', 'gauge.yaml'),
        ('arms/kuka_lbr_iiwa14.yaml', 'ARM.yaml'),
        ('probes/seated_ball_iiwa14.yaml', 'PROBE.yaml'),
        ('gauges/two_sockets.yaml', 'GAUGE.yaml'),
        ('locations/kr5.yaml', 'placements.yaml'),
        ('bodies/kr5.yaml', 'bodies.yaml'),
        ('links/kuka_kr5_sixx_r650.yaml', 'links.yaml'),
    ):
        shutil.copy(CONFIG / ours, folder / theirs)
    (folder / 'targets.csv').write_text('x,y,z\n0.45,0.10,0.50\n0.50,-0.10,0.40\n')
    raw_bag(ROOT / 'bags/demo/identification', folder / 'my_bag')
    raw_bag(ROOT / 'bags/demo/held_out', folder / 'my_held_out')
    seated_tables(folder)
    seated_bags(folder)
    tracker_tables(folder)
    for name in ('raised_left', 'left_back'):  # of the three, README imports only the first
        import_csv(
            folder / f'{name}.csv',
            folder / 'bag' / name,
            *(folder / f'{each}.yaml' for each in ('ARM', 'PROBE', 'GAUGE')),
        )


def raw_bag(ours: Path, theirs: Path) -> None:
    """The two raw topics of a bag as rosbags writes them."""
    topics = {
        JOINT_STATES.name: JOINT_STATES.type,
        PROBE_DISPLACEMENTS.name: PROBE_DISPLACEMENTS.type,
    }
    store = cdr.typestore()
    with Writer(theirs, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        channel = {
            name: writer.add_connection(name, kind, typestore=store)
            for name, kind in topics.items()
        }
        for message in read_messages(ours, set(topics)):
            writer.write(channel[message.topic], message.log_time, message.data)


def tracker_tables(folder: Path) -> None:
    """`tracker.csv` and `tracker_test.csv`, in mm and degrees: a target on an LBR iiwa 14 as a
    tracker saw it, the joints off by half a mrad."""
    arm = read_description(folder / 'ARM.yaml', parse_arm)
    generator = np.random.default_rng(2)
    off = 5e-4 * generator.normal(size=arm.n)
    for name, count in (('tracker', 80), ('tracker_test', 20)):
        q = generator.uniform(-1.5, 1.5, (count, arm.n))
        # a tracker that stands turned by a quarter, two metres off
        x, y, z = points(arm, q + off, np.array([0.05, 0.02, 0.1])).T
        seen = np.stack([2.0 - y, x - 0.7, z + 0.3], axis=1)
        seen += 3e-5 * generator.normal(size=seen.shape)
        rows = np.concatenate([np.degrees(q), 1e3 * seen], axis=1)
        head = ','.join([*(f'q{i + 1}' for i in range(arm.n)), 'x', 'y', 'z'])
        lines = [','.join(f'{value:.9f}' for value in row) for row in rows]
        (folder / f'{name}.csv').write_text('\n'.join([head, *lines]) + '\n')


def seated_bags(folder: Path) -> None:
    """`my_sockets` and `my_fourth_place`: the joint states alone of the arm in two of the tables,
    and in the third."""
    names = read_description(folder / 'ARM.yaml', parse_arm).joint_names
    recording = Recording(rate=25.0, hold=0.4, move=0.4)
    for bag, tables in (
        ('my_sockets', ('front', 'raised_left')),
        ('my_fourth_place', ('left_back',)),
    ):
        rows = [np.loadtxt(folder / f'{one}.csv', delimiter=',', skiprows=1) for one in tables]
        recording.write(folder / bag, names, np.concatenate(rows)[:, 2:])


def seated_tables(folder: Path) -> None:
    """`front.csv`, `raised_left.csv` and `left_back.csv`: an LBR iiwa 14 seated in two sockets."""
    arm = read_description(folder / 'ARM.yaml', parse_arm)
    probe = read_description(folder / 'PROBE.yaml', parse_probe)
    gauge = read_description(folder / 'GAUGE.yaml', parse_gauge)
    seat = probe.flange_T_probe.apply(probe.center)
    generator = np.random.default_rng(1)
    for name, place in (
        ('front', (0.6, 0.0, 0.1)),
        ('raised_left', (0.3, 0.5, 0.4)),
        ('left_back', (-0.2, 0.6, 0.2)),
    ):
        rows = [
            f'1,{number},' + ','.join(f'{angle:.9f}' for angle in posture)
            for number in gauge.numbers
            for posture in _seated(arm, seat, np.add(place, gauge.center(number)), generator)
        ]
        head = 'location,sphere,' + ','.join(f'q{i + 1}' for i in range(arm.n))
        (folder / f'{name}.csv').write_text('\n'.join([head, *rows]) + '\n')


def _seated(
    arm: Arm, seat: np.ndarray, goal: np.ndarray, generator: np.random.Generator, count: int = 12
) -> np.ndarray:
    """Postures (count, n) near which the seat is at the goal, their joints off by 1e-4 rad."""
    q = generator.uniform(-1.5, 1.5, (20 * count, arm.n))
    for _ in range(60):  # damped Newton, all at once
        miss = points(arm, q, seat) - goal
        slope = np.stack(
            [(points(arm, q + step, seat) - goal - miss) / 1e-6 for step in 1e-6 * np.eye(arm.n)],
            axis=-1,
        )  # (N, 3, n)
        square = slope @ slope.transpose(0, 2, 1) + 1e-6 * np.eye(3)
        q -= np.einsum('kin,ki->kn', slope, np.linalg.solve(square, miss[..., None])[..., 0])
    lower, upper = arm.limits.T
    reached = np.abs(points(arm, q, seat) - goal).max(axis=1) < 1e-7
    usable = q[reached & (q > lower).all(axis=1) & (q < upper).all(axis=1)]
    assert len(usable) >= count
    return usable[:count] + generator.normal(0.0, 1e-4, (count, arm.n))
