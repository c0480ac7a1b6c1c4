# SPDX-License-Identifier: Apache-2.0
"""No pass over the poses is made twice, and a quick identification takes as many as a fit."""

from __future__ import annotations

from collections import Counter

import pytest
from simulated_calibration import active, kr5, passive, simulate

from calib_model.kinematics import identifiable_table
from calib_solver.fitting import NO_PRIOR, Options, Solver, try_probe_fit
from calib_solver.identification import identify
from calib_solver.problem import Problem, accumulate

pytestmark = pytest.mark.timeout(60)


class Counted:
    """Passes, counted by problem and parameters."""

    def __init__(self):
        self.made, self.problems = Counter(), []

    def __call__(self, problem, table, full):
        self.problems.append(problem)  # so that no other takes its id
        self.made[id(problem), full.tobytes()] += 1
        return accumulate(problem, table, full)


@pytest.mark.parametrize('probe', [active, passive])
def test_a_quick_identification_passes_over_the_poses_as_often_as_one_solution(probe):
    measured = simulate(kr5(), probe(), seed=5, noise=1e-5).measured
    table = identifiable_table(measured.arm, measured.probe)
    alone, counted = Counted(), Counted()
    problem = Problem.of(measured)
    solver = Solver(table, Options(prior=NO_PRIOR), alone)
    solver.solve(problem, solver.start(problem, try_probe_fit(problem)))
    done = identify(measured, Options(quick=True), counted)
    assert done.fit.converged
    assert max(counted.made.values()) == 1
    assert counted.made.total() <= alone.made.total() + 2


def test_a_solution_that_is_gone_on_from_is_not_sought_again():
    measured = simulate(kr5(), active(), seed=6, noise=1e-5).measured
    counted, problem = Counted(), Problem.of(measured)
    solver = Solver(identifiable_table(measured.arm, measured.probe), Options(), counted)
    fit, descent = solver.solve(problem, solver.start(problem, None))
    before = counted.made.total()
    again, there = solver.solve(problem, descent)
    assert counted.made.total() == before
    assert again is fit
    assert there is descent
