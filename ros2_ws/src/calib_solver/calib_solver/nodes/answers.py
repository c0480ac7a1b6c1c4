# SPDX-License-Identifier: Apache-2.0
"""The answers of the services, filled from the records of what was done."""

from __future__ import annotations

import math

from calib_interfaces.srv import Compare, Evaluate, FitProbe, Identify, Verify

from calib_solver.nodes import messages
from calib_solver.results import Record


def identified(response: Identify.Response, record: Record) -> None:
    """What `/identify` answers."""
    result = record['result']
    quality = result['quality']
    response.arm, response.objective = result['arm'], result['objective']
    response.parameters = messages.parameters(result['parameters'])
    response.flange_t_probe = messages.transform(result['flange_T_probe'])
    response.spheres = messages.spheres(result['spheres'])
    response.initial = messages.quality(quality['initial'])
    response.identified = messages.quality(quality['identified'])
    if quality['test'] is not None:
        response.has_test = True
        response.test = messages.quality(quality['test'])
        response.test_initial = messages.quality(quality['test_initial'])
    response.solver = messages.solver(result['solver'])
    if 'targets' in result:
        response.rejected_points = messages.rejected_points(result['rejected'])
        response.targets = messages.targets(result['targets'])
        response.stations = messages.stations(result['stations'])
    else:
        response.rejected = messages.rejected(result['rejected'])
    response.diagnostics = messages.diagnostics(result['diagnostics'])
    for name in ('probe_fit', 'resampling', 'joint_errors', 'correction'):
        if result[name] is not None:
            setattr(response, f'has_{name}', True)
            setattr(response, name, getattr(messages, name)(result[name]))
    if quality['left_out'] is not None:
        response.has_left_out = True
        response.left_out = messages.left_out(quality['left_out'])
    response.readings = messages.readings(result['readings'])
    response.notes, response.warnings = record['notes'], result['warnings']
    response.written, response.message = record['written'], record['message']


def probe_fitted(response: FitProbe.Response, record: Record) -> None:
    """What `/fit_probe` answers."""
    response.flange_t_probe = messages.transform(record['flange_T_probe'])
    response.standard_uncertainty = record['standard_uncertainty']
    response.spheres = messages.spheres(record['spheres'])
    response.probe_fit = messages.probe_fit(record['probe_fit'])
    response.written, response.message = record['written'], record['message']


def evaluated(response: Evaluate.Response, record: Record) -> None:
    """What `/evaluate` answers."""
    response.quality = messages.quality(record)
    response.spheres = messages.spheres(record.get('spheres', []))
    response.message = record['message']


def verified(response: Verify.Response, record: Record) -> None:
    """What `/verify` answers."""
    response.verdict, response.within = record['verdict'], record['stated']['within']
    response.limits = messages.limits(record['limits'])
    for name in ('position', 'distance'):
        stated = record['stated'][name] or {'stated': math.nan, 'bound': math.nan}
        setattr(response, f'{name}_stated', stated['stated'])
        setattr(response, f'{name}_bound', stated['bound'])
    response.quality = messages.quality(record['quality'])
    response.nominal = messages.quality(record['nominal'])
    response.spheres = messages.spheres(record['spheres'])
    response.written, response.message = record['written'], record['message']


def compared(response: Compare.Response, record: Record) -> None:
    """What `/compare` answers."""
    response.verdict = record['verdict']
    response.order = [one['folder'] for one in record['results']]
    response.changes = [messages.change(step) for step in record['steps']]
    response.written, response.message = record['written'], record['message']
