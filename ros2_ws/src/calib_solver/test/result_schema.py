# SPDX-License-Identifier: Apache-2.0
"""What the contract says `result.json` looks like, as a check of its own."""

from __future__ import annotations

import math
from typing import Any

Record = dict[str, Any]

TOP = {
    'schema',
    'arm',
    'objective',
    'parameters',
    'flange_T_probe',
    'spheres',
    'quality',
    'solver',
    'probe_fit',
}
PARAMETER = {
    'name',
    'unit',
    'initial',
    'identified',
    'standard_uncertainty',
    'free',
    'identifiable',
}
#: keys beyond the contract's first list: whoever adds one says so here
ADDED_TOP = {
    'convention',
    'warnings',
    'rejected',
    'diagnostics',
    'resampling',
    'joint_errors',
    'correction',
    'files',
    'readings',
}
ADDED_PARAMETER = {'reason'}
SOLVER = {
    'iterations',
    'evaluations',
    'phi_initial',
    'phi_final',
    'seconds',
    'converged',
    'reason',
}
PROBE_FIT = {'spheres', 'poses', 'residual_rms', 'orthogonality_error', 'condition'}
DISTANCE = {'count', 'max', 'mean', 'rms', 'min', 'max_location', 'max_pair'}
TWO_SIGMA = {
    'max',
    'mean',
    'min',
    'max_location',
    'max_sphere',
    'max_coordinate',
    'mean_xyz',
}
ADDED_DISTANCE = {'min_location', 'min_pair'}
ADDED_TWO_SIGMA = {'min_location', 'min_sphere', 'min_coordinate'}
SINGLE_POINT = {
    'spheres',
    'points',
    'max_deviation',
    'max_location',
    'max_sphere',
    'two_s_max',
    'two_s_mean',
    'two_s_location',
    'two_s_sphere',
}
LENGTH = {
    'count',
    'max_deviation',
    'max_location',
    'max_pair',
    'max_length',
    'mean',
    'two_rms',
    'span',
}
PROBE_NAMES = ['probe_x', 'probe_y', 'probe_z', 'probe_rx', 'probe_ry', 'probe_rz']
OBJECTIVES = ('distance_repeatability', 'distance', 'position')


def refuse_constant(name: str) -> float:
    """For `json.loads(parse_constant=...)`: JSON has no NaN and no infinities."""
    raise AssertionError(f'{name} in JSON')


def keys(record: Record, expected: set[str], added: set[str] = frozenset()) -> None:
    assert isinstance(record, dict)
    assert expected <= set(record), f'missing: {expected - set(record)}'
    assert set(record) <= expected | added, f'unknown: {set(record) - expected - added}'


def number(value: Any, at_least: float = -math.inf) -> None:
    assert type(value) is float, f'{value!r} is no float'
    assert math.isfinite(value)
    assert value >= at_least


def count(value: Any, at_least: int = 0) -> None:
    assert type(value) is int, f'{value!r} is no integer'
    assert value >= at_least


def three(values: Any, at_least: float = -math.inf) -> None:
    assert isinstance(values, list)
    assert len(values) == 3
    for value in values:
        number(value, at_least)


def text(value: Any) -> None:
    assert isinstance(value, str)
    assert value


def transform(record: Record) -> None:
    keys(record, {'translation', 'rotation_vector'})
    three(record['translation'])
    three(record['rotation_vector'])


def spheres(records: list[Record]) -> None:
    assert records
    for record in records:
        keys(record, {'location', 'sphere', 'poses', 'center', 'two_sigma'})
        for key in ('location', 'sphere', 'poses'):
            count(record[key], 1)
        three(record['center'])
        if record['poses'] == 1:
            assert record['two_sigma'] == [None, None, None]
        else:
            three(record['two_sigma'], 0.0)
    places = [(record['location'], record['sphere']) for record in records]
    assert places == sorted(set(places))


def quality(record: Record, added: set[str] = frozenset()) -> None:
    """Q of the contract."""
    keys(
        record, {'phi', 'distance', 'two_sigma', 'position', 'measuring_arm'}, {'standards', *added}
    )
    assert 'not a test' in record['standards']['basis']
    number(record['phi'], 0.0)
    distance(record['distance'])
    two_sigma(record['two_sigma'])
    keys(record['position'], {'rms', 'mean', 'max'})
    for value in record['position'].values():
        number(value, 0.0)
    measuring_arm(record['measuring_arm'])


def measuring_arm(record: Record) -> None:
    """Added to Q: ASME B89.4.22's quantities, null where there is nothing to compute them from."""
    keys(record, {'basis', 'single_point', 'length'})
    assert 'not a test by the standard' in record['basis']
    point, length = record['single_point'], record['length']
    if point is not None:
        keys(point, SINGLE_POINT)
        for key in SINGLE_POINT - {'max_deviation', 'two_s_max', 'two_s_mean'}:
            count(point[key], 1)
        number(point['max_deviation'], 0.0)
        number(point['two_s_mean'], 0.0)
        number(point['two_s_max'], point['two_s_mean'])
    if length is not None:
        keys(length, LENGTH)
        for key in ('count', 'max_location'):
            count(length[key], 1)
        pair(length['max_pair'])
        for key in ('max_deviation', 'mean'):
            number(length[key])
        for key in ('max_length', 'two_rms', 'span'):
            number(length[key], 0.0)


