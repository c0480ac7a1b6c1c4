# SPDX-License-Identifier: Apache-2.0
"""LED and position-sensitive detector (PSD): displacements by way of two photocurrents each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.instruments import Normal

ELEMENTARY_CHARGE = 1.602176634e-19  # C
#: waves of the linearity error along the strip; shorter ones are smeared out by the light spot
WAVES = np.arange(1, 5)


@dataclass(frozen=True)
class PsdDesign:
    """What every stylus's LED and PSD have in common.

    `length` (m) of the strip, `photocurrent` (A) of both electrodes together and its relative
    `led_spread` between styli, `bandwidth` (Hz), `amplifier_noise` (A rms) per electrode,
    `linearity_error` (m rms), `adc_bits` (0: none) over `adc_range` (A) per electrode, and
    `weak_signal` (A), the total current under which a position is not believed.
    """

    length: float = 0.012
    photocurrent: float = 1.0e-6
    led_spread: float = 0.0
    bandwidth: float = 0.0
    amplifier_noise: float = 0.0
    linearity_error: float = 0.0
    adc_bits: int = 0
    adc_range: float = 2.0e-6
    weak_signal: float = 0.0

    def perfect(self) -> PsdDesign:
        """The same strip without noise, linearity error or quantisation."""
        return PsdDesign(self.length, self.photocurrent, weak_signal=self.weak_signal)


@dataclass(frozen=True)
class Psds:
    """The PSDs of S styli as they really are.

    `photocurrent` (S,) in A; the linearity error of stylus s at x is the sum over w of
    amplitude[s, w] sin(2 pi WAVES[w] x / length + phase[s, w]), both (S, W), m and rad.
    """

    design: PsdDesign
    photocurrent: Array
    amplitude: Array
    phase: Array

    @classmethod
    def drawn(cls, design: PsdDesign, generator: np.random.Generator, styli: int = 3) -> Psds:
        """PSDs as they come out of the box."""
        spread = np.clip(generator.standard_normal(styli), -2, 2) * design.led_spread
        shape = generator.standard_normal((styli, len(WAVES))) / WAVES
        rms = np.sqrt(np.sum(shape**2, axis=1, keepdims=True) / 2)
        phase = generator.uniform(0, 2 * np.pi, shape.shape)
        return cls(
            design,
            frozen(design.photocurrent * np.maximum(1 + spread, 0)),
            frozen(design.linearity_error * shape / rms),
            frozen(phase),
        )

    def read(self, displacement: Array, generator: Normal) -> tuple[Array, NDArray[np.bool_]]:
        """What the firmware makes of true displacements (N, S), m, and where the signal is weak."""
        return decode(self.design, self.photocurrents(displacement, generator))

    def linearity_error(self, displacement: Array) -> Array:
        """How far the light's centroid seems off at displacements (N, S), m."""
        if not self.amplitude.any():
            return np.zeros_like(displacement)
        turns = (2 * np.pi / self.design.length) * displacement[..., None] * WAVES
        error: Array = np.einsum('nsw,sw->ns', np.sin(turns + self.phase), self.amplitude)
        return error

    def photocurrents(self, displacement: Array, generator: Normal) -> Array:
        """The digitised currents (N, S, 2) of both electrodes, A, at displacements (N, S), m."""
        design = self.design
        half = design.length / 2
        x = np.clip(displacement + self.linearity_error(displacement), -half, half)
        share = x / design.length
        currents = np.stack([0.5 - share, 0.5 + share], axis=-1) * self.photocurrent[:, None]
        shot = 2 * ELEMENTARY_CHARGE * design.bandwidth * currents
        noise = np.sqrt(shot + design.amplifier_noise**2)
        if noise.any():
            currents = currents + noise * generator.standard_normal(currents.shape)
        return _digitised(design, currents)


def _digitised(design: PsdDesign, currents: Array) -> Array:
    if design.adc_bits == 0:
        return currents
    step = design.adc_range / 2**design.adc_bits
    counts: Array = np.clip(np.round(currents / step), 0, 2**design.adc_bits - 1)
    return counts * step


def decode(design: PsdDesign, currents: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Displacements (N, S), m, from currents (N, S, 2), A, and where they are not to be believed.

    x = L/2 (I2 - I1) / (I1 + I2). The firmware knows the strip's length and nothing of its
    errors. A converter at full scale hides the position as well as too little light does.
    """
    first, second = currents[..., 0], currents[..., 1]
    total = first + second
    lit = total > 0
    x = design.length / 2 * (second - first) / np.where(lit, total, 1.0)
    weak = ~lit | (total < design.weak_signal)
    if design.adc_bits:
        full = design.adc_range * (1 - 2.0**-design.adc_bits)
        weak |= (currents >= full).any(axis=-1)
    return np.clip(x, -design.length / 2, design.length / 2), weak
