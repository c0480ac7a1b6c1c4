# SPDX-License-Identifier: Apache-2.0
"""What numpy does too, for the few values of a message and for thousands of poses."""

import numpy as np
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from calib_model.arrays import largest_difference, lengths, median

FINITE = st.floats(-1e6, 1e6)


@given(
    st.integers(1, 12).flatmap(
        lambda n: st.one_of(
            arrays(np.float64, n, elements=FINITE), arrays(np.float64, (n, 3), elements=FINITE)
        )
    )
)
def test_it_is_numpys(values):
    assert np.array_equal(median(values), np.median(values, axis=0))


def test_of_nothing_there_is_none():
    assert np.isnan(median(np.zeros(0)))
    assert np.isnan(median(np.zeros((0, 3)))).all()


@given(arrays(np.float64, (2, 6), elements=FINITE))
def test_the_largest_difference_is_numpys(pair):
    assert largest_difference(*pair) == np.abs(pair[0] - pair[1]).max()


@given(arrays(np.float64, (7, 3), elements=FINITE))
def test_lengths_are_numpys_norms(vectors):
    expected = np.linalg.norm(vectors, axis=1)
    np.testing.assert_allclose(lengths(vectors), expected, rtol=1e-12, atol=1e-150)
