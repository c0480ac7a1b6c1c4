# SPDX-License-Identifier: Apache-2.0
"""How far the simulated world may be from what the descriptions say."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

from calib_model.files import Fields, load_mapping
from selfcenter_probe.sensing import PsdDesign


@dataclass(frozen=True)
class ArmMagnitudes:
    """Standard deviations of the D-H parameters (m, rad) and of what the encoders do not see.

    `repeatability` (rad, per joint) is redrawn over `travel` (rad) of the joint. `eccentricity`
    and `ovality` (rad) are errors of the encoders once and twice per turn. `compliance`
    (rad/(N m)) is how far each joint bends, for hand-guided arms, behind its encoder.
    """

    length: float = 0.0
    angle: float = 0.0
    beta: float = 0.0
    repeatability: float = 0.0
    travel: float = 0.05
    eccentricity: float = 0.0
    ovality: float = 0.0
    compliance: float = 0.0


@dataclass(frozen=True)
class ProbeMagnitudes:
    """Standard deviations per coordinate of P (m, rad); `seat_reach` (m) of a passive probe."""

    translation: float = 0.0
    rotation: float = 0.0
    seat_reach: float = 2.0e-3


@dataclass(frozen=True)
class GaugeMagnitudes:
    """Standard deviations per coordinate of where the gauge stands (m, rad).

    `certificate` is a ratio: true errors of the certificate to its stated uncertainty.
    `give_level` and `give_vertical` (m/N) are how far a sphere yields to the hand's force, the
    latter on average over a bar: half as much at its middle, twice at its ends.
    """

    translation: float = 0.0
    rotation: float = 0.0
    certificate: float = 0.0
    give_level: float = 0.0
    give_vertical: float = 0.0


@dataclass(frozen=True)
class HandMagnitudes:
    """The operator of a hand-guided arm: forces in N, the rest ratios.

    `seat_force` presses a passive seat on the sphere, `styli_force` is that of an active probe's
    springs; of either, the share `sideways` is left when both hands balance it level. Each hold of
    a sphere has a force of its own and changes it, `variation` says by how much. `weight` is
    what the counterbalance leaves of the arm's weight at the probe.
    """

    seat_force: float = 0.0
    styli_force: float = 0.0
    sideways: float = 1.0
    variation: float = 0.0
    weight: float = 0.0


@dataclass(frozen=True)
class Magnitudes:
    """Everything that makes one simulated world; all zero is the world of the descriptions."""

    seed: int = 1
    bound: float = 2.0
    arm: ArmMagnitudes = field(default_factory=ArmMagnitudes)
    probe: ProbeMagnitudes = field(default_factory=ProbeMagnitudes)
    gauge: GaugeMagnitudes = field(default_factory=GaugeMagnitudes)
    psd: PsdDesign = field(default_factory=PsdDesign)
    hand: HandMagnitudes = field(default_factory=HandMagnitudes)

    def without_noise(self) -> Magnitudes:
        """The same world measured perfectly: what a noise-free bag is made from."""
        return replace(
            self,
            arm=replace(self.arm, repeatability=0.0, eccentricity=0.0, ovality=0.0, compliance=0.0),
            gauge=replace(self.gauge, certificate=0.0, give_level=0.0, give_vertical=0.0),
            psd=self.psd.perfect(),
        )


def parse_magnitudes(text: str, source: str = 'world') -> Magnitudes:
    """Magnitudes from YAML text; what is left out is zero (`psd`: a perfect one).

    Raises:
        DescriptionError: a key is misspelt or has a value of the wrong kind.
    """
    keys = ('seed', 'noise', 'bound', 'arm', 'probe', 'gauge', 'psd', 'hand')
    top = load_mapping(text, source, keys)
    noise = top.text('noise', 'full')
    if noise not in ('full', 'none'):
        raise top.refuse('noise', f"expected 'full' or 'none', got {noise!r}")
    bound = top.number('bound', Magnitudes.bound)
    if bound < 1:
        raise top.refuse('bound', 'expected at least 1 standard deviation')
    world = Magnitudes(
        _whole(top, 'seed', Magnitudes.seed, 2**63 - 1),
        bound,
        ArmMagnitudes(**_section(top, 'arm', ArmMagnitudes)),
        ProbeMagnitudes(**_section(top, 'probe', ProbeMagnitudes)),
        GaugeMagnitudes(**_section(top, 'gauge', GaugeMagnitudes)),
        _psd(top),
        HandMagnitudes(**_section(top, 'hand', HandMagnitudes)),
    )
    if not world.arm.travel > 0:
        raise top.refuse('arm.travel', 'expected an angle above zero')
    return world if noise == 'full' else world.without_noise()


def _psd(top: Fields) -> PsdDesign:
    design = PsdDesign(**_section(top, 'psd', PsdDesign))
    for key in ('length', 'photocurrent', 'adc_range'):
        if not getattr(design, key) > 0:
            raise top.refuse(f'psd.{key}', 'expected a number above zero')
    bits = design.adc_bits
    if bits != int(bits) or bits > 32:
        raise top.refuse('psd.adc_bits', 'expected a whole number from 0 to 32')
    return replace(design, adc_bits=int(bits))


def _section(top: Fields, name: str, kind: Any) -> dict[str, Any]:
    """The numbers of one section, none of them negative."""
    if name not in top:
        return {}
    keys = tuple(entry.name for entry in fields(kind))
    section = top.mapping(name, keys)
    values = {key: section.number(key) for key in keys if key in section}
    for key, value in values.items():
        if value < 0:
            raise section.refuse(key, f'expected no negative number, got {value}')
    return values


def _whole(top: Fields, key: str, default: int, largest: int) -> int:
    number = top.number(key, default)
    if number != int(number) or not 0 <= number <= largest:
        raise top.refuse(key, f'expected a whole number from 0 to {largest}')
    return int(number)
