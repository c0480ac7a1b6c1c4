# SPDX-License-Identifier: Apache-2.0
"""A measurement from a bag that holds no poses: paired, and sorted by location and sphere."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.bags import BagDescriptions, Told, listed_topics, read_notes
from calib_model.errors import BagError, ContactError, DataError
from calib_model.instruments import Arm, Gauge, PassiveProbe, Probe, known_centers
from calib_model.kinematics import points
from calib_model.labelling.certificate_match import Certificate
from calib_model.labelling.mended_streams import mended_poses
from calib_model.labelling.raw_settings import Instruments, RawSettings
from calib_model.labelling.seated_poses import recorded_poses, seated_poses
from calib_model.labelling.sphere_clusters import SeenLocation, SphereClustering, SphereClusters
from calib_model.labelling.sphere_numbering import Numbering, numbered
from calib_model.measurement import Measurement, ProbingSet
from calib_model.pairing import (
    HAND_GUIDED_NOTE,
    NOTE,
    HandGuidedSettings,
    Paired,
    RawBag,
    RawStreams,
    SteadyPose,
    SteadySettings,
    hand_guided_settings_of,
    pair_streams,
    read_raw,
    settings_of,
)
from calib_model.topics import ARM_DESCRIPTION, GAUGE_DESCRIPTION, PROBE_DESCRIPTION

MOST_STRAYS = 5  # that are told one by one


@dataclass(frozen=True)
class Sorted:
    """A raw bag's poses by location, from 1, and place; `measured` has in `sphere` the places'
    numbers until a `Numbering` gives them the certificate's. `lines` say what was done."""

    measured: Measurement
    locations: tuple[SeenLocation, ...]
    certificate: Certificate
    near: float
    lines: tuple[str, ...] = field(default=())


def label_bag(
    path: str | Path, choice: RawSettings, given: Instruments, told: Told | None = None
) -> Sorted:
    """The poses of a bag with nothing but its raw topics, told apart by location and place.

    Raises:
        BagError: no bag, a topic or a description missing, one that changes within the bag, or no
            pose comes of it.
        DescriptionError: a description in the bag cannot be used.
        DataError: no two spheres stand to one another as on the certificate.
    """
    topics = listed_topics(path)
    if topics:
        _refuse_undescribed(path, given, topics)  # before hundreds of MB are read
    seatable = given.probe is None or isinstance(given.probe, PassiveProbe)
    bag = read_raw(path, choice.topics, told, readings=not seatable, stamps=choice.stamps)
    there = _instruments(path, given, bag.described)
    _refuse_unknown(choice, there)
    names = choice.topics.joints or there.arm.joint_names
    if isinstance(there.probe, PassiveProbe) and not bag.has_readings:
        streams, *rest = bag.streams(names)
        if rest:
            raise BagError(f'{path}: the clock is set back: record what comes after by itself')
        seated = seated_poses(there.arm, there.probe, streams, choice)
        lines = [
            *bag.lines,
            f'{path}: {len(streams.joints)} joint states in {streams.seconds:.0f} s and no '
            f'readings, of a passive probe',
            seated.line,
        ]
        if not seated.poses:
            raise BagError(f'{path}: no pose comes of its joint states: the arm never stopped')
        return _sorted(path, there, choice, seated.poses, seated.p_base, lines)
    if not bag.has_readings:
        bag.refuse_missing()
    return _paired(path, bag, there, choice)


def label_poses(
    path: str | Path,
    choice: RawSettings,
    given: Instruments,
    described: BagDescriptions,
    poses: ProbingSet,
) -> Sorted:
    """The same of poses that were taken one by one with a passive probe, and nobody labelled.

    Raises:
        BagError: a description is missing, or the probe is none that gives no readings.
        DescriptionError: a description in the bag cannot be used.
        DataError: no two spheres stand to one another as on the certificate.
    """
    _refuse_undescribed(path, given, described)
    there = _instruments(path, given, described)
    _refuse_unknown(choice, there)
    if not isinstance(there.probe, PassiveProbe):
        raise BagError(f'{path}: poses without sphere numbers, but {there.probe.name} is active')
    if poses.joints.shape[1] != there.arm.n:
        raise DataError(
            f'{path}: poses have {poses.joints.shape[1]} joint positions, the arm '
            f'{there.arm.name} has {there.arm.n} joints'
        )
    taken = recorded_poses(there.arm, there.probe, poses.take(np.argsort(poses.stamp)))
    return _sorted(path, there, choice, taken.poses, taken.p_base, [f'{path}: {taken.line}'])


