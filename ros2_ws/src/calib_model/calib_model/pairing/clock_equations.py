# SPDX-License-Identifier: Apache-2.0
"""The normal equations of the offset between two clocks, chunk by chunk, and their solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array

WHILE = 25  # readings within which nothing but motion moves the sphere
FITTED = 6  # chunks that look no worse than they are: the arm's parameters have bent to them
NOISE = 1e-4  # m: what no kinematic parameter explains


@dataclass(frozen=True)
class ChunkSums:
    """What a chunk tells when its readings are `around` s from the joints.

    Its columns are the rate by the offset, those of P parameters, and the sphere's place:
    `square` (P + 2, P + 2) sums their products over readings and coordinates, each column around
    its mean over a short while.
    """

    readings: int
    moving: int
    square: Array


def solved(chunks: Sequence[ChunkSums], prior: Array) -> tuple[float, float]:
    """The offset and its standard uncertainty, s, with the parameters as far off as `prior` lets.

    The uncertainty is that of chunks that err on their own: neighbouring readings err alike. It is
    no less than what the parameters leave open: chunks of one sphere, to which they all bent, agree
    with one another and not with the truth.
    """
    squares = np.array([chunk.square for chunk in chunks]) / NOISE**2
    square = squares.sum(axis=0)
    inverse = np.linalg.pinv(square[:-1, :-1] + np.diag(prior), hermitian=True)
    x = -inverse @ square[:-1, -1]
    score = np.append(inverse[0], 0.0) @ squares @ np.append(x, 1.0)
    freedom = len(chunks) / max(len(chunks) - FITTED, 1)
    scatter = np.sqrt((score**2).sum() * freedom)
    best = np.append(x, 1.0)
    noise = best @ square @ best / sum(3 * chunk.readings for chunk in chunks)  # in NOISE**2
    return float(x[0]), float(max(scatter, np.sqrt(inverse[0, 0] * noise * WHILE)))


def centred(columns: Array) -> Array:
    """Columns (N, 3, K) around their mean over each `WHILE` rows.

    What an arm's errors and the hand's force do to the sphere's place changes slowly, and so does
    not matter.
    """
    begin = np.arange(0, len(columns), WHILE)
    count = np.diff(np.append(begin, len(columns)))
    mean = np.add.reduceat(columns, begin) / count[:, None, None]
    centred: Array = columns - np.repeat(mean, count, axis=0)
    return centred