def distance(record: Record) -> None:
    keys(record, DISTANCE | ADDED_DISTANCE)
    count(record['count'])
    if record['count'] == 0:
        assert all(record[key] is None for key in record if key != 'count')
        return
    for key in ('max', 'mean', 'rms', 'min'):
        number(record[key], 0.0)
    assert record['min'] <= record['mean'] <= record['rms'] <= record['max']
    for end in ('max', 'min'):
        count(record[f'{end}_location'], 1)
        pair(record[f'{end}_pair'])


def pair(spheres: list[int]) -> None:
    """Two different sphere numbers."""
    assert len(set(spheres)) == len(spheres) == 2
    for sphere in spheres:
        count(sphere, 1)


def two_sigma(record: Record) -> None:
    keys(record, TWO_SIGMA | ADDED_TWO_SIGMA)
    if record['max'] is None:
        assert all(record[key] is None for key in record if key != 'mean_xyz')
        assert record['mean_xyz'] == [None, None, None]
        return
    for key in ('max', 'mean', 'min'):
        number(record[key], 0.0)
    assert record['min'] <= record['mean'] <= record['max']
    for end in ('max', 'min'):
        count(record[f'{end}_location'], 1)
        count(record[f'{end}_sphere'], 1)
        assert record[f'{end}_coordinate'] in ('x', 'y', 'z')
    three(record['mean_xyz'], 0.0)


def parameters(records: list[Record]) -> None:
    for record in records:
        keys(record, PARAMETER, ADDED_PARAMETER)
        text(record['name'])
        kind = record['name'].rstrip('0123456789')
        lengths = ('a', 'd', 'probe_x', 'probe_y', 'probe_z')
        assert record['unit'] == ('m' if kind in lengths else 'rad'), record['name']
        number(record['initial'])
        number(record['identified'])
        if record['standard_uncertainty'] is not None:
            number(record['standard_uncertainty'], 0.0)
        assert type(record['free']) is bool
        assert type(record['identifiable']) is bool
        assert record['free'] or not record['identifiable']
        assert record['free'] or record['identified'] == record['initial']
        text(record['reason'])
    names = [record['name'] for record in records]
    joints = sum(name.startswith('alpha') for name in names)
    expected = [
        f'{kind}{i}' for kind in ('a', 'alpha', 'd', 'theta_0_') for i in range(1, joints + 1)
    ]
    betas = [name for name in names if name.startswith('beta')]
    assert betas == sorted(set(betas))
    assert names == expected + betas + PROBE_NAMES


GAIN = {'change', 'standard_error', 'rms_before', 'rms_after'}
LEFT_OUT = {'two_sigma_before', 'two_sigma_after', 'distance_before', 'distance_after'}
CORRECTION = {
    'accepted',
    'verdict',
    'turn_harmonics',
    'shift_harmonics',
    'attitude',
    'strength',
    'folds',
    'gain',
    'quality',
}
JOINT_ERRORS = {'offered', 'identified', 'verdict', 'folds', 'tried', 'parameters'}


def gain(record: Record) -> None:
    number(record['change'], -1.0)
    for key in GAIN - {'change'}:
        number(record[key], 0.0)


def joint_errors(record: Record) -> None:
    keys(record, JOINT_ERRORS)
    assert set(record['identified']) <= set(record['offered']) <= {'encoder', 'scale', 'compliance'}
    for line in record['verdict']:
        text(line)
    count(record['folds'])
    for tried in record['tried']:
        keys(tried, {'kind', 'identified'} | GAIN)
        assert tried['kind'] in record['offered']
        assert tried['identified'] == (tried['kind'] in record['identified'])
        gain(tried)
    for parameter in record['parameters']:
        keys(parameter, PARAMETER, ADDED_PARAMETER)
        kind = parameter['name'].split('_')[0]
        assert kind in record['identified']
        units = {'encoder': 'rad', 'scale': 'm/m', 'compliance': 'rad/(N m)'}
        assert parameter['unit'] == units[kind]
        number(parameter['identified'])


def correction(record: Record) -> None:
    keys(record, CORRECTION)
    _chosen(record)
    if record['gain'] is not None:
        for key in LEFT_OUT:
            number(record['gain'][key], 0.0)
    if record['quality'] is not None:
        quality(record['quality']['identified'])
        if record['quality']['test'] is not None:
            quality(record['quality']['test'])


def point_correction(record: Record, oriented: bool) -> None:
    keys(record, CORRECTION | {'stations'})
    _chosen(record)
    assert (record['stations'] is None) == (not record['accepted'])
    for station in record['stations'] or []:
        keys(station, {'station', 'translation', 'rotation_vector'})
        three(station['translation'])
        three(station['rotation_vector'])
    if record['gain'] is not None:
        assert all(record['gain'][key] is None for key in LEFT_OUT)
    if record['quality'] is not None:
        for one in (record['quality']['identified'], record['quality']['test']):
            if one is not None:
                point_quality(one, oriented)