@dataclass(frozen=True)
class _Described:
    """What a bag was taken with."""

    arm: Arm
    probe: Probe
    gauge: Gauge


def _instruments(path: str | Path, given: Instruments, described: BagDescriptions) -> _Described:
    _refuse_undescribed(path, given, described)
    return _Described(
        given.arm or described.arm(),
        given.probe or described.probe(),
        given.gauge or described.gauge(),
    )


def _refuse_unknown(choice: RawSettings, there: _Described) -> None:
    unknown = [number for number in choice.spheres if number not in there.gauge.numbers]
    if unknown:
        raise DataError(f'{there.gauge.name}: no sphere {unknown[0]} on the certificate')
    names = choice.topics.joints
    if names and len(names) != there.arm.n:
        raise DataError(
            f'--joints names {len(names)} joints, the arm {there.arm.name} has {there.arm.n}'
        )


def _paired(path: str | Path, bag: RawBag, there: _Described, choice: RawSettings) -> Sorted:
    """Of the joints and the readings with one another."""
    arm, probe, gauge = there.arm, there.probe, there.gauge
    notes = read_notes(path, (NOTE, HAND_GUIDED_NOTE))
    settings = replace(
        settings_of(notes[NOTE]),
        **dict(choice.settings),  # type: ignore[arg-type]
    )
    guided, shift = _guided(notes[HAND_GUIDED_NOTE], str(path))
    names = choice.topics.joints or arm.joint_names
    streams = bag.streams(names, settings.lateness if guided is None else guided.lateness)

    def touching(displacement: Array) -> NDArray[np.bool_]:
        centers = known_centers(probe, displacement, gauge.sphere_diameter)
        return np.asarray(np.isfinite(centers).all(axis=1))

    def pair(part: RawStreams, settings: SteadySettings) -> Paired:
        return pair_streams(part, settings, choice.standing, guided, shift, touching)

    found = mended_poses(path, streams, names, settings, pair)
    lines = [*bag.lines, *found.lines]
    poses, p_base, unusable = _seen(arm, probe, gauge, found.poses)
    if unusable:
        lines.append(f'{unusable} poses left out: readings that no sphere of the gauge gives')
    if not poses:
        raise BagError('; '.join((f'{path}: {found.why}', *bag.lines)))
    return _sorted(path, there, choice, poses, p_base, lines)


def _sorted(
    path: str | Path,
    there: _Described,
    choice: RawSettings,
    poses: Sequence[SteadyPose],
    p_base: Array,
    lines: Sequence[str],
) -> Sorted:
    """Poses in time order by location and place; `p_base` (N, 3) is where the arm saw them, m."""
    certificate = Certificate(there.gauge, choice.spheres)
    grouping = SphereClustering(p_base, certificate)
    grouped = grouping.run()
    if not grouped.locations:
        raise DataError(f'{path}: {_nothing(grouped)}')
    by_place = _by_place(poses, grouped)
    measured = Measurement(there.arm, there.probe, there.gauge, by_place, str(path))
    told = (*lines, *_told_apart(grouped))
    return Sorted(measured, tuple(grouped.locations), certificate, grouping.near, told)


def _guided(note: Mapping[str, str], source: str) -> tuple[HandGuidedSettings | None, int]:
    """What a hand-guided arm was paired with as it was captured, if it was."""
    return hand_guided_settings_of(note, source) if note else (None, 0)


