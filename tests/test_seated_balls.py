# SPDX-License-Identifier: Apache-2.0
"""A ball on the arm, seated in sockets, and nothing recorded but `/joint_states`."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from seated_recordings import Recording, led, project

from calib_capture.commands.import_csv import import_csv
from calib_model.arrays import Array
from calib_model.bags import BagWriter, cdr, write_descriptions
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.errors import BagError
from calib_model.instruments import Arm, Gauge, PassiveProbe
from calib_model.kinematics import points
from calib_model.labelling import Instruments, RawSettings, Sorted, label_bag
from calib_model.topics import DISPLACEMENTS, JOINT_STATES, Topic
from calib_model.transforms import RigidTransform
from calib_solver.acceptance import verify
from calib_solver.calibration import Sources, calibrate, evaluation_record
from calib_solver.fitting import Options

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
DATA = Path(os.environ.get('CALIB_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_iiwa14_sockets'
FILES = {
    'arm': str(CONFIG / 'arms' / 'kuka_lbr_iiwa14.yaml'),
    'probe': str(CONFIG / 'probes' / 'seated_ball_iiwa14.yaml'),
    'gauge': str(CONFIG / 'gauges' / 'two_sockets.yaml'),
}
PLACES = ('front', 'raised_left', 'left_back')
LIFT = np.array([0.2, 0.3, 0.1, -1.5, 0.0, 1.0, 0.3])
real = pytest.mark.skipif(not DATA.is_dir(), reason=f'{DATA} is not there')
pytestmark = pytest.mark.timeout(120)


@pytest.fixture(scope='module')
def arm() -> Arm:
    return read_description(FILES['arm'], parse_arm)


@pytest.fixture(scope='module')
def gauge() -> Gauge:
    return read_description(FILES['gauge'], parse_gauge)


@pytest.fixture(scope='module')
def probe() -> PassiveProbe:
    described = read_description(FILES['probe'], parse_probe)
    assert isinstance(described, PassiveProbe)
    return described


@pytest.fixture(scope='module')
def rows() -> Array:
    """location, sphere and joints of the real arm's poses."""
    if not DATA.is_dir():
        pytest.skip(f'{DATA} is not there')
    tables = [np.loadtxt(DATA / f'{place}.csv', delimiter=',', skiprows=1) for place in PLACES]
    return np.concatenate(tables)


def labels(sorted_bag: Sorted) -> Array:
    poses = sorted_bag.measured.poses
    order = np.argsort(poses.stamp)
    return np.stack([poses.location[order], poses.sphere[order]], axis=1)


@real
@pytest.mark.parametrize(
    'recording',
    [
        Recording(rate=40.0),
        Recording(rate=40.0, move=0.0),
        Recording(rate=25.0, lift=LIFT),
        Recording(rate=10.0, hold=0.8, move=1.0),
        Recording(rate=2.0, hold=0.5, move=0.0),
        Recording(rate=100.0, hold=0.03, move=0.0),
        Recording(rate=250.0, hold=0.15, move=0.1, noise=2e-5),
        Recording(rate=30.0, hold=1.5, move=0.6, noise=1e-4, drift=4e-3),
    ],
    ids=['stops', 'jumps', 'lifted', '10 Hz', 'one each', 'three each', 'encoder noise', 'by hand'],
)
def test_every_stop_is_a_pose_of_its_socket_however_it_was_recorded(
    tmp_path: Path,
    arm: Arm,
    probe: PassiveProbe,
    gauge: Gauge,
    rows: Array,
    recording: Recording,
) -> None:
    """The ball is described three centimetres from where it is: sockets are 50 mm apart."""
    rows = rows[:118]
    bag = recording.write(tmp_path / 'bag', arm.joint_names, rows[:, 2:])
    there = RigidTransform(np.array([0.02, -0.02, 0.055]), np.zeros(3))
    described = Instruments(arm, probe.mounted(there), gauge)
    found = label_bag(bag, RawSettings(), described)
    assert np.array_equal(labels(found), rows[:, :2])
    poses = found.measured.poses
    off = np.abs(poses.joints[np.argsort(poses.stamp)] - rows[:, 2:])
    assert off.max() <= 0.6 * recording.drift + 2 * recording.noise


@real
def test_joint_states_alone_give_what_import_csv_gives(
    tmp_path: Path, arm: Arm, rows: Array
) -> None:
    table = tmp_path / 'all.csv'
    head = 'location,sphere,' + ','.join(f'q{i + 1}' for i in range(7))
    texts = [f'{row[0]:.0f},{row[1]:.0f},' + ','.join(map(repr, row[2:].tolist())) for row in rows]
    table.write_text('\n'.join([head, *texts]) + '\n')
    files = {name: Path(path) for name, path in FILES.items()}
    import_csv(table, tmp_path / 'table', files['arm'], files['probe'], files['gauge'])
    bag = Recording(rate=50.0, hold=0.4, move=0.3).write(
        tmp_path / 'joints', arm.joint_names, rows[:, 2:]
    )
    quick = Options(quick=True)
    by_table = calibrate(Sources((str(tmp_path / 'table'),)), quick).record
    done = calibrate(Sources((str(bag),), **FILES), quick)
    for key in ('parameters', 'quality', 'spheres', 'warnings', 'rejected'):
        assert done.record[key] == by_table[key], key
    assert '180 poses by the joints alone: each stop of 0.1 s and more is one' in done.notes
    assert '3 locations of the gauge with 6 spheres told apart' in done.notes


