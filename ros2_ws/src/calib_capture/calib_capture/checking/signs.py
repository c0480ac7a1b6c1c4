# SPDX-License-Identifier: Apache-2.0
"""Signs and order of styli, signs of joints, the mounting: told by a sphere that stands still."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from calib_capture.checking.finding import DOUBTFUL, OK, WRONG, Finding
from calib_capture.checking.hypotheses import (
    AS_DESCRIBED,
    Contact,
    Explained,
    explained,
    of_joints,
    of_mounting,
    of_styli,
)
from calib_model.instruments import ActiveProbe, Arm, Gauge

SIGNS = 'signs of joints and styli, mounting'
FITS = 9.0  # cost per row up to which the sphere stands still: 3 times the noise
CLEARLY = 20.0  # times less cost, by which one hypothesis is better than another
TOLD = 30.0  # more cost of the other sign, from which on a sign shows
THIN = 2  # of the readings that many pairs of hypotheses are tried on
LATE, SURELY = 0.004, 4.0  # s between clocks that is said, and of how many of its uncertainties
TILTED = 0.08  # rad that a probe may be turned on the flange: descriptions are good to 0.02
MOST_NAMED = 4


@dataclass(frozen=True)
class Told:
    """`found` explains the readings, None where nothing does; `plain` is all as described.
    `unsure` are names of hypotheses that explain them as well."""

    plain: Explained
    found: Explained | None
    unsure: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether all is as described."""
        return self.found is not None and self.found.hypothesis == AS_DESCRIBED

    @property
    def names(self) -> str:
        """What explains the readings, in words."""
        found = () if self.found is None else (self.found.hypothesis.name,)
        return ', or '.join((*found, *self.unsure)[:MOST_NAMED])


def fits(plain: Explained) -> bool:
    """Whether a sphere stands still by a hypothesis."""
    return plain.cost <= FITS * plain.rows


def told_by(arm: Arm, probe: ActiveProbe, gauge: Gauge, contact: Contact) -> Told:
    """What readings of spheres in motion tell of how everything is counted."""
    plain = explained(arm, probe, gauge, contact, AS_DESCRIBED)
    others = [
        explained(arm, probe, gauge, contact, each)
        for each in (*of_joints(arm), *of_mounting(), *of_styli())
    ]
    best = min(others, key=lambda each: each.cost)
    if fits(plain) and best.cost * CLEARLY > plain.cost:
        return Told(plain, plain, _as_good(plain, others))
    if _explains(best, plain):
        return Told(plain, best, _as_good(best, others))
    best = min(_pairs(arm, probe, gauge, contact), key=lambda each: each.cost)
    return Told(plain, best if _explains(best, plain) else None)


def _pairs(arm: Arm, probe: ActiveProbe, gauge: Gauge, contact: Contact) -> list[Explained]:
    """Something of the styli and something else, both; a few readings are enough for that."""
    few = contact.thinned(THIN)
    likely = [each for each in (*of_joints(arm), *of_mounting()) if each.likely]
    pairs = product(of_styli(), likely)
    return [explained(arm, probe, gauge, few, one.and_also(other)) for one, other in pairs]


def _explains(best: Explained, plain: Explained) -> bool:
    """By the cost of a row: pairs are tried on fewer."""
    better = best.cost / best.rows * CLEARLY < plain.cost / plain.rows
    return better and best.cost <= 4 * FITS * best.rows


def _as_good(found: Explained, others: list[Explained]) -> tuple[str, ...]:
    """Names of hypotheses that cost hardly more."""
    most = found.cost + max(TOLD, found.cost / 2)
    return tuple(
        each.hypothesis.name
        for each in others
        if each.cost < most and each.hypothesis != found.hypothesis
    )


def sign_findings(told: Told) -> list[Finding]:
    """The lines for signs, mounting and clocks."""
    plain, found = told.plain, told.found
    moves = f'as described the sphere moves by {plain.rms * 1e3:.3f} mm'
    if found is None:
        advice = (
            'no sign, order or turn explains it: see whether arm, probe and gauge are those '
            'described, and whether all is rigid'
        )
        return [Finding(SIGNS, WRONG, moves, advice), *_clock(plain)]
    still = f'the sphere stands still to {found.rms * 1e3:.3f} mm'
    if told.ok:
        findings = [Finding(SIGNS, OK, f'{still}, {found.readings} readings in motion')]
        if told.unsure:
            seen = f'these motions tell nothing of {told.names.removeprefix("as described, or ")}'
            advice = 'put the sphere off the middle of the probe, or try another posture'
            findings.append(Finding('signs that do not show', DOUBTFUL, seen, advice))
    else:
        advice = 'mend the driver or the description'
        findings = [Finding(SIGNS, WRONG, f'{told.names}: then {still}, {moves}', advice)]
    if found.turned > TILTED:
        seen = (
            f'the probe seems to be turned on the flange by some {np.degrees(found.turned):.0f} deg'
        )
        findings.append(
            Finding('mounting', DOUBTFUL, seen, 'see flange_T_probe of its description')
        )
    return findings + _clock(found)


def _clock(found: Explained) -> list[Finding]:
    what, late, sure = 'clocks of joints and probe', found.late, found.late_uncertainty
    if sure > LATE:
        return []
    seen = f'readings are stamped {abs(late) * 1e3:.1f} ms too {"early" if late > 0 else "late"}'
    seen += f', +-{sure * 1e3:.1f} ms'
    if abs(late) > max(LATE, SURELY * sure):
        return [Finding(what, WRONG, seen, 'stamp both on one clock, when they were measured')]
    return [Finding(what, OK, seen)]