def _refuse_undescribed(path: str | Path, given: Instruments, there: Container[str]) -> None:
    wanted = (
        ('arm', given.arm, ARM_DESCRIPTION),
        ('probe', given.probe, PROBE_DESCRIPTION),
        ('gauge', given.gauge, GAUGE_DESCRIPTION),
    )
    missing = [
        (name, topic.name)
        for name, known, topic in wanted
        if known is None and topic.name not in there
    ]
    if missing:
        topics = ', '.join(topic for _, topic in missing)
        options = ' '.join(f'--{name} {name}.yaml' for name, _ in missing)
        raise BagError(f'{path}: the bag has no {topics}: give {options}')


def _seen(
    arm: Arm, probe: Probe, gauge: Gauge, poses: Sequence[SteadyPose]
) -> tuple[list[SteadyPose], Array, int]:
    """The poses, where the arm sees their sphere (N, 3), and how many cannot be used."""
    usable, centers = [], []
    try:
        displacement = np.array([pose.displacement for pose in poses]).reshape(-1, 3)
        centers = list(probe.centers(displacement, gauge.sphere_diameter))
        usable = list(poses)
    except ContactError:
        for pose in poses:
            try:
                centers.append(probe.centers(pose.displacement[None], gauge.sphere_diameter)[0])
            except ContactError:
                continue
            usable.append(pose)
    if not usable:
        return [], np.empty((0, 3)), len(poses)
    p_flange = probe.flange_T_probe.apply(np.array(centers))
    p_base = points(arm, np.array([pose.joints for pose in usable]), p_flange)
    return usable, p_base, len(poses) - len(usable)


def _by_place(poses: Sequence[SteadyPose], grouped: SphereClusters) -> ProbingSet:
    labels = sorted(
        (row, number, place_number)
        for number, location in enumerate(grouped.locations, start=1)
        for place_number, place in enumerate(location.places, start=1)
        for row in place.rows
    )
    kept = [poses[row] for row, _, _ in labels]
    return ProbingSet(
        np.array([number for _, number, _ in labels], dtype=np.int64),
        np.array([place for _, _, place in labels], dtype=np.int64),
        np.array([pose.joints for pose in kept]),
        np.array([pose.displacement for pose in kept]),
        np.array([pose.stamp for pose in kept], dtype=np.int64),
        np.array([pose.readings for pose in kept], dtype=np.int64),
    )


def _told_apart(grouped: SphereClusters) -> list[str]:
    places = sum(len(location.places) for location in grouped.locations)
    lines = [f'{len(grouped.locations)} locations of the gauge with {places} spheres told apart']
    lines += [stray.line() for stray in grouped.strays[:MOST_STRAYS]]
    rest = grouped.strays[MOST_STRAYS:]
    if rest:
        count = sum(len(stray.place.rows) for stray in rest)
        lines.append(f'{count} poses at {len(rest)} more places left out: they fit no sphere')
    return lines


def _nothing(grouped: SphereClusters) -> str:
    """Why no location was found, with the distances of the first place that was left out."""
    text = f'none of {len(grouped.strays)} places stand to one another as on the certificate'
    return f'{text}; {grouped.strays[0].line()}' if grouped.strays else text


def numbering_of(parts: Sequence[Sorted]) -> Numbering:
    """The numbers of the spheres of several bags, as far as they can the same in all."""
    locations = [location for part in parts for location in part.locations]
    return numbered(locations, parts[0].certificate, parts[0].near)


def with_numbers(part: Sorted, numbers: Sequence[tuple[int, ...]]) -> Measurement:
    """The measurement of a bag whose locations' places have these numbers of the certificate."""
    poses = part.measured.poses
    sphere = np.array(
        [
            numbers[location - 1][place - 1]
            for location, place in zip(poses.location, poses.sphere, strict=True)
        ],
        dtype=np.int64,
    )
    relabelled = ProbingSet(
        poses.location, sphere, poses.joints, poses.displacement, poses.stamp, poses.readings
    )
    measured = part.measured
    return Measurement(
        measured.arm, measured.probe, measured.gauge, relabelled, measured.source
    ).checked()
