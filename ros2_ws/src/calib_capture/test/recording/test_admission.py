# SPDX-License-Identifier: Apache-2.0
"""What a session is spared, and what a capture ends for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calib_capture.checking import FirstSeconds
from calib_capture.measuring import Tally
from calib_capture.recording import Admission, HandGuidedSession, Origin, ProgramSession
from calib_capture.recording.admission import ODD_READINGS
from calib_model.pairing import JointSample, Reading
from calib_model.topics import JOINT_STATES

SAMPLE = JointSample(5, np.zeros(6))


def reading(size):
    return Reading(7, np.array([0.0, size, 0.0]), (0, 0, 0))


class Scene:
    """An admission whose session only takes note."""

    def __init__(self, probe, kind=ProgramSession, first=None):
        self.taken, self.errors, self.begun_anew = [], [], []
        self.session = kind.__new__(kind)
        self.session.run = SimpleNamespace(tally=Tally(4))
        self.session.take_joints = lambda sample, raw: self.taken.append(sample)
        self.session.take_reading = lambda each, raw: self.taken.append(each)
        self.session.start_over = self.begun_anew.append
        self.admission = Admission(self.session, probe, self.errors.append, first)

    def take(self, message, origin=Origin.ONE):
        self.admission.take(message, b'', origin)


def test_what_no_stylus_makes_is_left_out_and_ends_the_run_when_nothing_else_comes(probe):
    scene = Scene(probe)
    for size in (*[0.7] * (ODD_READINGS - 1), 1e-3, *[0.9] * ODD_READINGS):
        scene.take(reading(size))
    assert [each.displacement[1] for each in scene.taken] == [1e-3]
    assert scene.admission.left_out == 2 * ODD_READINGS - 1
    assert len(scene.errors) == 1 and 'readings of 0.9 m' in str(scene.errors[0])


def test_the_record_of_a_hand_guided_arm_is_whole(probe):
    scene = Scene(probe, HandGuidedSession)
    for _ in range(ODD_READINGS):
        scene.take(reading(0.7))
    assert len(scene.taken) == ODD_READINGS and scene.admission.left_out == 0
    assert len(scene.errors) == 1


def test_of_somebody_else_perhaps_nothing_is_taken(probe):
    scene = Scene(probe)
    scene.take(SAMPLE, Origin.UNSURE)
    assert scene.begun_anew == [JOINT_STATES] and not scene.taken


@pytest.mark.parametrize('taken', [0, 1])
def test_four_refused_poses_and_none_taken_end_the_run(kr5, probe, gauge, taken):
    scene = Scene(probe, first=FirstSeconds(kr5, probe, gauge, np.zeros((1, 3))))
    tally = scene.session.tally
    tally.taken = taken
    tally.refused['no contact'] = 4
    scene.take(SAMPLE)
    assert bool(scene.errors) == (taken == 0)
    assert len(scene.taken) == taken
