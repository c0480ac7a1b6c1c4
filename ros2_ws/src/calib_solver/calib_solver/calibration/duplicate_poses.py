# SPDX-License-Identifier: Apache-2.0
"""Poses that say nothing new, or are too few to: both would make a result look too sure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib_model.measurement import Measurement, ProbingSet
from calib_solver.identified import Identification

#: multipliers of a sum that hardly two rows share
MIXING = np.random.default_rng(0).integers(1, 2**63, 64, dtype=np.uint64) | np.uint64(1)


def find_duplicates(poses: ProbingSet) -> NDArray[np.bool_]:
    """Which poses (N,) have the stamp, sphere number, joints and readings of an earlier one, to the
    last digit: a bag that was given twice, a recording played in a loop. A location is not looked
    at, as that of a second bag is counted on. An arm that comes back to where it was, at another
    time, is measured anew."""
    rows = _rows(poses)
    key = _key(rows)
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    earlier = first[group]
    later = np.flatnonzero(earlier < np.arange(len(rows)))
    copy = np.zeros(len(rows), dtype=np.bool_)
    copy[later] = (rows[later] == rows[earlier[later]]).all(axis=1)
    return copy


def duplicate_lines(count: int) -> tuple[str, ...]:
    """A line where poses were left out as copies."""
    if not count:
        return ()
    return (f'{count} poses are copies of others, to the last digit: each counts once',)


def seen_lines(held_out: Measurement, measured: Measurement) -> tuple[str, ...]:
    """A line where what should be held out was identified from."""
    seen = int(np.isin(_key(_rows(held_out.poses)), _key(_rows(measured.poses))).sum())
    if not seen:
        return ()
    return (
        f'{seen} of {len(held_out.poses)} held-out poses were identified from, too: these were not '
        'held out',
    )


def noise_lines(done: Identification) -> tuple[str, ...]:
    """A line where the poses are too few to tell their own noise."""
    sure = done.uncertainty
    if not sure.assumed:
        return ()
    return (
        f'{len(done.problem.joints)} poses of {len(done.problem.keys)} spheres leave nothing over '
        f'to tell their noise by: {sure.noise * 1e3:g} mm is assumed for the uncertainties',
    )


def _rows(poses: ProbingSet) -> NDArray[np.float64]:
    rows: NDArray[np.float64] = np.column_stack([poses.sphere, poses.joints, poses.displacement])
    positive: NDArray[np.float64] = rows + 0.0  # no negative zeros
    return positive


def _key(rows: NDArray[np.float64]) -> NDArray[np.uint64]:
    """A number for each row: equal rows have equal ones, others hardly ever."""
    bits = np.ascontiguousarray(rows).view(np.uint64)
    mixed = bits ^ (bits >> np.uint64(32))
    factors = np.resize(MIXING, rows.shape[1])
    key: NDArray[np.uint64] = (mixed * factors).sum(axis=1, dtype=np.uint64)
    return key
