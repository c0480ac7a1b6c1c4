# SPDX-License-Identifier: Apache-2.0
"""Self-centering probes: what they read of a gauge sphere, and the sphere's centre from it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import ContactError, DataError
from calib_model.transforms import RigidTransform, cross

STYLI = 3


@dataclass(frozen=True)
class Stylus:
    """A straight guide: the tip's centre is `origin` + displacement * `direction` (probe frame, m).

    `direction` is a unit vector into the housing, so a displacement is positive when the sphere
    pushes the stylus in. `stroke` are the displacements of the free and of the blocked stylus.
    """

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    tip_radius: float
    stroke: tuple[float, float]


@dataclass(frozen=True)
class PassiveProbe:
    """A kinematic seat: the seated sphere's centre is always at `center` (3,), probe frame, m.

    `simulated` is said by who simulates it, and compared with nothing.
    """

    name: str
    flange_T_probe: RigidTransform
    center: Array = field(default_factory=lambda: frozen(np.zeros(3)))
    simulated: bool = field(default=False, compare=False)
    kind = 'passive'

    def __post_init__(self) -> None:
        object.__setattr__(self, 'center', frozen(self.center))

    def centers(self, displacement: Array, sphere_diameter: float) -> Array:
        """`p_probe_sphere` (N, 3), m: the seat's centre whatever `displacement` (N, 3) says."""
        return np.tile(self.center, (len(displacement), 1))

    def mounted(self, flange_T_probe: RigidTransform) -> PassiveProbe:
        """The same probe at another place on the flange."""
        return replace(self, flange_T_probe=flange_T_probe)


