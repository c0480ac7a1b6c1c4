# SPDX-License-Identifier: Apache-2.0
"""One table of parameters, one prior and one objective of the sums per sphere, for as many problems
as it takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import RankError
from calib_model.instruments import Arm, PassiveProbe, Probe
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.evidence import FEW
from calib_solver.fitting.levenberg_marquardt import Evaluate, Fit
from calib_solver.fitting.minimiser import Descent, Minimiser
from calib_solver.fitting.objectives import Objective, Quadratic, objective, position
from calib_solver.fitting.options import LEADING
from calib_solver.fitting.pose_noise import independent_distances, pose_variance
from calib_solver.fitting.probe_mount import ProbeFit, fit_probe
from calib_solver.problem import Problem, SphereSums

#: sums that are kept of those asked for last, as fits begin where others ended; and as many at the
#: nominal parameters, to which each fit is compared at its end
KEPT = 4
#: one pass over the poses, as `sphere_sums.accumulate` does it here, or others on other machines
Accumulate = Callable[[Problem, ParameterTable, Array], SphereSums]


@dataclass(frozen=True)
class Solver(Minimiser[Problem]):
    """What is minimised over which parameters: a table, an objective with its prior, and how the
    poses are passed over. Where a solution has come to is a `Descent`: what a solver remembers, its
    latest sums and its last solution, saves doing them again and changes no result."""

    passes: Accumulate
    follows: bool = False  # the widths of the prior are those that another objective found

    @property
    def followed(self) -> bool:
        """Whether the widths of the prior are those that another objective found."""
        return self.follows

    @property
    def needed(self) -> str:
        """What the objective takes at least, in words."""
        return 'it needs two spheres in one location or several poses of one sphere'

    @cached_property
    def objective(self) -> Objective:
        """The objective of the options."""
        return objective(self.options.objective)

    def sums(self, problem: Problem, x: Array) -> SphereSums:
        """The sums at offsets x; the latest few are kept, and those at the nominal parameters."""
        key = (id(problem), x.tobytes())
        found = self._latest.pop(key, None)
        if found is None:
            alike = [each for each in self._latest if any(each[1]) == any(key[1])]
            if len(alike) >= KEPT:
                del self._latest[alike[0]]
            found = problem, self.passes(problem, self.table, self.full(x))
        self._latest[key] = found
        return found[1]

    @cached_property
    def _latest(self) -> dict[tuple[int, bytes], tuple[Problem, SphereSums]]:
        """Sums by problem and offsets; the problem is kept so that no other takes its id."""
        return {}

    def value(self, problem: Problem, x: Array) -> Quadratic:
        """The objective at offsets x."""
        return self.objective(problem, self.sums(problem, x))

    def guide(self, problem: Problem) -> Evaluate | None:
        """Eq. 10 of few poses, which knows three spheres of a place by more than their distances;
        of many in a line most distances only say again what the others do."""
        scatter, few = 3 * (len(problem.joints) - len(problem.keys)), FEW * len(self.nominal)
        if self.options.objective != LEADING or scatter >= few:
            return None
        most = max(map(len, problem.placements), default=0)
        if most < 3 or scatter + independent_distances(problem) >= few:
            return None
        return lambda x: position(problem, self.sums(problem, x))

    def solve(self, problem: Problem, descent: Descent) -> tuple[Fit, Descent]:
        """The minimum, from where the descent has come to: there, if this solver led it there."""
        for solved, fit, there in self._last:
            if solved is problem and there is descent:
                return fit, descent
        fit, there = super().solve(problem, descent)
        self._last[:] = [(problem, fit, there)]
        return fit, there

    @cached_property
    def _last(self) -> list[tuple[Problem, Fit, Descent]]:
        """The last solution, if there is one."""
        return []

    def start(self, problem: Problem, mount: ProbeFit | None) -> Descent:
        """The nominal parameters, with the mount of eq. 15 where that fits better."""
        nominal: Array = np.zeros(len(self.nominal))
        if mount is None:
            return Descent(nominal)
        full = self.table.nominal.copy()
        at = mount.flange_T_probe
        full[self.table.mount] = [*at.translation, *at.rotation_vector]
        fitted = self.offsets(full)
        better = self.value(problem, fitted).phi < self.value(problem, nominal).phi
        return Descent(fitted if better else nominal)

    def arm_and_probe(self, problem: Problem, descent: Descent) -> tuple[Arm, Probe]:
        """The arm and probe that a descent has come to."""
        return self.table.apply(self.full(descent.x), problem.measured.arm, problem.measured.probe)

    def behind(self, leader: Solver, problem: Problem, descent: Descent) -> tuple[Solver, Descent]:
        """A start at another objective's minimum; eq. 13 takes the widths and the poses' noise from
        there.

        Distances alone are often fewer than the parameters: fitted to nothing, they would say
        that there is no noise, and the prior would lose all its weight.
        """
        _, led = leader.solve(problem, descent)
        start = replace(led, history=())
        if self.options.objective != 'distance':
            return self, replace(start, times=None)
        following = replace(self.with_widths(led), follows=True)
        if not len(problem.pairs):
            return following, start
        sums = self.sums(problem, start.x)
        each = (1 / np.maximum(sums.count, 1))[problem.pairs].sum(axis=1)
        noise = pose_variance(sums) * float(each.mean())
        return following, replace(start, least_noise=noise)


def try_probe_fit(problem: Problem) -> ProbeFit | None:
    """Eq. 15 as a start for P; None where the probe is passive or its readings cannot tell it: the
    fit then starts from the nominal mount, which is no fault of its result."""
    if isinstance(problem.measured.probe, PassiveProbe):
        return None
    try:
        return fit_probe(problem)
    except RankError:
        return None
