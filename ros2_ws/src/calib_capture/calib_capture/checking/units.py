# SPDX-License-Identifier: Apache-2.0
"""An arm that stands on a sphere: units of joints and styli, contact, noise."""

from __future__ import annotations

import numpy as np

from calib_capture.checking.finding import DOUBTFUL, OK, WRONG, Finding
from calib_capture.checking.streams import Heard
from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import ActiveProbe, Arm, Gauge, refuse_misfit, seat_displacement

BEYOND = 1e-3  # rad or m that a joint may be outside its limits
STROKE_BEYOND = 1.05  # of a stroke, that a reading may be
QUIET, LOUD = 5e-6, 2e-5  # m, scatter of a standing stylus; readings of a pose lie within 2e-5
JOINT_QUIET, JOINT_LOUD = 5e-5, 3e-4  # rad
MOVING = 1e-3  # rad that a standing joint may drift
FEWEST = 10  # samples that tell of noise
OFF_MIDDLE = 0.4  # of half a stroke, by which a sphere may be too large or too small
MICRO = 1e6


def unit_findings(arm: Arm, probe: ActiveProbe, gauge: Gauge, heard: Heard) -> list[Finding]:
    """Units of joints and styli, contact, noise, and whether probe and gauge fit."""
    styli = stylus_units(probe, heard)
    units = [joint_units(arm, heard), *styli, _fit(probe, gauge)]
    wrong = any(each.verdict == WRONG for each in units)
    return units if wrong else [*units, *_noise(heard)]


def joint_units(arm: Arm, heard: Heard) -> Finding:
    """Whether the joints are within their limits, and what their unit is if not."""
    what = 'unit of joints'
    at = np.median(heard.postures.reshape(-1, arm.n), axis=0)
    lower, upper = arm.limits.T
    outside = np.maximum(at - upper, lower - at)
    worst = int(np.argmax(outside))
    if not len(heard.joints):
        return Finding(what, DOUBTFUL, 'no joint states', 'see above')
    if outside[worst] <= BEYOND:
        return Finding(what, OK, 'all within the limits')
    joint = arm.joints[worst]
    seen = f'{joint.name} at {at[worst]:.4g}, limits {lower[worst]:.3g} to {upper[worst]:.3g} '
    return Finding(what, WRONG, seen + joint.unit, _unit_advice(arm, at, worst))


def _unit_advice(arm: Arm, at: Array, worst: int) -> str:
    factors = [('degrees', np.radians(1.0)), ('mm', 1e-3)][arm.joints[worst].prismatic :]
    for unit, factor in factors:
        slides = np.array([joint.prismatic for joint in arm.joints])
        there = np.where(slides == (unit == 'mm'), at * factor, at)
        if abs(at[worst]) > np.pi and arm.within_limits(there)[0]:
            return f'are they in {unit}?'
    return 'is its zero, sign or unit another one?'


def stylus_units(probe: ActiveProbe, heard: Heard) -> list[Finding]:
    """Contact, and whether readings are as long as strokes."""
    s, stroke = heard.contacts, float(np.abs(probe.stroke).max())
    if not len(s):
        states = sorted({tuple(each.status) for each in heard.readings})[:3]
        told = ', '.join(str(each) for each in states)
        seen = f'no reading with all three styli OK (status {told})'
        return [Finding('contact', WRONG, seen, 'put the probe on a sphere')]
    contact = Finding('contact', OK, f'{len(s)} of {len(heard.readings)} readings')
    middle = np.median(s, axis=0)
    largest = float(np.abs(middle).max())
    if largest > stroke * STROKE_BEYOND:
        seen = f'{largest:.4g} m, where a stylus moves by {stroke * 1e3:g} mm at most'
        return [contact, Finding('unit of styli', WRONG, seen, _length_advice(largest, stroke))]
    if not probe.within_stroke(middle[None] / STROKE_BEYOND).all():
        stylus = int(np.argmin(probe.within_stroke(middle[None] / STROKE_BEYOND)[0])) + 1
        low, high = (probe.stroke[stylus - 1] * 1e3).tolist()
        seen = f'displacement {stylus} at {middle[stylus - 1] * 1e3:.3f} mm, stroke {low:g} to '
        advice = 'is its sign or its zero another one?'
        return [contact, Finding('unit of styli', WRONG, f'{seen}{high:g} mm', advice)]
    seen = f'up to {largest * 1e3:.2f} of {stroke * 1e3:g} mm'
    return [contact, Finding('unit of styli', OK, seen)]


def _length_advice(largest: float, stroke: float) -> str:
    for unit, factor in (('mm', 1e-3), ('um', 1e-6)):
        if largest * factor <= stroke and largest > 3 * stroke:
            return f'is its driver in {unit}?'
    return 'is its zero or its unit another one?'


def _noise(heard: Heard) -> list[Finding]:
    findings = []
    for what, values, quiet, loud, unit in (
        ('noise of styli', heard.contacts, QUIET, LOUD, 'um'),
        ('noise of joints', heard.postures, JOINT_QUIET, JOINT_LOUD, 'urad'),
    ):
        if len(values) < FEWEST:
            continue
        noise = scatter(values)
        seen = f'{noise * MICRO:.1f} {unit} while nothing is commanded'
        verdict = OK if noise <= quiet else DOUBTFUL if noise <= loud else WRONG
        advice = '' if verdict == OK else 'see to cables, shields and vibration'
        findings.append(Finding(what, verdict, seen, advice))
    if len(heard.joints) >= FEWEST and (drift := _drift(heard.postures)) > MOVING:
        seen = f'its joints turn by {drift:.3f} rad while nothing is commanded'
        findings.append(Finding('arm at rest', WRONG, seen, 'let it stand, and check again'))
    return findings


def _drift(values: Array) -> float:
    quarter = max(len(values) // 4, 1)
    ends = np.median(values[:quarter], axis=0), np.median(values[-quarter:], axis=0)
    return float(np.abs(ends[1] - ends[0]).max())


def _fit(probe: ActiveProbe, gauge: Gauge) -> Finding:
    what, diameter = 'probe and gauge', gauge.sphere_diameter * 1e3
    try:
        refuse_misfit(probe, gauge)
    except DataError as error:
        return Finding(what, WRONG, str(error), 'name the gauge and the probe that are there')
    off = np.abs(seat_displacement(probe, gauge.sphere_diameter) - probe.stroke.mean(axis=1))
    if (off > OFF_MIDDLE * np.ptp(probe.stroke, axis=1) / 2).any():
        seen = f'a sphere of {diameter:g} mm in the middle of the styli pushes them '
        seen += f'{off.max() * 1e3:.2f} mm off the middle of their strokes'
        return Finding(what, DOUBTFUL, seen, 'is the probe made for spheres of another diameter?')
    return Finding(what, OK, f'a sphere of {diameter:g} mm sits within the strokes')


def scatter(values: Array) -> float:
    """The largest standard deviation of values (N, k) about a slow course, by neighbours."""
    return float(np.std(np.diff(values, axis=0), axis=0).max() / np.sqrt(2))