@dataclass(frozen=True)
class ActiveProbe:
    """Three styli whose displacements are read; together they find the sphere's centre.

    Row by row of `styli`: `origin` and unit `direction` (3, 3), `tip_radius` (3,), m, and `stroke`
    (3, 2), the displacements of the free and of the blocked stylus, m. `simulated` is said by who
    simulates them, and compared with nothing.
    """

    name: str
    flange_T_probe: RigidTransform
    styli: tuple[Stylus, Stylus, Stylus]
    simulated: bool = field(default=False, compare=False)
    kind = 'active'
    origin: Array = field(init=False, repr=False, compare=False)
    direction: Array = field(init=False, repr=False, compare=False)
    tip_radius: Array = field(init=False, repr=False, compare=False)
    stroke: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.styli) != STYLI:
            raise DataError(f'{self.name}: expected {STYLI} styli, got {len(self.styli)}')
        directions = np.array([stylus.direction for stylus in self.styli])
        object.__setattr__(self, 'origin', frozen([s.origin for s in self.styli]))
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        object.__setattr__(self, 'direction', frozen(directions / lengths))
        object.__setattr__(self, 'tip_radius', frozen([s.tip_radius for s in self.styli]))
        object.__setattr__(self, 'stroke', frozen([s.stroke for s in self.styli]))

    def mounted(self, flange_T_probe: RigidTransform) -> ActiveProbe:
        """The same probe at another place on the flange: another P in eq. 14."""
        return replace(self, flange_T_probe=flange_T_probe)

    def displacements(self, centers: Array, sphere_diameter: float) -> Array:
        """Displacements (N, 3) at which the tips touch spheres centred at `centers` (N, 3), m.

        The tip's centre o + s u lies rho = (sphere + tip radius) from c:
        s = -w.u + sqrt((w.u)^2 - |w|^2 + rho^2) with w = o - c; of the two roots the one where
        the sphere is in front of the tip. Strokes are not applied. NaN where a tip passes by.
        """
        w = self.origin - np.asarray(centers, dtype=np.float64)[:, None, :]  # (N, 3 styli, 3)
        rho = sphere_diameter / 2 + self.tip_radius
        along = np.einsum('nsk,sk->ns', w, self.direction)
        under_root = along**2 - np.einsum('nsk,nsk->ns', w, w) + rho**2
        with np.errstate(invalid='ignore'):
            touching: Array = np.sqrt(under_root) - along
        return touching

    def centers(self, displacement: Array, sphere_diameter: float) -> Array:
        """`p_probe_sphere` (N, 3) from displacements (N, 3), m: three spheres intersected.

        The sphere's centre lies rho_i from each tip's centre; of the two such points the one on
        the side away from the housing is the gauge sphere's.

        Raises:
            ContactError: the tips are in line, or no sphere of this diameter touches all three;
                names the first such row.
        """
        s = np.asarray(displacement, dtype=np.float64)
        tips = self.origin + s[:, :, None] * self.direction  # (N, 3 styli, 3)
        rho = sphere_diameter / 2 + self.tip_radius
        first, second = tips[:, 1] - tips[:, 0], tips[:, 2] - tips[:, 0]
        normal = cross(first, second)
        area = np.einsum('nk,nk->n', normal, normal)
        _refuse_rows(~(area > 1e-24), f'{self.name}: the three tips are in line')
        # p - tip_0 = u + h normal, u in the tips' plane from the differences of the three spheres
        along_first = (rho[0] ** 2 - rho[1] ** 2 + np.einsum('nk,nk->n', first, first)) / 2
        along_second = (rho[0] ** 2 - rho[2] ** 2 + np.einsum('nk,nk->n', second, second)) / 2
        in_plane = (
            cross(second, normal) * along_first[:, None]
            + cross(normal, first) * along_second[:, None]
        ) / area[:, None]
        height = rho[0] ** 2 - np.einsum('nk,nk->n', in_plane, in_plane)
        _refuse_rows(~(height >= 0), f'{self.name}: no sphere of that diameter touches all tips')
        housing = np.sign(normal @ self.direction.sum(axis=0))
        lift = -housing * np.sqrt(height / area)
        centers: Array = tips[:, 0] + in_plane + lift[:, None] * normal
        return centers

    def within_stroke(self, displacement: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Which displacements (N, 3) each stylus can really take, shape (N, 3)."""
        lower, upper = self.stroke.T
        inside: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
        inside = (displacement >= lower) & (displacement <= upper)
        return inside


Probe = ActiveProbe | PassiveProbe


def _refuse_rows(bad: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], problem: str) -> None:
    if bad.any():
        raise ContactError(f'{problem} (reading {int(np.argmax(bad)) + 1} of {len(bad)})')


def trihedron(
    flange_T_probe: RigidTransform,
    sphere_diameter: float = 0.022,
    tip_radius: float = 0.003,
    stroke: tuple[float, float] = (-0.003, 0.003),
    name: str = 'active_trihedron',
) -> ActiveProbe:
    """The chapter's probe: three orthogonal styli at equal angles to the probe's axis, z outward.

    At zero displacement a sphere of `sphere_diameter` (m) is centred at the probe's origin.
    """
    rho = sphere_diameter / 2 + tip_radius
    azimuth = np.radians([0.0, 120.0, 240.0])
    radial, axial = np.sqrt(2 / 3), -np.sqrt(1 / 3)
    styli = []
    for angle in azimuth:
        direction = (float(radial * np.cos(angle)), float(radial * np.sin(angle)), float(axial))
        origin = (rho * direction[0], rho * direction[1], rho * direction[2])
        styli.append(Stylus(origin, direction, tip_radius, stroke))
    return ActiveProbe(name, flange_T_probe, (styli[0], styli[1], styli[2]))


def known_centers(probe: Probe, displacement: Array, sphere_diameter: float) -> Array:
    """`p_probe_sphere` (N, 3), m, of readings (N, 3), m; NaN in the rows that no sphere gives."""
    try:
        return probe.centers(displacement, sphere_diameter)
    except ContactError:
        if len(displacement) == 1:
            return np.full((1, 3), np.nan)
    half = len(displacement) // 2
    parts = (displacement[:half], displacement[half:])
    return np.concatenate([known_centers(probe, part, sphere_diameter) for part in parts])
