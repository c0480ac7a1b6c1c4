# SPDX-License-Identifier: Apache-2.0
"""The truth of a simulated measurement, known to the probe's simulator alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.instruments import (
    JOINT_PARAMETERS,
    STYLI,
    Arm,
    Gauge,
    Normal,
    PassiveProbe,
    Probe,
)
from calib_model.kinematics import LENGTHS, forward_kinematics
from calib_model.transforms import RigidTransform, rotation_matrix, rotation_vector
from selfcenter_probe.sensing import Contact, Psds, Status, seat, touch
from selfcenter_probe.simulation.encoders import Encoders, Repeatability
from selfcenter_probe.simulation.magnitudes import ArmMagnitudes, Magnitudes


@dataclass(frozen=True)
class Sighting:
    """The gauge sphere nearest to the probe: `location`, `sphere` (N,), `p_probe_sphere` (N, 3)."""

    location: NDArray[np.int64]
    sphere: NDArray[np.int64]
    p_probe_sphere: Array


@dataclass(frozen=True)
class World:
    """What is really there: arm, P in `probe`, and every sphere of every location.

    `p_base_sphere` (S, 3), m, in the true base frame, with its `location` and `sphere` (S,);
    `p_probe_middle` (3,), m, is where a sphere should be, all styli at zero or seated.
    """

    arm: Arm
    probe: Probe
    p_probe_middle: Array
    psds: Psds
    sphere_diameter: float
    location: NDArray[np.int64]
    sphere: NDArray[np.int64]
    p_base_sphere: Array
    magnitudes: Magnitudes
    encoders: Encoders

    @classmethod
    def drawn(
        cls,
        arm: Arm,
        probe: Probe,
        gauge: Gauge,
        placements: Mapping[int, RigidTransform],
        magnitudes: Magnitudes,
        generator: np.random.Generator,
    ) -> World:
        """A world around the nominal arm, probe, gauge and `T_base_gauge` by location.

        Each part draws from a stream of its own: changing the magnitude of one, or adding a
        location, leaves the others as they are.

        Raises:
            ContactError: no sphere of the gauge's diameter fits the probe.
        """
        of_arm, of_probe, of_psds, of_gauge, of_placements, of_encoders = generator.spawn(6)
        bound = magnitudes.bound
        mount = moved(
            probe.flange_T_probe,
            magnitudes.probe.translation,
            magnitudes.probe.rotation,
            bound,
            of_probe,
        )
        centers = true_centers(gauge, magnitudes.gauge.certificate, bound, of_gauge)
        stands = [
            moved(
                placements[number],
                magnitudes.gauge.translation,
                magnitudes.gauge.rotation,
                bound,
                of_placements,
            )
            for number in sorted(placements)
        ]
        return cls(
            true_arm(arm, magnitudes.arm, bound, of_arm),
            probe.mounted(mount),
            probe.centers(np.zeros((1, STYLI)), gauge.sphere_diameter)[0],
            Psds.drawn(magnitudes.psd, of_psds),
            gauge.sphere_diameter,
            np.repeat(np.array(sorted(placements), dtype=np.int64), len(centers)),
            np.tile(np.array(gauge.numbers, dtype=np.int64), len(stands)),
            frozen(np.concatenate([stand.apply(centers) for stand in stands])),
            magnitudes,
            Encoders.drawn(magnitudes.arm.eccentricity, magnitudes.arm.ovality, arm.n, of_encoders),
        )

    def repeatability(self) -> Repeatability:
        """What this arm's encoders do not see."""
        magnitudes = self.magnitudes.arm
        return Repeatability(magnitudes.repeatability, magnitudes.travel)

    def sight(self, true_joints: Array) -> Sighting:
        """The sphere nearest to the probe's middle at true joint angles (N, n), rad."""
        T_base_flange = forward_kinematics(self.arm, true_joints)
        mount = self.probe.flange_T_probe
        R_base_probe = T_base_flange[:, :3, :3] @ mount.rotation
        p_flange_middle = mount.apply(self.p_probe_middle)
        p_base_middle = T_base_flange[:, :3, :3] @ p_flange_middle + T_base_flange[:, :3, 3]
        offset = self.p_base_sphere - p_base_middle[:, None, :]  # (N, S, 3)
        rows = np.arange(len(offset))
        nearest = np.argmin(np.einsum('nsk,nsk->ns', offset, offset), axis=1)
        from_middle = np.einsum('nki,nk->ni', R_base_probe, offset[rows, nearest])
        p_probe_sphere = from_middle + self.p_probe_middle
        return Sighting(self.location[nearest], self.sphere[nearest], p_probe_sphere)

    def contact(self, p_probe_sphere: Array) -> Contact:
        """Where the styli stand against spheres centred at `p_probe_sphere` (N, 3), m."""
        if isinstance(self.probe, PassiveProbe):
            return seat(self.probe, p_probe_sphere, self.magnitudes.probe.seat_reach)
        return touch(self.probe, p_probe_sphere, self.sphere_diameter)

    def read(self, contact: Contact, generator: Normal) -> Contact:
        """What the probe reports: displacements by way of the PSDs, and where they fail."""
        if isinstance(self.probe, PassiveProbe):
            return contact
        displacement, weak = self.psds.read(contact.displacement, generator)
        # first of all comes the instrument itself: without light its other words mean little
        status = np.where(weak, np.uint8(Status.WEAK_SIGNAL), contact.status)
        return Contact(displacement, status)


