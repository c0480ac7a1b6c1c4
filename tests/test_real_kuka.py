# SPDX-License-Identifier: Apache-2.0
"""A real KUKA LBR iiwa 14: identified from one place of the sockets, judged at two others.

Joint angles of the arm with its ball seated in two sockets 50.0 mm apart (see the NOTES beside
the data). `CALIB_DATA` names the folder of data sets where it is not `../shared/data`.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands.import_csv import import_csv
from calib_solver.calibration import Sources, evaluation_record, load
from calib_solver.commands.identify import main, run
from calib_solver.fitting import DEFAULT_PRIOR, NO_PRIOR, USUAL_PRIOR, Options
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.results import sphere_records

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
DATA = Path(os.environ.get('CALIB_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_iiwa14_sockets'
DESCRIPTIONS = (
    CONFIG / 'arms' / 'kuka_lbr_iiwa14.yaml',
    CONFIG / 'probes' / 'seated_ball_iiwa14.yaml',
    CONFIG / 'gauges' / 'two_sockets.yaml',
)
PLACES = ('front', 'raised_left', 'left_back')
pytestmark = [
    pytest.mark.timeout(60),
    pytest.mark.skipif(not DATA.is_dir(), reason=f'{DATA} is not there'),
]


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """The three places as bags."""
    folder = tmp_path_factory.mktemp('kuka')
    for place in PLACES:
        import_csv(DATA / f'{place}.csv', folder / place, *DESCRIPTIONS)
    return {place: str(folder / place) for place in PLACES}


@pytest.fixture(scope='module')
def calibration(bags, tmp_path_factory):
    """identify from the front, judged on the other two: its record and its folder."""
    output = tmp_path_factory.mktemp('calibrated')
    words = [bags['front'], '--test', bags['raised_left'], bags['left_back']]
    done = run([*words, '--output', str(output)])
    return done.record, output


def spread(spheres):
    """rms of |p - mean| over all poses (m), from each sphere's count and 2 sigma (eq. 8)."""
    squares = sum(
        (s['poses'] - 1) * sum((two_sigma / 2) ** 2 for two_sigma in s['two_sigma'])
        for s in spheres
    )
    return np.sqrt(squares / sum(s['poses'] for s in spheres))


def judged(bags, places, output=None):
    """The spread at some places with the nominal parameters, or with those in a folder."""
    files = (str(output / 'arm.yaml'), str(output / 'probe.yaml')) if output else ()
    return spread(evaluation_record(Sources(tuple(bags[p] for p in places), *files))['spheres'])


def test_the_nominal_arm_spreads_the_ball_by_0_7_mm(bags):
    assert 0.60e-3 < judged(bags, ['front']) < 0.72e-3
    assert 0.60e-3 < judged(bags, PLACES) < 0.80e-3


def test_identified_from_the_front_the_ball_spreads_by_0_14_mm_there(bags, calibration):
    record, output = calibration
    assert record['solver']['converged']
    assert spread(record['spheres']) <= 0.14e-3
    assert judged(bags, ['front'], output) == pytest.approx(spread(record['spheres']), rel=1e-9)


def test_and_by_0_34_mm_where_it_was_not_identified(bags, calibration):
    _, output = calibration
    assert judged(bags, PLACES[1:], output) <= 0.34e-3


def test_the_held_out_quality_is_that_of_both_other_places(bags, calibration):
    record, output = calibration
    files = (str(output / 'arm.yaml'), str(output / 'probe.yaml'))
    both = evaluation_record(Sources((bags['raised_left'], bags['left_back']), *files))
    both.pop('spheres')
    assert json.loads(json.dumps(both)) == record['quality']['test']
    assert record['quality']['test']['distance']['count'] == 2


def test_the_parameters_stay_those_of_such_an_arm(calibration):
    record, _ = calibration
    for parameter in record['parameters']:
        moved = abs(parameter['identified'] - parameter['initial'])
        mount = parameter['name'].startswith('probe_')
        most = 0.05 if mount else {'m': 3e-3, 'rad': 2e-2}[parameter['unit']]
        assert moved < most, parameter['name']


@pytest.mark.parametrize(('place', 'gain'), [('raised_left', 0.6), ('left_back', 0.25)])
def test_the_other_places_identify_too(bags, tmp_path, place, gain):
    """Poses at the raised place scatter by 0.29 mm even where no prior holds the fit back."""
    assert main([bags[place], '--output', str(tmp_path)]) == 0
    assert judged(bags, [place], tmp_path) < gain * judged(bags, [place])


@pytest.mark.parametrize('held_out', PLACES)
@pytest.mark.parametrize('places', [1, 2])
@pytest.mark.slow
def test_the_evidence_does_no_worse_elsewhere_than_no_prior_or_the_usual_one(
    bags, held_out, places
):
    """Identified at two places or at one, judged at the others."""
    seen = [place for place in PLACES if place != held_out]
    seen = seen if places == 2 else [held_out]
    unseen = [place for place in PLACES if place not in seen]
    measured, there = (load(Sources(tuple(bags[p] for p in group))) for group in (seen, unseen))
    problem = Problem.of(there)

    def spread_there(prior):
        done = identify(measured, Options(prior=prior))
        return spread(sphere_records(assess(problem, done.arm, done.probe).spheres))

    assert spread_there(DEFAULT_PRIOR) < 1.02 * min(map(spread_there, (NO_PRIOR, USUAL_PRIOR)))


@pytest.mark.parametrize('place', PLACES)
def test_without_a_prior_it_says_which_axis_the_poses_do_not_place(bags, place):
    """The ball is 0.2 mm off axis 7: no minimum for where that axis runs within any reach."""
    fit = run([bags[place], '--prior', 'none']).done.fit
    named = [name for name in ('a6', 'alpha6', 'd6', 'theta_0_6') if name in fit.reason]
    assert not fit.converged
    assert named, fit.reason
