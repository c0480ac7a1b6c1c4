# SPDX-License-Identifier: Apache-2.0
"""How much room arm, probe and gauge take: capsules and spheres, plain data.

An arm's description says where its axes are, not how thick its links are. Each of its D-H lengths
becomes a capsule; where no radii are given they are assumed from the arm's reach, from 6 % of it
at the base to 3 % at the flange; bodies of the arm that touch in every posture then are passed
over. Real links can be thicker, and beside their axes: give a file of sizes before a real arm
moves, as `config/bodies/kr5.yaml` of calib_bringup.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError
from calib_model.files import Fields, load_mapping
from calib_model.instruments import ActiveProbe, Arm, Gauge, Probe

THICKEST, THINNEST = 0.06, 0.03  # of the reach
SHORTEST = 1e-3  # m: D-H lengths below it take no room of their own
WORLD = 0


class BodyError(CalibrationError):
    """Sizes that do not fit the arm."""


@dataclass(frozen=True)
class BodySettings:
    """Sizes in m.

    `link_radii`: of the arm's D-H lengths in order (d1, a1, d2, a2, ..., those that are zero left
    out), empty for the rule above. `link_offsets`: how far they are beside these lengths, along the
    axis of the joint that turns them, empty for not at all. The probe: a housing from the flange
    on, its rounded front `housing_gap` behind the middle of the sphere; three styli as rods of
    `stylus_length` beyond their tips. The gauge: a rod whose axis runs `rod_drop` below the
    centres (against the gauge's z; 0 is a rod through them) and `rod_overhang` beyond the last of
    them. `floor`: height of a plane in the base frame, 0 where the arm is mounted, None for none.
    Bodies keep `clearance` from one another.
    """

    link_radii: tuple[float, ...] = ()
    link_offsets: tuple[float, ...] = ()
    housing_radius: float = 0.030
    housing_gap: float = 0.020
    stylus_radius: float = 0.003
    stylus_length: float = 0.022
    rod_radius: float = 0.010
    rod_drop: float = 0.030
    rod_overhang: float = 0.020
    floor: float | None = 0.0
    clearance: float = 0.002


@dataclass(frozen=True)
class Body:
    """A capsule about the segment from `start` to `end` (3,), m; a sphere where they are one.

    `frame` is the joint (from 1) that it moves with, as `PinocchioArm` has it, or `WORLD`; gauge
    bodies are in the gauge frame. `kind` is arm, probe, sphere or rod; `sphere` the number on the
    certificate, `stylus` whether it may touch the sphere that is probed.
    """

    name: str
    kind: str
    frame: int
    start: Array
    end: Array
    radius: float
    sphere: int = -1
    stylus: bool = False


@dataclass(frozen=True)
class Bodies:
    """Everything that takes room. `self_pairs` are rows of `moving` that can meet one another:
    not those that a joint holds together."""

    moving: tuple[Body, ...]
    gauge: tuple[Body, ...]
    settings: BodySettings
    self_pairs: tuple[tuple[int, int], ...] = field(default=())


def bodies_of(
    arm: Arm, probe: Probe, gauge: Gauge, settings: BodySettings = BodySettings()
) -> Bodies:
    """The bodies of an arm with its probe before a gauge.

    Raises:
        BodyError: the number of link radii is not that of the arm's lengths.
    """
    links = _links(arm, settings)
    housing = _housing(arm, probe, gauge, settings)
    styli = _styli(arm, probe, gauge, settings)
    moving = (*links, housing, *styli)
    pairs = tuple(
        (i, j)
        for i in range(len(links))
        for j in range(i + 1, len(moving))
        if _can_meet(moving, i, min(j, len(links)))
    )
    return Bodies(moving, _gauge_bodies(gauge, settings), settings, pairs)


def _links(arm: Arm, settings: BodySettings) -> tuple[Body, ...]:
    segments: list[tuple[str, int, Array, Array]] = []
    for joint, (a, _, d, theta_0, _) in enumerate(arm.geometry.T, start=1):
        along_z = np.array([0.0, 0.0, d])
        along_x = along_z + a * np.array([np.cos(theta_0), -np.sin(theta_0), 0.0])
        segments.append((f'd{joint}', joint, np.zeros(3), along_z))
        segments.append((f'a{joint}', joint, along_z, along_x))
    segments = [row for row in segments if np.linalg.norm(row[3] - row[2]) > SHORTEST]
    radii = settings.link_radii
    if not radii:
        reach = sum(float(np.linalg.norm(end - start)) for _, _, start, end in segments)
        radii = tuple(np.linspace(THICKEST * reach, THINNEST * reach, len(segments)).tolist())
    offsets = settings.link_offsets or (0.0,) * len(segments)
    for what, given in (('radii', radii), ('offsets', offsets)):
        if len(given) != len(segments):
            names = ', '.join(name for name, *_ in segments)
            raise BodyError(
                f'{arm.name}: expected {len(segments)} link {what} ({names}), got {len(given)}'
            )
    return tuple(
        Body(name, 'arm', joint, frozen(start + aside), frozen(end + aside), radius)
        for (name, joint, start, end), radius, aside in zip(
            segments, radii, np.outer(offsets, (0.0, 0.0, 1.0)), strict=True
        )
    )


def _in_last_joint(arm: Arm, probe: Probe, p_probe: Array) -> Array:
    """Points (K, 3) of the probe in the last joint's turning frame."""
    a, alpha, d, theta_0, beta = arm.geometry[:, -1]
    p = arm.dh_T_flange.apply(probe.flange_T_probe.apply(p_probe))
    p = p @ _about(1, beta).T @ _about(0, alpha).T + np.array([a, 0.0, d])
    turned: Array = p @ _about(2, -theta_0).T
    return turned


def _about(axis: int, angle: float) -> Array:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def _seat(probe: Probe, gauge: Gauge) -> Array:
    if isinstance(probe, ActiveProbe):
        seat: Array = probe.centers(probe.stroke.mean(axis=1)[None], gauge.sphere_diameter)[0]
        return seat
    return probe.center


def _housing(arm: Arm, probe: Probe, gauge: Gauge, settings: BodySettings) -> Body:
    """From the flange's centre towards the seat; its rounded front stays `housing_gap` off."""
    seat = _seat(probe, gauge)
    flange = probe.flange_T_probe.inverse().translation
    way = seat - flange
    length = float(np.linalg.norm(way))
    kept = max(length - settings.housing_gap - settings.housing_radius, SHORTEST)
    ends = _in_last_joint(arm, probe, np.array([flange, flange + way * kept / max(length, 1e-9)]))
    radius = settings.housing_radius
    return Body('housing', 'probe', arm.n, frozen(ends[0]), frozen(ends[1]), radius)


def _styli(arm: Arm, probe: Probe, gauge: Gauge, settings: BodySettings) -> tuple[Body, ...]:
    if not isinstance(probe, ActiveProbe):
        # the shank that carries the seat
        seat = _seat(probe, gauge)
        flange = probe.flange_T_probe.inverse().translation
        back = (flange - seat) / max(float(np.linalg.norm(flange - seat)), 1e-9)
        touch = seat + back * (gauge.sphere_diameter / 2 + settings.stylus_radius)
        ends = [(touch, seat + back * (settings.housing_gap + settings.housing_radius))]
    else:
        ends = []
        for stylus in probe.styli:
            direction = np.array(stylus.direction) / np.linalg.norm(stylus.direction)
            tip = np.array(stylus.origin)
            ends.append((tip, tip + settings.stylus_length * direction))
    placed = [_in_last_joint(arm, probe, np.array(pair)) for pair in ends]
    return tuple(
        Body(
            f'stylus {i}',
            'probe',
            arm.n,
            frozen(start),
            frozen(end),
            settings.stylus_radius,
            stylus=True,
        )
        for i, (start, end) in enumerate(placed, start=1)
    )


def _can_meet(moving: tuple[Body, ...], i: int, j: int) -> bool:
    """Whether what lies between two bodies of the chain is longer than they are thick."""
    between = sum(float(np.linalg.norm(body.end - body.start)) for body in moving[i + 1 : j])
    return j > i + 1 and between > moving[i].radius + moving[j].radius


def _gauge_bodies(gauge: Gauge, settings: BodySettings) -> tuple[Body, ...]:
    spheres = [
        Body(
            f'sphere {number}',
            'sphere',
            WORLD,
            frozen(center),
            frozen(center),
            gauge.sphere_diameter / 2,
            number,
        )
        for number, center in gauge.spheres
    ]
    certified = np.array([center for _, center in gauge.spheres])
    middle = certified.mean(axis=0)
    along = np.linalg.svd(certified - middle)[2][0] if len(certified) > 1 else np.eye(3)[0]
    reach = (certified - middle) @ along
    drop = np.array([0.0, 0.0, -settings.rod_drop])
    start, end = (
        middle + drop + along * where
        for where in (reach.min() - settings.rod_overhang, reach.max() + settings.rod_overhang)
    )
    rod = Body('rod', 'rod', WORLD, frozen(start), frozen(end), settings.rod_radius)
    return (*spheres, rod)


def parse_bodies(text: str, source: str = 'bodies') -> BodySettings:
    """Sizes from YAML text, keys as the fields of `BodySettings`; what is left out is as there.

    Raises:
        DescriptionError: a value that is no size.
    """
    default = BodySettings()
    names = tuple(BodySettings.__dataclass_fields__)
    top = load_mapping(text, source, names)
    sizes: dict[str, float] = {}
    for name in names:
        if name in ('link_radii', 'link_offsets', 'floor') or name not in top:
            continue
        sizes[name] = top.number(name)
        if sizes[name] < 0:
            raise top.refuse(name, 'expected a length, not a negative number')
    radii, offsets = _each_link(top, 'link_radii'), _each_link(top, 'link_offsets')
    if not all(radius > 0 for radius in radii):
        raise top.refuse('link_radii', 'expected radii above zero')
    floor = default.floor
    if 'floor' in top:
        floor = None if top.content['floor'] is None else top.number('floor')
    return BodySettings(link_radii=radii, link_offsets=offsets, floor=floor, **sizes)


def _each_link(top: Fields, name: str) -> tuple[float, ...]:
    if name not in top:
        return ()
    given = top.content[name]
    return top.numbers(name, len(given) if isinstance(given, list) else 1)
