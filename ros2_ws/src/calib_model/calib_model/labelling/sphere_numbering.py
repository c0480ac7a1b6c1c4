# SPDX-License-Identifier: Apache-2.0
"""The certificate's numbers of spheres that were seen: by their distances, else by their order.

On an even bar a set of spheres stands as another does, a step along or end for end, but for the
micrometres that its certificate tells. An arm that is not calibrated sees no micrometres: it gets
the numbers in the order of probing. The identified arm may see them: `renumbered` asks it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib_model.arrays import Array
from calib_model.labelling.certificate_match import Certificate, Match
from calib_model.labelling.sphere_clusters import SeenLocation

AS_GOOD = 0.001  # m: matches worse by less than this are as good to an arm not yet calibrated
CLEARLY = 9.0  # squares of standard uncertainties between the best numbers and the next
SHOWN = 3  # alternatives that are named

Scheme = frozenset[int]


@dataclass(frozen=True)
class Told:
    """What the identified arm says of the numbers: `rms` (m) by which certified distances differ
    from seen ones, of those chosen and of the next best, and whether that is clear."""

    rms: float
    next_best: Scheme
    next_rms: float
    clear: bool


@dataclass(frozen=True)
class Numbering:
    """A match for each location; `options` are those that its distances leave, all as good.

    `schemes` are the sets of numbers they share, the one chosen first; `unsure` counts locations
    that could be numbered in another way within it, as from the other end.
    """

    options: tuple[tuple[Match, ...], ...]
    chosen: tuple[Match, ...]
    schemes: tuple[Scheme, ...]
    unsure: int
    told: Told | None = None

    @property
    def open(self) -> bool:
        """Whether distances alone leave more than one numbering."""
        return any(len(options) > 1 for options in self.options)

    @property
    def numbers(self) -> tuple[tuple[int, ...], ...]:
        """The numbers of each location's places."""
        return tuple(match.numbers for match in self.chosen)

    @property
    def assumed(self) -> bool:
        """Whether the order of probing had to decide."""
        several = len(self.schemes) > 1 and not (self.told is not None and self.told.clear)
        return several or self.unsure > 0

    def line(self) -> str:
        """How the spheres got their numbers, in words."""
        here = _listed({number for match in self.chosen for number in match.numbers})
        text = f'spheres {here}, by their distances'
        if len(self.schemes) > 1 and self.told is not None and self.told.clear:
            text = (
                f'spheres {here}, by the identified distances: they differ from the certificate '
                f'by {self.told.rms * 1e6:.1f} um rms, as {_listed(self.told.next_best)} by '
                f'{self.told.next_rms * 1e6:.1f} um'
            )
        elif len(self.schemes) > 1:
            instead = ' or '.join(map(_listed, self.schemes[1 : 1 + SHOWN]))
            text = (
                f'spheres taken to be {here}, not {instead}, which their distances do not tell: '
                'say with --spheres which were probed'
            )
        if self.unsure:
            text += f'; at {self.unsure} locations counted upwards in the order of probing'
        return text


def numbered(locations: Sequence[SeenLocation], certificate: Certificate, near: float) -> Numbering:
    """The numbers that all locations share as far as they can, first probed first."""
    options = []
    for location in locations:
        matches = certificate.matches(location.centers, near)
        as_good = [match for match in matches if match.off <= matches[0].off + AS_GOOD]
        options.append(_distinct(as_good, certificate))
    most = max(len(location.places) for location in locations)
    widest = [
        each for each, seen in zip(options, locations, strict=True) if len(seen.places) == most
    ]
    schemes = {frozenset(match.numbers) for matches in widest for match in matches}

    def effort(scheme: Scheme) -> tuple[int, int, tuple[int, ...]]:
        best = [min(_effort(match, scheme) for match in matches) for matches in options]
        return sum(one[0] for one in best), sum(one[1] for one in best), tuple(sorted(scheme))

    ranked = sorted(schemes, key=effort)
    fewest = effort(ranked[0])[0]
    ranked = [scheme for scheme in ranked if effort(scheme)[0] == fewest]
    within = [_within(matches, ranked[0]) for matches in options]
    chosen = tuple(min(matches, key=lambda match: _effort(match, ranked[0])) for matches in within)
    unsure = sum(len(matches) > 1 for matches in within)
    return Numbering(tuple(options), chosen, tuple(ranked), unsure)


