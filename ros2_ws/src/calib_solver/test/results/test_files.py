# SPDX-License-Identifier: Apache-2.0
"""Results are as the contract lists them, and the files say the same as the record."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
import result_schema
from simulated_calibration import active, kr5, passive, simulate

from calib_model.bags import write_measurement
from calib_model.descriptions import parse_arm, parse_probe, read_description
from calib_model.errors import CalibrationError, DataError
from calib_model.kinematics import forward_kinematics
from calib_solver.calibration import (
    Sources,
    bag_list,
    calibrate,
    evaluation_record,
    fit_probe_from,
    load,
    summary_text,
)
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.results.files import convention_words, result_record, write_results

pytestmark = pytest.mark.timeout(60)
FILES = ('result.json', 'arm.yaml', 'probe.yaml', 'arm.urdf', 'report.html')


def take(measured, which):
    return replace(measured, poses=measured.poses.take(which))


def ragged(measured):
    """Spheres with a single pose, a location with one sphere, a location of one pose."""
    poses = measured.poses
    single = (poses.location == 1) & (poses.sphere == 1)
    alone = (poses.location == 2) & (poses.sphere != 6)
    last = poses.location == 5
    drop = single & (np.cumsum(single) > 1) | alone | last & (np.cumsum(last) > 1)
    return take(measured, ~drop)


@pytest.fixture(scope='module')
def bags(tmp_path_factory, active_scene):
    """A bag to identify from, locations 1 to 4, and a held-out one, location 5."""
    folder = tmp_path_factory.mktemp('bags')
    measured = active_scene.measured
    write_measurement(folder / 'seen', take(measured, measured.poses.location < 5))
    write_measurement(folder / 'held_out', take(measured, measured.poses.location == 5))
    return folder


@pytest.fixture(scope='module')
def output(bags, tmp_path_factory):
    """The folder of a finished identification, and the calibration itself."""
    folder = tmp_path_factory.mktemp('output') / 'made' / 'here'
    done = calibrate(
        Sources((str(bags / 'seen'),)), Options(), [str(bags / 'held_out')], str(folder)
    )
    return folder, done


def as_written(record):
    return json.loads(
        json.dumps(record, allow_nan=False), parse_constant=result_schema.refuse_constant
    )


def read_result(folder):
    return json.loads(
        (folder / 'result.json').read_text(), parse_constant=result_schema.refuse_constant
    )


@pytest.mark.parametrize('objective', ['distance_repeatability', 'distance', 'position'])
@pytest.mark.parametrize('which', ['active_scene', 'passive_scene'])
def test_the_record_is_what_the_contract_lists(objective, which, request):
    measured = request.getfixturevalue(which).measured
    record = as_written(result_record(identify(measured, Options(objective))))
    result_schema.result(record)
    assert record['objective'] == objective
    assert (record['probe_fit'] is None) == (measured.probe.kind == 'passive')
    assert record['quality']['test'] is None


@pytest.mark.parametrize('objective', ['distance_repeatability', 'distance', 'position'])
@pytest.mark.parametrize('which', ['active_scene', 'passive_scene'])
def test_missing_spheres_and_single_poses_never_give_a_NaN(objective, which, request):
    measured = ragged(request.getfixturevalue(which).measured)
    record = as_written(result_record(identify(measured, Options(objective))))
    result_schema.result(record)
    assert [s['poses'] for s in record['spheres']].count(1) == 2
    assert record['quality']['identified']['distance']['count'] == 3 * 6 - 6 + 6


def test_single_poses_everywhere_leave_two_sigma_null(passive_scene):
    measured = passive_scene.measured
    _, first = np.unique(
        np.stack([measured.poses.location, measured.poses.sphere]), axis=1, return_index=True
    )
    record = as_written(result_record(identify(take(measured, first))))
    result_schema.result(record)
    assert record['quality']['identified']['two_sigma']['max'] is None
    assert record['quality']['identified']['distance']['count'] == 30


def test_single_spheres_everywhere_leave_the_distances_null(active_scene):
    measured = take(active_scene.measured, active_scene.measured.poses.sphere == 6)
    record = as_written(result_record(identify(measured)))
    result_schema.result(record)
    assert record['quality']['identified']['distance']['count'] == 0


def test_the_record_says_of_each_parameter_whether_it_was_free_and_why_not(passive_scene):
    done = identify(passive_scene.measured, Options(fix=('a3',)))
    records = {p['name']: p for p in result_record(done)['parameters']}
    frozen = {name for name, p in records.items() if not p['free']}
    by_construction = {'d1', 'theta_0_1', 'd2', 'a6', 'alpha6', 'd6', 'theta_0_6'}
    assert frozen == by_construction | {'a3', 'probe_rx', 'probe_ry', 'probe_rz'}
    assert records['a3']['reason'] == 'fixed by the user'
    for name, p in records.items():
        assert not (p['identifiable'] and name in frozen)
        assert p['initial'] == done.table.nominal[done.table.column(name)]
        assert (p['identified'] != p['initial']) == p['free']


def test_the_worst_is_named_where_it_is(passive_scene):
    record = result_record(identify(passive_scene.measured))
    quality = record['quality']['identified']
    worst = max(record['spheres'], key=lambda sphere: max(sphere['two_sigma']))
    two_sigma = quality['two_sigma']
    assert two_sigma['max'] == max(worst['two_sigma'])
    assert (two_sigma['max_location'], two_sigma['max_sphere']) == (
        worst['location'],
        worst['sphere'],
    )
    assert two_sigma['max_coordinate'] == 'xyz'[int(np.argmax(worst['two_sigma']))]
    centers = {(s['location'], s['sphere']): np.array(s['center']) for s in record['spheres']}
    location, (j, k) = quality['distance']['max_location'], quality['distance']['max_pair']
    length = np.linalg.norm(centers[location, j] - centers[location, k])
    error = abs(length - passive_scene.measured.gauge.distance(j, k))
    assert error == pytest.approx(quality['distance']['max'], rel=1e-6)


def test_written_files_are_whole_and_what_the_record_says(output):
    folder, done = output
    assert {path.name for path in folder.iterdir()} >= set(FILES)
    assert {path.name for path in done.written} == {path.name for path in folder.iterdir()}
    record = read_result(folder)
    result_schema.result(record)
    assert set(record.pop('files')) == {path.name for path in done.written} - {'result.json'}
    assert record == as_written(done.record)
    arm = read_description(folder / 'arm.yaml', parse_arm)
    probe = read_description(folder / 'probe.yaml', parse_probe)
    said = {p['name']: p['identified'] for p in record['parameters']}
    for i, joint in enumerate(arm.joints, start=1):
        for kind in ('a', 'alpha', 'd'):
            assert getattr(joint, kind) == said[f'{kind}{i}']
        assert joint.theta_0 == said[f'theta_0_{i}']
        assert joint.beta == said.get(f'beta{i}', 0.0)
    assert probe.flange_T_probe.translation.tolist() == record['flange_T_probe']['translation']
    assert [said[f'probe_{axis}'] for axis in 'xyz'] == record['flange_T_probe']['translation']


def test_the_written_arm_and_probe_give_the_same_quality_by_evaluate(output, bags):
    folder, _ = output
    record = read_result(folder)
    arm, probe = str(folder / 'arm.yaml'), str(folder / 'probe.yaml')
    for bag, key in (('seen', 'identified'), ('held_out', 'test')):
        found = as_written(evaluation_record(Sources((str(bags / bag),), arm, probe)))
        result_schema.quality(found, {'spheres'})
        assert {k: found[k] for k in record['quality'][key]} == record['quality'][key]
    found = evaluation_record(Sources((str(bags / 'seen'),)))
    assert found['phi'] == record['quality']['initial']['phi']
    assert record['quality']['test']['phi'] < found['phi'] / 100


def test_the_written_urdf_is_the_written_arm_to_pinocchio(output):
    folder, _ = output
    arm = read_description(folder / 'arm.yaml', parse_arm)
    model = pinocchio.buildModelFromUrdf(str(folder / 'arm.urdf'))
    data = model.createData()
    assert list(model.names)[1:] == list(arm.joint_names)
    frame = model.getFrameId(arm.flange_frame)
    for q in np.random.default_rng(0).uniform(-2, 2, (20, arm.n)):
        pinocchio.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(
            data.oMf[frame].homogeneous, forward_kinematics(arm, q[None, :])[0], atol=1e-12
        )


def test_the_summary_shows_before_after_and_held_out(output):
    text = summary_text(output[1])
    header, *rows = [line for line in text.splitlines() if line.startswith(('mm', 'dist', '2 s'))]
    assert header.split('  ')[-1].strip() == 'held-out'
    assert len(rows) == 4
    initial, identified, held_out_initial, held_out = map(float, rows[0].split()[-4:])
    assert initial > 10 * identified
    assert held_out_initial > 10 * held_out
    assert 'converged' in text


def test_a_file_in_the_folders_place_stays_and_is_named(passive_scene, tmp_path):
    done = identify(passive_scene.measured)
    place = tmp_path / 'taken'
    place.write_text('mine')
    with pytest.raises(CalibrationError, match=f'^{place}: results cannot be written: '):
        write_results(place, done, result_record(done), '<html>')
    assert place.read_text() == 'mine'
    with pytest.raises(CalibrationError, match='Not a directory'):
        write_results(place / 'below', done, result_record(done), '<html>')


@pytest.mark.parametrize('failing', range(5))
def test_a_disk_that_fills_up_leaves_every_file_as_it_was(
    passive_scene, tmp_path, monkeypatch, failing
):
    done = identify(passive_scene.measured)
    record = result_record(done)
    for name in FILES:
        (tmp_path / name).write_text('before')
    synced = []

    def fsync(handle):
        synced.append(handle)
        if len(synced) > failing:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'fsync', fsync)
    with pytest.raises(CalibrationError, match='No space left on device'):
        write_results(tmp_path, done, record, '<html>')
    monkeypatch.undo()
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)
    assert {(tmp_path / name).read_text() for name in FILES} == {'before'}


@pytest.mark.parametrize('name', ['', 'report.html', 'robot.urdf'])
def test_a_place_that_cannot_be_written_is_told_before_the_work(tmp_path, name):
    place = tmp_path / 'out'
    if name:
        (place / name).mkdir(parents=True)
    else:
        place.write_text('mine')
    with pytest.raises(CalibrationError, match=f'^{place}: results cannot be written: '):
        calibrate(Sources(('/no/bag',)), Options(), output=str(place))


def test_nothing_is_written_when_the_held_out_bag_cannot_be_read(bags, tmp_path):
    output = tmp_path / 'out'
    with pytest.raises(CalibrationError, match='no such bag'):
        calibrate(Sources((str(bags / 'seen'),)), Options(), ['/no/bag'], str(output))
    assert not output.exists()


def test_several_bags_are_one_measurement_with_locations_of_their_own(bags, tmp_path):
    seen, held_out = str(bags / 'seen'), str(bags / 'held_out')
    both = load(Sources((seen, held_out)))
    assert sorted(set(both.poses.location.tolist())) == [1, 2, 3, 4, 5]
    once = load(Sources((seen,)))
    others = replace(once.poses, joints=once.poses.joints + 1e-6)
    write_measurement(tmp_path / 'again', replace(once, poses=others))
    again = load(Sources((seen, str(tmp_path / 'again'))))
    assert sorted(set(again.poses.location.tolist())) == list(range(1, 9))
    assert len(again.poses) == 2 * len(once.poses)
    assert bag_list(f'{seen}:{held_out}') == (seen, held_out)


def test_poses_that_are_there_twice_count_once(bags):
    seen = str(bags / 'seen')
    once, twice = load(Sources((seen,))), load(Sources((seen, seen)))
    assert (twice.poses.joints == once.poses.joints).all()
    assert (twice.poses.location == once.poses.location).all()


def test_bags_of_other_joints_or_another_gauge_do_not_go_together(bags, tmp_path, active_scene):
    measured = active_scene.measured
    renamed = tuple(replace(j, name=f'x_{j.name}') for j in measured.arm.joints)
    write_measurement(
        tmp_path / 'arm', replace(measured, arm=replace(measured.arm, joints=renamed))
    )
    write_measurement(
        tmp_path / 'gauge', replace(measured, gauge=replace(measured.gauge, name='other'))
    )
    for other, said in (('arm', 'other joints'), ('gauge', 'another gauge')):
        with pytest.raises(DataError, match=said):
            load(Sources((str(bags / 'seen'), str(tmp_path / other))))


def test_what_is_held_out_is_of_the_same_arm_and_kind_of_probe(bags, tmp_path, active_scene):
    measured, seated = active_scene.measured, simulate(kr5(), passive(), 3, poses=4).measured
    renamed = tuple(replace(j, name=f'x_{j.name}') for j in measured.arm.joints)
    other = replace(measured, arm=replace(measured.arm, joints=renamed))
    for name, part, said in (('arm', other, 'other joints'), ('probe', seated, 'passive probe')):
        write_measurement(tmp_path / name, part)
        with pytest.raises(DataError, match=f'{said}.*seen'):
            seen = Sources((str(bags / 'seen'),))
            calibrate(seen, Options(), [str(tmp_path / name)], str(tmp_path / 'out'))
    assert not (tmp_path / 'out').exists()


def test_fit_probe_writes_a_probe_that_repeats_better(tmp_path):
    scene = simulate(kr5(), active(), 71, locations=2, poses=12)
    measured = replace(scene.measured, arm=scene.true)
    write_measurement(tmp_path / 'bag', measured)
    bag = Sources((str(tmp_path / 'bag'),))
    fitted = fit_probe_from(bag, str(tmp_path / 'out'))
    record = as_written(fitted.record)
    result_schema.keys(record['probe_fit'], result_schema.PROBE_FIT)
    result_schema.transform(record['flange_T_probe'])
    result_schema.spheres(record['spheres'])
    assert [path.name for path in fitted.written] == ['probe.yaml']
    probe = read_description(fitted.written[0], parse_probe)
    np.testing.assert_allclose(probe.flange_T_probe.matrix(), scene.mount.matrix(), atol=1e-9)
    assert evaluation_record(replace(bag, probe=str(fitted.written[0])))['phi'] < 1e-20


def test_fit_probe_refuses_a_file_in_the_folders_place(tmp_path):
    scene = simulate(kr5(), active(), 72, locations=1, poses=6)
    write_measurement(tmp_path / 'bag', replace(scene.measured, arm=scene.true))
    (tmp_path / 'out').write_text('mine')
    with pytest.raises(CalibrationError, match='cannot be written'):
        fit_probe_from(Sources((str(tmp_path / 'bag'),)), str(tmp_path / 'out'))
    assert (tmp_path / 'out').read_text() == 'mine'


def test_a_seat_off_the_probes_origin_counts(passive_scene):
    """The seat's centre is part of where the sphere is: forgetting it changes the quality."""
    measured = passive_scene.measured
    probe = passive()
    forgotten = replace(measured, probe=replace(probe, center=np.zeros(3)))
    with_seat = identify(measured).initial.phi
    without = identify(forgotten).initial.phi
    assert with_seat != pytest.approx(without, rel=1e-2)


def test_a_bag_that_was_cut_is_named_in_a_warning(bags, tmp_path):
    whole = next((bags / 'seen').glob('*.mcap'))
    content = whole.read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(content[: len(content) - 200])
    cut = calibrate(Sources((str(tmp_path / 'cut.mcap'),)), Options())
    assert any('cut.mcap: cut short' in line for line in cut.record['warnings'])
    assert calibrate(Sources((str(bags / 'seen'),)), Options()).record['warnings'] == []


def test_parameters_of_a_description_in_craigs_convention_are_said_to_be_classic(active_scene):
    identification = identify(active_scene.measured, Options(quick=True))
    plain = result_record(identification)
    assert plain['convention'] == {'parameters': 'classic', 'described_in': 'classic'}
    assert convention_words(plain) == ''
    arm = replace(identification.arm, described_in='modified')
    record = result_record(replace(identification, arm=arm))
    assert record['convention'] == {'parameters': 'classic', 'described_in': 'modified'}
    assert convention_words(record).startswith('parameters are in classic')
