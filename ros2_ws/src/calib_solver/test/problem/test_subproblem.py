# SPDX-License-Identifier: Apache-2.0
"""Some spheres of a problem, taken apart and together again, are those they were."""

from __future__ import annotations

import numpy as np
from simulated_calibration import kr5, passive, simulate

from calib_solver.problem import Problem, take_groups


def test_groups_of_spheres_keep_their_poses_distances_and_placements():
    measured = simulate(kr5(), passive(), 70, locations=3, poses=4).measured
    problem = Problem.of(measured, {(2, 6): 1})
    first, second, third = problem.locations
    part = take_groups(problem, [third, second, third])
    assert part.keys[:, 0].tolist() == [1] * 4 + [2] * 4 + [3] * 4
    assert len(part.pairs) == 6 + 3 + 6
    np.testing.assert_array_equal(part.joints[:16], part.joints[-16:])
    np.testing.assert_array_equal(part.order[:16], problem.order[problem.start[8] :])
    for pairs, nominal in ((part.pairs, part.nominal), (problem.pairs, problem.nominal)):
        keys = part.keys if pairs is part.pairs else problem.keys
        expected = [measured.gauge.distance(*keys[pair, 1]) for pair in pairs]
        np.testing.assert_allclose(nominal, expected, rtol=1e-15)
    whole = take_groups(problem, [first, second, third])
    for name in ('start', 'joints', 'cosine', 'sine', 'centers', 'placement', 'pairs'):
        np.testing.assert_array_equal(getattr(whole, name), getattr(problem, name))
