# SPDX-License-Identifier: Apache-2.0
"""How often a calibration is repeated, to see how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.errors import DataError

#: with fewer locations there is nothing to draw
FEWEST_LOCATIONS = 2
MOST_REPETITIONS = 100_000  # hours of work, and their deviations still fit in memory


@dataclass(frozen=True)
class Plan:
    """How many repetitions of each kind; run i of a `seed` is the same in every plan."""

    monte_carlo: int = 0
    bootstrap: int = 0
    seed: int = 0

    @property
    def empty(self) -> bool:
        """Whether there is nothing to repeat."""
        return not self.monte_carlo and not self.bootstrap


def refuse_repetitions(plan: Plan) -> None:
    """Raise where so many repetitions cannot be carried out.

    Raises:
        DataError: a count or the seed is negative, or a single repetition.
    """
    for name, count in (('monte-carlo', plan.monte_carlo), ('bootstrap', plan.bootstrap)):
        if count < 0 or count == 1 or count > MOST_REPETITIONS:
            raise DataError(
                f'{name} {count}: expected 0, or 2 or more repetitions, {MOST_REPETITIONS} at most'
            )
    if plan.seed < 0:
        raise DataError(f'seed {plan.seed}: expected zero or more')


def refuse_plan(plan: Plan, locations: int, source: str) -> None:
    """Raise where a plan cannot be carried out on so many locations of a measurement `source`.

    Raises:
        DataError: a count or the seed is negative or a single repetition, or there are too few
            locations to draw from.
    """
    refuse_repetitions(plan)
    if plan.bootstrap and locations < FEWEST_LOCATIONS:
        raise DataError(
            f'{source}: a bootstrap draws whole gauge locations, '
            f'and there is {locations}: expected {FEWEST_LOCATIONS} or more'
        )
