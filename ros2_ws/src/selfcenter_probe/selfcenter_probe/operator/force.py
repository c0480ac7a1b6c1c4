# SPDX-License-Identifier: Apache-2.0
"""What the operator's hand does to gauge and arm: nothing that is pressed stays where it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import PassiveProbe, Probe
from selfcenter_probe.simulation import Magnitudes


@dataclass(frozen=True)
class HandForce:
    """Forces of the hand that guides a probe, and how gauge and arm give way to them."""

    magnitudes: Magnitudes
    force: float

    @classmethod
    def on(cls, probe: Probe, magnitudes: Magnitudes) -> HandForce:
        """The hand on a seat, which it presses home, or on styli that only their springs press."""
        hand = magnitudes.hand
        passive = isinstance(probe, PassiveProbe)
        return cls(magnitudes, hand.seat_force if passive else hand.styli_force)

    def on_gauge(self, direction: Array, effort: Array) -> Array:
        """The force (N, 3) on spheres in the base frame, N.

        `direction` (N, 3) is the unit vector along which the hand pushes, `effort` (N,) how hard
        as a ratio. Sideways the other hand steadies the gauge and little of it is left; nothing
        holds against a push down.
        """
        left = np.array([self.magnitudes.hand.sideways] * 2 + [1.0])
        force: Array = self.force * effort[:, None] * direction * left
        return force

    def displacement(self, force: Array, overhang: float) -> Array:
        """How far a sphere yields (N, 3) to forces (N, 3), m; `overhang` as from below."""
        gauge = self.magnitudes.gauge
        moved: Array = force * [gauge.give_level, gauge.give_level, gauge.give_vertical * overhang]
        return moved

    def bending(self, force: Array, effort: Array, jacobian: Array) -> Array:
        """How far the joints bend (N, n) behind their encoders, rad.

        The gauge pushes back on the probe with `force` (N, 3); what neither the counterbalance
        nor, by turns, the hand carries pulls it down, in the ratio of `effort` (N,). `jacobian`
        (N, 3, n), m/rad, tells what each joint feels of it.
        """
        load = -force
        load[:, 2] -= self.magnitudes.hand.weight * effort
        torque = np.einsum('nki,nk->ni', jacobian, load)
        bent: Array = self.magnitudes.arm.compliance * torque
        return bent


def overhang(p_base_sphere: Array, p_base_spheres: Array) -> float:
    """How much more than a sphere on average the one at `p_base_sphere` (3,) of a bar yields.

    The bar rests near its middle: a half there, twice as much at its ends, 1 on average over
    its length; `p_base_spheres` (S, 3) are all that it has, m.
    """
    middle = p_base_spheres.mean(axis=0)
    half = np.linalg.norm(p_base_spheres - middle, axis=1).max()
    if half < 1e-6:
        return 1.0
    out = np.linalg.norm(p_base_sphere - middle) / half
    return float(0.5 + 1.5 * out**2)
