# SPDX-License-Identifier: Apache-2.0
"""Descriptions held to what can stand in a hall: numbers beyond it are slips, and overflow."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments.arm import Arm
from calib_model.instruments.gauge import Gauge
from calib_model.instruments.probe import ActiveProbe, PassiveProbe, Probe
from calib_model.transforms import RigidTransform

FARTHEST = 1e3  # m
MOST_TURN = 1e3  # rad: degrees and turns written for rad stay below, to be named for what they are

#: of half a stroke, that a sphere may push a stylus off its middle: to be probed, and at all
ROOM, WHOLE_ROOM = 0.8, 1.001
MEETING = 1e-3  # m that the axes of styli that meet may pass one another by

Quantity = tuple[str, Array, float]  # what it is called, its values, the most that they may be


def seat_displacement(probe: ActiveProbe, sphere_diameter: float) -> Array:
    """Displacements (3,), m, by a sphere that is centred where the styli's axes meet; the middle of
    the strokes where they do not meet, and where the sphere is out of reach there NaN."""
    origin, along = probe.origin, probe.direction
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    meeting = np.linalg.pinv(across.sum(axis=0)) @ np.einsum('sij,sj->i', across, origin)
    past = np.linalg.norm(np.einsum('sij,sj->si', across, meeting - origin), axis=1)
    middle: Array = probe.stroke.mean(axis=1)
    if past.max() > MEETING or abs(np.linalg.det(along)) < MEETING:
        return middle
    return probe.displacements(meeting[None], sphere_diameter)[0]


def refuse_misfit(probe: Probe, gauge: Gauge, room: float = ROOM) -> None:
    """Raise where a sphere of the gauge is too large or too small for an active probe's styli.

    A sphere sits where the styli's axes meet; there each stylus needs some of its stroke to both
    sides, or there is nothing to be read. `room` is what it may take of half a stroke.

    Raises:
        DataError: names probe, gauge and both diameters.
    """
    if not isinstance(probe, ActiveProbe):
        return
    middle, half = probe.stroke.mean(axis=1), np.ptp(probe.stroke, axis=1) / 2
    off = seat_displacement(probe, gauge.sphere_diameter) - middle
    if not (np.abs(off) <= room * half).all():
        made_for = (gauge.sphere_diameter - 2 * np.mean(off)) * 1e3
        raise DataError(
            f'{probe.name}: its styli are made for spheres of about {made_for:.3g} mm, those of '
            f'{gauge.name} have {gauge.sphere_diameter * 1e3:.4g} mm: they do not belong together'
        )


def refuse_impossible(arm: Arm, probe: Probe, gauge: Gauge, source: str) -> None:
    """Raise where a length is over a kilometre, an angle over 1000 rad, or two spheres are one.

    Raises:
        DataError: names the instrument, the quantity and the value.
    """
    for of, found in (
        (arm.name, _of_arm(arm)),
        (probe.name, _of_probe(probe)),
        (gauge.name, _of_gauge(gauge)),
    ):
        for name, values, most in found:
            largest = float(np.abs(values).max(initial=0.0))
            if not largest <= most:
                unit, slip = ('m', ': is it in mm?') if most == FARTHEST else ('rad', '')
                raise DataError(
                    f'{source}: {of}: {name} of {largest:g} {unit}, expected {most:g} at most{slip}'
                )
    places: dict[tuple[float, float, float], int] = {}
    for number, center in gauge.spheres:
        if places.setdefault(center, number) != number:
            raise DataError(
                f'{source}: {gauge.name}: spheres {places[center]} and {number} are at one place'
            )


def _of_arm(arm: Arm) -> Iterator[Quantity]:
    a, alpha, d, theta_0, beta = arm.geometry
    yield from (('a', a, FARTHEST), ('d', d, FARTHEST))
    yield from (('alpha', alpha, MOST_TURN), ('theta_0', theta_0, MOST_TURN))
    yield 'beta', beta, MOST_TURN
    for key in ('base_T_dh', 'dh_T_flange', 'flange_T_controller'):
        yield from _of_transform(key, getattr(arm, key))


def _of_probe(probe: Probe) -> Iterator[Quantity]:
    yield from _of_transform('flange_T_probe', probe.flange_T_probe)
    if isinstance(probe, PassiveProbe):
        yield 'center', probe.center, FARTHEST
        return
    yield 'origin', probe.origin, FARTHEST
    yield 'tip_radius', np.array([stylus.tip_radius for stylus in probe.styli]), FARTHEST
    yield 'stroke', probe.stroke, FARTHEST


def _of_gauge(gauge: Gauge) -> Iterator[Quantity]:
    yield 'sphere_diameter', np.array(gauge.sphere_diameter), FARTHEST
    yield 'center', np.array([center for _, center in gauge.spheres]), FARTHEST
    yield 'uncertainty', np.array([gauge.constant, gauge.proportional]), FARTHEST


def _of_transform(name: str, transform: RigidTransform) -> Iterator[Quantity]:
    yield f'{name}: translation', transform.translation, FARTHEST
    yield f'{name}: rotation_vector', transform.rotation_vector, MOST_TURN
