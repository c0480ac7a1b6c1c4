# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say in words."""

from calib_solver.results.diagnostics import prior_words


def test_widths_are_told_in_two_digits_as_people_write_them():
    widths = [{'kind': 'theta_0', 'times': 1234.5}, {'kind': 'a', 'times': 0.5274}]
    said = prior_words({'strength': 1.0, 'widths': widths})
    assert 'zeros 1200, lengths a 0.53' in said and "this arm's zeros are 1200 times" in said