def true_arm(
    arm: Arm, magnitudes: ArmMagnitudes, bound: float, generator: np.random.Generator
) -> Arm:
    """An arm off its description in every D-H parameter, those that no one can see included."""
    sigma = dict.fromkeys(JOINT_PARAMETERS, magnitudes.angle)
    sigma |= dict.fromkeys(LENGTHS, magnitudes.length) | {'beta': magnitudes.beta}
    error = bounded_normal((len(JOINT_PARAMETERS), arm.n), bound, generator)
    scale = np.array([sigma[key] for key in JOINT_PARAMETERS])
    return arm.with_geometry(arm.geometry + scale[:, None] * error)


def true_centers(gauge: Gauge, ratio: float, bound: float, generator: np.random.Generator) -> Array:
    """Sphere centres (S, 3), m, in the gauge frame, off their certificate by its uncertainty.

    Half of `constant` (k = 2) is the standard deviation of a distance between two centres that
    are off independently, half of `proportional` that of a wrong metre common to them all.
    """
    certified = np.array([center for _, center in gauge.spheres])
    metre = 1 + ratio * gauge.proportional / 2 * bounded_normal((), bound, generator)
    each = ratio * gauge.constant / 2 / np.sqrt(2)
    centers: Array = certified * metre + each * bounded_normal(certified.shape, bound, generator)
    return centers


def moved(
    nominal: RigidTransform,
    translation: float,
    rotation: float,
    bound: float,
    generator: np.random.Generator,
) -> RigidTransform:
    """A transform off by so much in each coordinate (m) and about each axis (rad) of the parent."""
    shift = translation * bounded_normal((3,), bound, generator)
    turn = rotation * bounded_normal((3,), bound, generator)
    if not turn.any():
        return replace(nominal, translation=frozen(nominal.translation + shift))
    turned = rotation_vector(rotation_matrix(turn) @ nominal.rotation)
    return RigidTransform(nominal.translation + shift, turned)


def bounded_normal(shape: tuple[int, ...], bound: float, generator: np.random.Generator) -> Array:
    """Standard normal numbers, those beyond +-`bound` drawn again."""
    values = np.asarray(generator.standard_normal(shape))
    while (outside := np.abs(values) > bound).any():
        values[outside] = generator.standard_normal(int(outside.sum()))
    return values
