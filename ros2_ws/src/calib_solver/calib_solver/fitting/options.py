# SPDX-License-Identifier: Apache-2.0
"""What a user can choose of an identification."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.kinematics import Links
from calib_solver.fitting.prior import DEFAULT_PRIOR, Prior

LOSSES = ('rejecting', 'plain')
#: the objective that looks at distances and poses alike
LEADING = 'distance_repeatability'
#: in place of kinds of joint errors: all those for which enough is known of the arm
AUTO = 'auto'


@dataclass(frozen=True)
class Options:
    """What a user can choose: the objective, parameters to fix or free by pattern, the prior, and
    the loss: `rejecting` leaves gross errors out, `plain` keeps every pose.

    `correction` of eq. 12 is `off`, `auto` (only if locations left out get better by it) or
    `harmonic` (all the same). `joint_errors` are kinds offered to be identified, of which
    compliance needs the weights of the `links`; AUTO offers those that can be. `quick` leaves out
    joint errors, the search for mix-ups, and the judging by what is left out.
    """

    objective: str = 'distance_repeatability'
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    prior: Prior = DEFAULT_PRIOR
    loss: str = 'rejecting'
    correction: str = 'off'
    joint_errors: tuple[str, ...] = (AUTO,)
    links: Links | None = None
    quick: bool = False
