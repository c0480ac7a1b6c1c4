# SPDX-License-Identifier: Apache-2.0
"""A raw bag's streams, mended where that is sound, and paired part by part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.errors import BagError, DataError
from calib_model.pairing import Paired, RawStreams, SteadyPose, SteadySettings, reasons_in_words
from calib_model.stamps import SECOND
from calib_model.streams import Freshness, Turns, freshness, rival, unwrapped

NEEDED_RATE = 50.0  # Hz of joint states, of an arm that moves while it is paired
LEAST_RATE = 20.0  # Hz, of which none are paired
SLOWEST = 0.25  # s between joint states of an arm that stops for each pose
WIDE = 1.5  # of the usual gap: a joint state is missing there
Pair = Callable[[RawStreams, SteadySettings], Paired]


@dataclass(frozen=True)
class MendedPoses:
    """Poses in time order, part by part, whether the arm stood for them, `lines` that say what was
    done, and in `why` what speaks for there being none."""

    poses: tuple[SteadyPose, ...]
    standing: bool
    lines: tuple[str, ...]
    why: str


def mended_poses(
    path: object,
    parts: Sequence[RawStreams],
    names: Sequence[str],
    settings: SteadySettings,
    pair: Pair,
) -> MendedPoses:
    """The poses of streams in one part or several, those with joints of these `names`.

    Raises:
        BagError: joint states that are too seldom for an arm in motion, or of two publishers.
    """
    poses: list[SteadyPose] = []
    lines: list[str] = []
    refused: Counter[str] = Counter()
    stops = contacts = 0
    standing = True
    why = ''
    for number, streams in enumerate(parts, start=1):
        of = f', part {number} of {len(parts)}' if len(parts) > 1 else ''
        mended, turns, fresh, said = _mended(path, streams, names)
        paired = pair(mended, _at_rate(settings, mended.joint_stamp))
        lines += [
            f'{path}{of}: {len(streams.joints)} joint states and {len(streams.displacement)} '
            f'readings in {streams.seconds:.0f} s',
            *said,
            *paired.lines(),
        ]
        slow = fresh.every > 1 / NEEDED_RATE
        why = f'; {_needed(fresh)}' if slow else why
        if not paired.standing and slow:
            if fresh.every > 1 / LEAST_RATE:
                raise BagError(f'{path}: {_needed(fresh)}')
            lines.append(f'warning: {_needed(fresh)}, poses are off by what it does between')
        if streams.late:
            lines.append(
                f'{streams.late} messages out of order, or with stamps that came twice, left out'
            )
        poses += (
            replace(pose, joints=frozen(turns.as_counted(pose.joints))) for pose in paired.poses
        )
        standing = standing and paired.standing
        stops, contacts, refused = (
            stops + paired.stops,
            contacts + paired.contacts,
            refused + paired.refused,
        )
    reasons = reasons_in_words(refused)
    why = (
        f'no pose comes of its {stops} stops and {contacts} contacts with good readings'
        + (f'; stops refused: {reasons}' if reasons else '')
        + why
    )
    return MendedPoses(tuple(poses), standing, tuple(lines), why)


def _mended(
    path: object, streams: RawStreams, names: Sequence[str]
) -> tuple[RawStreams, Turns, Freshness, list[str]]:
    """Streams without what is known to be wrong, and a line for each kind of it."""
    stamp, (joints, turns) = streams.joint_stamp, unwrapped(streams.joints)
    lines = [
        f'joint {name} jumps by a turn {count} times: its encoder begins anew there, and it goes on'
        for name, count in zip(names, turns.jumps, strict=True)
        if count
    ]
    try:
        others = rival(stamp, joints)
    except DataError as error:
        raise BagError(f'{path}: {error}') from error
    if others.any():
        lines.append(
            f'warning: {int(others.sum())} joint states left out that are one and the same '
            'position between others: a second publisher on the topic'
        )
        stamp, joints = stamp[~others], joints[~others]
    fresh = freshness(stamp, joints)
    lines += _said(fresh, stamp, joints)
    kept = slice(None) if fresh.sound.all() else fresh.sound
    return replace(streams, joint_stamp=stamp[kept], joints=joints[kept]), turns, fresh, lines


def _said(fresh: Freshness, stamp: NDArray[np.int64], joints: Array) -> list[str]:
    old = int((~fresh.sound).sum())
    if fresh.repeats and old:
        return [f'{fresh.rate()}: {old} old ones left out']
    if not fresh.hung:
        return []
    row, lasted = max(fresh.hung, key=lambda one: one[1])
    return [
        f'warning: joint states repeat an old position {len(fresh.hung)} times while the arm goes '
        f'on, for {lasted:.2f} s at most, {(stamp[row] - stamp[0]) / SECOND:.1f} s from the first: '
        f'{old} left out, nothing is paired there'
    ]


def _needed(fresh: Freshness) -> str:
    return f'{fresh.rate()}: of an arm that is led {NEEDED_RATE:.0f} and more are needed'


def _at_rate(settings: SteadySettings, stamp: NDArray[np.int64]) -> SteadySettings:
    """The settings for joint states that come as seldom as these: an arm that stands is known to
    have stood between two of them, once it has for one more."""
    if len(stamp) < 2:
        return settings
    usual = float(np.median(np.diff(stamp))) / SECOND
    gap = min(SLOWEST, WIDE * usual)
    if gap <= settings.max_gap:
        return settings
    return replace(settings, max_gap=gap, settle=max(settings.settle, usual))
