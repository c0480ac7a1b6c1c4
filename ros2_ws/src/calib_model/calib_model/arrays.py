# SPDX-License-Identifier: Apache-2.0
"""The array type that crosses rooms, and arrays that are read-only once built."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frozen(values: object) -> Array:
    """A read-only float64 copy of `values`, any shape."""
    return read_only(np.array(values, dtype=np.float64, order='C'))


def read_only(values: Array) -> Array:
    """An array that nobody else holds, any shape, itself, read-only from now on."""
    values.setflags(write=False)
    return values


def largest_difference(one: Array, other: Array) -> float:
    """Between the elements of two arrays (n,), finite ones; for a handful of joints numpy's own way
    takes three times as long."""
    return max(map(abs, (one - other).tolist()))


def lengths(vectors: Array) -> Array:
    """How long vectors (N, k) are, (N,): of thousands numpy's own norm takes three times that."""
    found: Array = np.sqrt(np.einsum('nk,nk->n', vectors, vectors))
    return found


def median(values: Array) -> Array:
    """The median along the first axis of finite values, NaN of none; numpy's own looks for NaN and
    for masked arrays first, which takes several times as long for a few hundred."""
    if not len(values):
        return np.full(values.shape[1:], np.nan)
    middle = len(values) // 2
    if len(values) % 2:
        odd: Array = np.partition(values, middle, axis=0)[middle]
        return odd
    ends = np.partition(values, (middle - 1, middle), axis=0)[middle - 1 : middle + 1]
    even: Array = ends.mean(axis=0)
    return even


def largest_steps(values: Array, over: int = 1) -> Array:
    """The largest change (N - over,) of any column between rows of values (N, k) that are `over`
    apart: column by column, as all at once takes three times the memory that the values do."""
    found = np.zeros(max(len(values) - over, 0))
    for column in values.T:
        np.maximum(found, np.abs(column[over:] - column[:-over]), out=found)
    return found
