# SPDX-License-Identifier: Apache-2.0
"""Eq. 10 for measured points by the arm's parameters alone, targets and stations eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting import Minimiser, Quadratic
from calib_solver.points.places import Flange, Places, best_places, start_places
from calib_solver.points.point_sums import accumulate_points, eliminated
from calib_solver.points.problem import PointProblem


class PlacedQuadratic:
    """Eq. 10 of a problem by all columns of a table, `places` at their best for the last ones."""

    def __init__(self, problem: PointProblem, table: ParameterTable, places: Places) -> None:
        self.problem, self.table, self.places = problem, table, places

    def at(self, full: Array) -> Quadratic:
        """The objective of the free columns at `full` (C,)."""
        flange = Flange.of(self.problem, self.table, full)
        self.places = best_places(self.problem, flange, self.places)
        (sums,) = accumulate_points(self.problem, self.table, full, self.places, flange=flange)
        free = len(self.table.free_columns)
        return eliminated(sums.weighed(self.problem.turn_weight), free)[0]


@dataclass(frozen=True)
class PointSolver(Minimiser[PointProblem]):
    """Eq. 10 with targets and stations at their best for whatever parameters of the arm."""

    @property
    def needed(self) -> str:
        """What the objective takes at least, in words."""
        return 'it needs more points than targets and stations take up'

    @cached_property
    def _places(self) -> list[Places]:
        """Where targets and stations were last: the next best is near."""
        return []

    def begin_at(self, places: Places) -> None:
        """Look for targets and stations from there on."""
        self._places[:] = [places]

    def places(self, problem: PointProblem, x: Array) -> Places:
        """The best places at offsets x (F,)."""
        return self._best(problem, self.full(x), Flange.of(problem, self.table, self.full(x)))

    def _best(self, problem: PointProblem, full: Array, flange: Flange) -> Places:
        if not self._places:
            self.begin_at(start_places(problem, self.table, full))
        found = best_places(problem, flange, self._places[0])
        self.begin_at(found)
        return found

    def value(self, problem: PointProblem, x: Array) -> Quadratic:
        """Eq. 10 at offsets x (F,)."""
        full = self.full(x)
        flange = Flange.of(problem, self.table, full)
        places = self._best(problem, full, flange)
        (sums,) = accumulate_points(problem, self.table, full, places, flange=flange)
        return eliminated(sums.weighed(problem.turn_weight), len(x))[0]
