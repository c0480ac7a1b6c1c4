# SPDX-License-Identifier: Apache-2.0
"""What is known of the parameters before any probing: a Gaussian about the nominal values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import read_description
from calib_model.errors import DescriptionError
from calib_model.files import load_mapping
from calib_model.kinematics import DEFAULT_SIGMA, ParameterTable

#: what a real arm's model leaves unsaid is alike in neighbouring postures, so this many poses
#: tell as much as one with an error of its own would
DEFAULT_STRENGTH = 2.0

#: beyond these the arithmetic has no digits left: --fix and none say it better
LEAST_STRENGTH, MOST_STRENGTH = 1e-12, 1e12
LEAST_SIGMA, MOST_SIGMA = 1e-9, 1e3  # m or rad
STRENGTHS = f'expected zero or more: 0, or from {LEAST_STRENGTH:g} to {MOST_STRENGTH:g}'


@dataclass(frozen=True)
class Prior:
    """Standard deviations by kind of parameter (m or rad), as they usually are.

    `strength` multiplies the prior's weight against the residuals' mean square; 0 is no prior.
    With `evidence` the data say how wide each kind is: `times` what is usual, once they have.
    """

    sigma: Mapping[str, float]
    strength: float = DEFAULT_STRENGTH
    evidence: bool = False
    times: Mapping[str, float] = field(default_factory=dict)

    def sigmas(self, table: ParameterTable) -> Array:
        """The usual standard deviation of every free parameter, shape (F,)."""
        return np.array([self.sigma[parameter.kind] for parameter in table.free])

    def widths(self, table: ParameterTable) -> Array:
        """The standard deviation that every free parameter is held with, shape (F,)."""
        times = np.array([self.times.get(parameter.kind, 1.0) for parameter in table.free])
        widths: Array = times * self.sigmas(table)
        return widths

    def information(self, table: ParameterTable) -> Array:
        """strength / width^2 of every free parameter, shape (F,)."""
        information: Array = self.strength / self.widths(table) ** 2
        return information


#: as wide as the evidence says: nothing better is known of an arm that is not known
DEFAULT_PRIOR = Prior(DEFAULT_SIGMA, 1.0, evidence=True)
#: as wide as is usual
USUAL_PRIOR = Prior(DEFAULT_SIGMA)
NO_PRIOR = Prior(DEFAULT_SIGMA, 0.0)


def usable_strength(strength: float) -> bool:
    """Whether a prior can be that strong."""
    return strength == 0 or LEAST_STRENGTH <= strength <= MOST_STRENGTH


def parse_prior(text: str, source: str = 'prior') -> Prior:
    """A prior from YAML text: `sigma: {a: 0.001, alpha: 0.002, ...}`, `strength: 2.0`.

    Kinds that are left out keep their default; with `strength: auto` the evidence scales
    them all.

    Raises:
        DescriptionError: an unknown kind, or a value that is no positive number.
    """
    top = load_mapping(text, source, ('sigma', 'strength'))
    sigma = dict(DEFAULT_SIGMA)
    if 'sigma' in top:
        given = top.mapping('sigma', tuple(DEFAULT_SIGMA))
        for kind in given.content:
            if kind not in DEFAULT_SIGMA:
                known = ', '.join(DEFAULT_SIGMA)
                raise DescriptionError(source, f'sigma.{kind}', f'unknown kind (known: {known})')
            sigma[kind] = given.number(kind)
            if not LEAST_SIGMA <= sigma[kind] <= MOST_SIGMA:
                span = f'{LEAST_SIGMA:g} to {MOST_SIGMA:g}'
                raise given.refuse(kind, f'expected a standard deviation above zero: {span}')
    if top.content.get('strength') == 'auto':
        return Prior(sigma, 1.0, evidence=True)
    strength = top.number('strength', DEFAULT_STRENGTH)
    if not usable_strength(strength):
        raise top.refuse('strength', STRENGTHS)
    return Prior(sigma, strength)


def chosen_prior(choice: str) -> Prior:
    """The prior of a command's option: '', 'default' or 'auto' (its widths follow the evidence),
    'none', a strength or a file.

    Raises:
        DescriptionError: a file that cannot be read or used.
    """
    if choice in ('', 'default', 'auto'):
        return DEFAULT_PRIOR
    if choice == 'none':
        return NO_PRIOR
    try:
        strength = float(choice)
    except ValueError:
        return read_description(Path(choice), parse_prior)
    if not usable_strength(strength):
        raise DescriptionError('prior', f'strength {choice}', STRENGTHS)
    return Prior(DEFAULT_SIGMA, strength)