def _chosen(record: Record) -> None:
    for key in ('accepted', 'attitude'):
        assert type(record[key]) is bool
    text(record['verdict'])
    for key in ('turn_harmonics', 'shift_harmonics', 'folds'):
        count(record[key])
    number(record['strength'], 0.0)
    if record['gain'] is not None:
        keys(record['gain'], GAIN | LEFT_OUT)
        gain(record['gain'])
    assert (record['quality'] is None) == (not record['accepted'])


def left_out(record: Record) -> None:
    """How the calibration does on what it is not told."""
    keys(record, {'by', 'folds', 'position', 'distance', 'factor'})
    assert record['by'] in ('location', 'posture')
    count(record['folds'], 2)
    number(record['factor'], 1.0)
    for judged in (record['position'], record['distance']):
        if judged is not None:
            keys(judged, {'rms', 'stated', 'count'})
            number(judged['rms'], 0.0)
            number(judged['stated'], 0.0)
            count(judged['count'], 1)
    assert record['position'] is not None


def result(record: Record) -> None:
    """The whole of `result.json`."""
    keys(record, TOP, ADDED_TOP)
    assert record['schema'] == 1
    text(record['arm'])
    assert record['objective'] in OBJECTIVES
    parameters(record['parameters'])
    transform(record['flange_T_probe'])
    spheres(record['spheres'])
    keys(record['quality'], {'initial', 'identified', 'test'}, {'test_initial', 'left_out'})
    if record['quality'].get('left_out') is not None:
        left_out(record['quality']['left_out'])
    assert (record['quality']['test'] is None) == (record['quality']['test_initial'] is None)
    quality(record['quality']['initial'])
    quality(record['quality']['identified'])
    if record['quality']['test'] is not None:
        quality(record['quality']['test'])
        quality(record['quality']['test_initial'])
    keys(record['solver'], SOLVER)
    count(record['solver']['iterations'])
    count(record['solver']['evaluations'], 1)
    for key in ('phi_initial', 'phi_final', 'seconds'):
        number(record['solver'][key], 0.0)
    assert type(record['solver']['converged']) is bool
    text(record['solver']['reason'])
    if record['probe_fit'] is not None:
        keys(record['probe_fit'], PROBE_FIT)
        for key in ('spheres', 'poses'):
            count(record['probe_fit'][key], 1)
        for key in ('residual_rms', 'orthogonality_error', 'condition'):
            number(record['probe_fit'][key], 0.0)
    assert all(isinstance(line, str) and line for line in record['warnings'])
    if record['joint_errors'] is not None:
        joint_errors(record['joint_errors'])
    if record['correction'] is not None:
        correction(record['correction'])


#: what a calibration by measured points has besides, and what it has in place of a pose's place
POINT_TOP = {'targets', 'stations'}
SIZES = {'rms', 'mean', 'max', 'count'}
POINT_REJECTED = {'pose', 'target', 'station', 'size', 'angle', 'reason'}


def point_quality(record: Record, oriented: bool) -> None:
    """Q of measured points."""
    of_a_gauge = {'distance', 'two_sigma', 'measuring_arm', 'standards'}
    keys(record, {'phi', 'position', 'orientation', *of_a_gauge})
    assert all(record[name] is None for name in of_a_gauge)
    assert (record['orientation'] is not None) == oriented
    for sizes in (record['position'], record['orientation']):
        if sizes is not None:
            keys(sizes, SIZES)
            count(sizes['count'], 1)
            for key in SIZES - {'count'}:
                number(sizes[key], 0.0)


def point_result(record: Record, oriented: bool) -> None:
    """The whole of `result.json` of measured points."""
    keys(record, TOP | POINT_TOP, ADDED_TOP)
    assert record['objective'] == 'position'
    assert record['spheres'] == []
    transform(record['flange_T_probe'])
    assert not any(one['name'].startswith('probe_') for one in record['parameters'])
    for target in record['targets']:
        assert type(target['target']) is str
        three(target['translation'])
        three(target['standard_uncertainty'], 0.0)
        for key in ('rotation_vector', 'rotation_uncertainty'):
            assert (target[key] is not None) == oriented
    for station in record['stations']:
        count(station['station'], 1)
        for key in ('translation', 'rotation_vector'):
            three(station[key])
        for key in ('standard_uncertainty', 'rotation_uncertainty'):
            three(station[key], 0.0)
    for key in ('initial', 'identified', 'test', 'test_initial'):
        if record['quality'][key] is not None:
            point_quality(record['quality'][key], oriented)
    if record['correction'] is not None:
        point_correction(record['correction'], oriented)
    for rejected in record['rejected']:
        keys(rejected, POINT_REJECTED)
    keys(record['solver'], SOLVER)