def _distinct(matches: Sequence[Match], certificate: Certificate) -> tuple[Match, ...]:
    """Without those that ask for the very same distances as another of the same spheres does: of
    two sockets nobody can tell, nor has to, which is which. Those that count upwards stay."""
    kept: dict[tuple[Scheme, tuple[float, ...]], Match] = {}
    for match in sorted(matches, key=lambda match: _effort(match, frozenset())):
        pairs = combinations(match.numbers, 2)
        asked = tuple(certificate.gauge.distance(one, other) for one, other in pairs)
        kept.setdefault((frozenset(match.numbers), asked), match)
    return tuple(match for match in matches if match in kept.values())


def renumbered(
    numbering: Numbering,
    certificate: Certificate,
    seen: Sequence[Array],
    variance: Sequence[Array],
) -> Numbering:
    """The numbers that an identified arm's distances tell, where they tell them clearly.

    `seen` (k, 3) are each location's centres in the order of its match, m, with NaN where nothing
    is known, `variance` (k,) the squares of their standard uncertainties, m^2.
    """
    misfit = [
        {match: _misfit(match, certificate, centers, spread) for match in matches}
        for matches, centers, spread in zip(numbering.options, seen, variance, strict=True)
    ]

    def total(scheme: Scheme) -> float:
        return sum(min(one[m] for m in _within(tuple(one), scheme)) for one in misfit)

    ranked = sorted(numbering.schemes, key=total)
    count = sum(len(centers) * (len(centers) - 1) // 2 for centers in seen)
    # errors that the variances do not know of make every misfit larger: the best one says how much
    scale = max(total(ranked[0]) / count, 1.0)
    apart = [(total(scheme) - total(ranked[0])) / scale for scheme in ranked]
    clear = len(ranked) > 1 and apart[1] > CLEARLY
    if not clear:
        ranked = list(numbering.schemes)
    chosen, unsure = [], 0
    for one in misfit:
        matches = sorted(_within(tuple(one), ranked[0]), key=lambda match: one[match])
        usual = min(matches, key=lambda match: _effort(match, ranked[0]))
        sure = len(matches) < 2 or (one[matches[1]] - one[matches[0]]) / scale > CLEARLY
        chosen.append(matches[0] if sure else usual)
        unsure += not sure
    told = None
    if len(ranked) > 1:
        others = [min(_within(tuple(one), ranked[1]), key=lambda m: one[m]) for one in misfit]
        rms, next_rms = (_rms(matches, certificate, seen) for matches in (chosen, others))
        told = Told(rms, ranked[1], next_rms, clear)
    return replace(numbering, chosen=tuple(chosen), schemes=tuple(ranked), unsure=unsure, told=told)


def _within(matches: tuple[Match, ...], scheme: Scheme) -> tuple[Match, ...]:
    """Those with the fewest numbers that are not in the scheme."""
    fewest = min(_effort(match, scheme)[0] for match in matches)
    return tuple(match for match in matches if _effort(match, scheme)[0] == fewest)


def _effort(match: Match, scheme: Scheme) -> tuple[int, int]:
    """Numbers not in the scheme, and how far from counting upwards they were probed."""
    upwards = int(np.sign(np.diff(match.numbers)).sum())
    return len(set(match.numbers) - scheme), -upwards


def _misfit(match: Match, certificate: Certificate, centers: Array, variance: Array) -> float:
    """Squares of the distances' errors, each by its variance."""
    total = 0.0
    for i, j in combinations(range(len(match.numbers)), 2):
        certified = certificate.gauge.distance(match.numbers[i], match.numbers[j])
        error = float(np.linalg.norm(centers[i] - centers[j])) - certified
        known = certificate.gauge.distance_uncertainty(certified) / 2
        spread = known**2 + float(variance[i] + variance[j])
        if np.isfinite(error) and spread > 0:
            total += error**2 / spread
    return total


def _rms(matches: Sequence[Match], certificate: Certificate, seen: Sequence[Array]) -> float:
    errors = [
        float(np.linalg.norm(centers[i] - centers[j]))
        - certificate.gauge.distance(match.numbers[i], match.numbers[j])
        for match, centers in zip(matches, seen, strict=True)
        for i, j in combinations(range(len(match.numbers)), 2)
    ]
    known = np.array([error for error in errors if np.isfinite(error)])
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def _listed(numbers: Sequence[int] | Scheme | set[int]) -> str:
    return ' '.join(map(str, sorted(numbers)))