@pytest.fixture(scope='module')
def led_arm(arm: Arm, gauge: Gauge) -> tuple[Array, Array, Array]:
    """States of an arm led around its ball in two sockets at two places, which socket each state
    is in, -1 in the air, and where on the flange the ball is."""
    ball = np.array([0.015, -0.02, 0.065])
    return led(arm, ball, gauge, ((0.55, 0.05, 0.25), (0.35, 0.45, 0.3)))


def test_an_arm_led_around_in_its_sockets_gives_poses_along_its_way(
    tmp_path: Path,
    arm: Arm,
    probe: PassiveProbe,
    gauge: Gauge,
    led_arm: tuple[Array, Array, Array],
) -> None:
    states, socket, ball = led_arm
    bag = Recording(rate=50.0, hold=0.02, move=0.0).write(tmp_path / 'bag', arm.joint_names, states)
    found = label_bag(bag, RawSettings(), Instruments(arm, probe, gauge))
    assert 'the arm was led with the ball seated' in '\n'.join(found.lines)
    got = labels(found)
    assert {tuple(row) for row in got.tolist()} == {(1, 1), (1, 2), (2, 1), (2, 2)}
    poses = found.measured.poses
    p = points(arm, poses.joints, ball)
    for location, sphere in np.unique(got, axis=0):
        mine = p[(poses.location == location) & (poses.sphere == sphere)]
        assert len(mine) >= 20
        assert np.abs(mine - np.median(mine, axis=0)).max() < 1e-3


def test_stops_in_the_air_belong_to_no_socket_and_are_told(
    tmp_path: Path, arm: Arm, probe: PassiveProbe, gauge: Gauge
) -> None:
    ball = probe.flange_T_probe.apply(probe.center)
    draw = np.random.default_rng(11)
    start = np.array([0.1, 0.6, 0.0, -1.2, 0.0, 1.0, 0.0])
    parts = []
    for number in gauge.numbers:
        goal = np.add((0.5, -0.1, 0.2), gauge.center(number))
        near = start + draw.normal(0.0, 0.3, (9, arm.n))
        parts += [project(arm, ball, near, goal), LIFT[None]]
    postures = np.concatenate(parts)
    bag = Recording(rate=50.0, hold=0.4, move=0.6).write(
        tmp_path / 'bag', arm.joint_names, postures
    )
    found = label_bag(bag, RawSettings(), Instruments(arm, probe, gauge))
    assert len(found.measured.poses) == 18
    said = '\n'.join(found.lines)
    assert '20 poses by the joints alone' in said
    assert 'left out: they fit no sphere' in said


@real
def test_a_calibration_is_verified_by_joint_states_alone(
    tmp_path: Path, arm: Arm, rows: Array
) -> None:
    bags = [
        Recording(rate=10.0, hold=0.4).write(tmp_path / name, arm.joint_names, part[:, 2:])
        for name, part in (('made', rows[:62]), ('new', rows[62:118]))
    ]
    done = calibrate(
        Sources((str(bags[0]),), **FILES), Options(quick=True), (), str(tmp_path / 'out')
    )
    found = verify(Sources((str(bags[1]),), gauge=FILES['gauge']), str(tmp_path / 'out'))
    assert len(found.problem.joints) == 56
    assert found.nominal.spheres.two_sigma.mean() > found.quality.spheres.two_sigma.mean()
    assert found.quality.spheres.two_sigma.mean() > done.done.identified.spheres.two_sigma.mean()


def test_two_sockets_need_no_word_on_which_is_which(
    tmp_path: Path, arm: Arm, probe: PassiveProbe, gauge: Gauge, rows: Array
) -> None:
    bag = Recording(rate=10.0, hold=0.4).write(tmp_path / 'bag', arm.joint_names, rows[:60, 2:])
    done = evaluation_record(Sources((str(bag),), **FILES))
    assert [sphere['sphere'] for sphere in done['spheres']] == [1, 2]


def test_an_active_probe_cannot_do_without_its_readings(tmp_path: Path, arm: Arm) -> None:
    bag = Recording(rate=10.0).write(tmp_path / 'bag', arm.joint_names, np.zeros((3, arm.n)))
    active = str(CONFIG / 'probes' / 'active_trihedron.yaml')
    with pytest.raises(BagError, match='no messages on /probe/displacements'):
        evaluation_record(Sources((str(bag),), FILES['arm'], active, FILES['gauge']))


def test_readings_under_another_name_are_not_passed_by(
    tmp_path: Path, arm: Arm, probe: PassiveProbe, gauge: Gauge
) -> None:
    topic = Topic('/touch/displacements', DISPLACEMENTS)
    folder = tmp_path / 'bag'
    with BagWriter(folder) as bag:
        write_descriptions(bag, arm, probe, gauge, 1)
        reading = cdr.displacements(5, 'probe', np.zeros(3), np.zeros(3, np.uint8))
        bag.write_message(topic, reading, 5)
        for number, joints in enumerate(Recording(rate=10.0).states(np.zeros((2, arm.n)))):
            stamp = 6 + number * 10**8
            state = cdr.joint_state(stamp, 'base', list(arm.joint_names), joints)
            bag.write_message(JOINT_STATES, state, stamp)
    with pytest.raises(BagError, match='on /touch/displacements: say which with --displacements'):
        evaluation_record(Sources((str(folder),)))
