# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from live_cell import LiveCell, Wrongs

from calib_capture.checking import FirstSeconds, small_moves
from calib_model.kinematics import points

POSTURE = np.array([0.5, 1.1, -0.9, 0.3, 1.0, 0.2])


@pytest.fixture
def heard_by(kr5, probe, gauge):
    """What a capture objects to after some seconds of an arm that moves on a sphere."""

    def heard(**wrongs):
        cell = LiveCell(kr5, probe, gauge, POSTURE, Wrongs(**wrongs))
        place = points(kr5, POSTURE[None], probe.flange_T_probe.apply(np.zeros((1, 3))))
        first = FirstSeconds(kr5, probe, gauge, place)
        cell.spin(1.0)
        for move in small_moves(kr5, probe, POSTURE, np.zeros(3)):
            cell.send(move)
            cell.spin(move.seconds[-1])
            if cell.heard.readings:  # as if the arm had left the sphere
                away = cell.heard.readings[-1]
                cell.heard.readings[-1] = away._replace(status=(1, 1, 1))
        messages = [
            *zip(cell.heard.joints, cell.heard.joint_times, strict=True),
            *zip(cell.heard.readings, cell.heard.reading_times, strict=True),
        ]
        for message, now in sorted(messages, key=lambda each: each[1]):
            first.see(message, 100.0 + now)
            if first.objection:
                return first.objection, now
        return '', now

    return heard


@pytest.mark.parametrize(
    ('wrongs', 'said', 'within'),
    [
        ({}, '', 10.0),
        ({'angle': 180 / np.pi}, 'unit of joints: joint_a', 0.1),
        ({'signs': (-1, 1, 1)}, 'sign of displacement 1', 6.0),
        ({'flips': 3}, 'sign of joint_a4', 6.0),
        ({'turn': (0, 0, -np.pi / 2)}, 'turned by -90 deg about its z axis', 6.0),
        ({'clock': 0.04}, 'readings are stamped 40 ms too early for the joints', 6.0),
        ({'clock': -3.0}, 'readings are stamped 3.00 s too late for the joints', 3.0),
        ({'clock': 0.35}, 'readings are stamped 350 ms too early for the joints', 3.0),
        ({'noise': 8e-5, 'rate': 100.0}, '', 10.0),
        ({'rate': 5.0}, 'joint states come at 5 Hz', 3.0),
        ({'unstamped': True}, 'joint states are stamped zero', 3.0),
    ],
)
def test_a_capture_objects_to_what_is_wrong_and_to_nothing_else(heard_by, wrongs, said, within):
    objection, after = heard_by(**wrongs)
    assert said in objection
    assert bool(objection) == bool(said)
    assert after < within


def test_poses_that_are_all_refused_are_enough_to_stop(kr5, probe, gauge):
    first = FirstSeconds(kr5, probe, gauge, np.zeros((1, 3)))
    first.refused(0, {'no contact': 3})
    first.refused(1, {'no contact': 30})
    assert not first.objection
    first.refused(0, {'no contact': 4, 'arm not steady long enough': 1})
    assert first.objection.startswith('the first 5 poses gave no contact: is the gauge where it')
