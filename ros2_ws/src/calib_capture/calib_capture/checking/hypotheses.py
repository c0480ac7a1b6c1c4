# SPDX-License-Identifier: Apache-2.0
"""One sphere stands still: what would have to be counted otherwise for readings to say so.

The sphere's centre in the base frame is p(q, s). While the arm moves in contact with a sphere p has
to stay where it is, but for what is not known of arm and probe beforehand. With the centred
positions b, their Jacobian A by everything unknown, in its standard deviations, and the noise
sigma, the cost of a hypothesis is min_x |b + A x|^2 / sigma^2 + |x|^2: what it leaves unexplained.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import ActiveProbe, Arm, Gauge, known_centers
from calib_model.kinematics import DEFAULT_SIGMA, points, probing_jacobian
from calib_model.transforms import RigidTransform, rotation_matrix, rotation_vector

NOISE = 1e-5  # m: of a reading, with what is left of interpolation
STEP = 0.005  # s between the instants by which speeds are told
CLOCK = 0.1  # s that clocks may differ
MOUNT = {'probe_translation': 2e-3, 'probe_rotation': 2e-2}  # as hardware.md asks for
NO_SPHERE = 1e9  # cost of a hypothesis by which readings are of no sphere
AXES = ('x', 'y', 'z')


@dataclass(frozen=True)
class Contact:
    """Readings of spheres in motion: joints (N, n) in rad at the readings and `STEP` before and
    after them, displacements (N, 3) in m with their standard deviation `noise`, and the number
    (N,) of the sphere that each is of. The joints are those of `shift` s after the stamps."""

    joints: Array
    displacement: Array
    before: Array
    after: Array
    sphere: NDArray[np.int64]
    noise: float = NOISE
    shift: float = 0.0

    def thinned(self, every: int) -> Contact:
        """Every so many readings of it."""
        return replace(
            self,
            joints=self.joints[::every],
            displacement=self.displacement[::every],
            before=self.before[::every],
            after=self.after[::every],
            sphere=self.sphere[::every],
        )


@dataclass(frozen=True)
class Hypothesis:
    """What is counted in another way than described: `signs` and `order` of the styli in a
    reading, a joint (from 0) that `flips`, or one that counts so many rad more (`off`), and by how
    much the probe is turned on the flange (3,)."""

    name: str
    signs: tuple[int, int, int] = (1, 1, 1)
    order: tuple[int, int, int] = (0, 1, 2)
    flips: int | None = None
    off: tuple[int, float] | None = None
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def likely(self) -> bool:
        """Whether it is one that is worth trying together with others."""
        return self.flips is not None or self.turn[2] != 0

    def and_also(self, other: Hypothesis) -> Hypothesis:
        """Both: the styli as `self` says, joints and mounting as `other` does."""
        return replace(
            other, name=f'{self.name}, and {other.name}', signs=self.signs, order=self.order
        )

    def applied(
        self, arm: Arm, probe: ActiveProbe, displacement: Array
    ) -> tuple[Arm, ActiveProbe, Array]:
        """Arm, probe and displacements (N, 3) as they would be then."""
        joints = [
            replace(joint, direction=-joint.direction) if i == self.flips else joint
            for i, joint in enumerate(arm.joints)
        ]
        if self.off is not None:
            i, more = self.off
            joints[i] = replace(joints[i], theta_0=joints[i].theta_0 + joints[i].direction * more)
        mount = probe.flange_T_probe
        turned = mount.rotation @ rotation_matrix(np.array(self.turn))
        mounted = probe.mounted(RigidTransform(mount.translation, rotation_vector(turned)))
        counted = np.empty_like(displacement)
        counted[:, list(self.order)] = displacement * np.array(self.signs)
        return replace(arm, joints=tuple(joints)), mounted, counted


@dataclass(frozen=True)
class Explained:
    """A hypothesis with its `cost` for so many `rows` of so many `readings`, by how much (s) their
    stamps are behind the joints', and by how much (rad) the probe had to be turned for it."""

    hypothesis: Hypothesis
    cost: float
    rows: int
    readings: int
    noise: float = NOISE
    late: float = 0.0
    late_uncertainty: float = np.inf
    turned: float = 0.0

    @property
    def rms(self) -> float:
        """What it leaves unexplained, root mean square per coordinate, m."""
        return float(self.noise * np.sqrt(self.cost / max(self.rows, 1)))


AS_DESCRIBED = Hypothesis('as described')


def explained(
    arm: Arm, probe: ActiveProbe, gauge: Gauge, contact: Contact, hypothesis: Hypothesis
) -> Explained:
    """How well the hypothesis explains that the sphere stands still."""
    arm, probe, s = hypothesis.applied(arm, probe, contact.displacement)
    rows = 3 * (len(s) - len(np.unique(contact.sphere)))
    p_probe = known_centers(probe, s, gauge.sphere_diameter)
    if not np.isfinite(p_probe).all():
        return Explained(hypothesis, NO_SPHERE * rows, rows, len(s), contact.noise)
    p_base, jacobian = probing_jacobian(arm, probe, contact.joints, p_probe)
    p_flange = probe.flange_T_probe.apply(p_probe)
    ends = [points(arm, q, p_flange) for q in (contact.before, contact.after)]
    rate = (ends[1] - ends[0]) / (2 * STEP) * CLOCK
    columns = np.concatenate([jacobian * _known(arm), rate[:, :, None]], axis=2)
    b = _centred(p_base, contact.sphere).reshape(-1) / contact.noise
    a = _centred(columns, contact.sphere).reshape(len(b), -1) / contact.noise
    normal = a.T @ a + np.eye(a.shape[1])
    x = -np.linalg.solve(normal, a.T @ b)
    cost = float(b @ b + x @ (a.T @ b))
    scatter = max(cost / max(rows, 1), 1.0)  # noise assumed too small makes no sure clock
    sure = CLOCK * float(np.sqrt(scatter * np.linalg.inv(normal)[-1, -1]))
    late = contact.shift + CLOCK * float(x[-1])
    turned = float(np.linalg.norm(x[-4:-1])) * MOUNT['probe_rotation']
    return Explained(hypothesis, cost, rows, len(s), contact.noise, late, sure, turned)


def _centred(values: Array, sphere: NDArray[np.int64]) -> Array:
    """Values (N, ...) off their mean over each sphere."""
    centred = values.copy()
    for number in np.unique(sphere):
        centred[sphere == number] -= values[sphere == number].mean(axis=0)
    return centred


def _known(arm: Arm) -> Array:
    """Standard deviations (5n + 6,) of all parameters, in the order of the Jacobian."""
    sigma = {**DEFAULT_SIGMA, **MOUNT}
    of_joints = np.repeat([sigma[key] for key in ('a', 'alpha', 'd', 'theta_0', 'beta')], arm.n)
    of_mount = np.repeat([MOUNT['probe_translation'], MOUNT['probe_rotation']], 3)
    return np.concatenate([of_joints, of_mount])


def of_styli() -> Iterator[Hypothesis]:
    """Other signs and orders of the styli, the simplest first."""
    ways = product(permutations(range(3)), product((1, -1), repeat=3))
    for order, (one, two, three) in sorted(
        ways, key=lambda way: (way[0] != (0, 1, 2)) + way[1].count(-1)
    ):
        signs = (one, two, three)
        other = [str(i + 1) for i in range(3) if signs[i] < 0]
        said = []
        if order != (0, 1, 2):
            said.append(f'styli in the order {" ".join(str(i + 1) for i in order)}')
        if other:
            said.append(f'sign of displacement {" and ".join(other)}')
        if said:
            first, second, third = order
            yield Hypothesis(', '.join(said), signs, (first, second, third))


def of_joints(arm: Arm) -> Iterator[Hypothesis]:
    """One joint that is counted the other way, or from another zero."""
    for i, name in enumerate(arm.joint_names):
        yield Hypothesis(f'sign of {name}', flips=i)
    for i, joint in list(enumerate(arm.joints))[1:]:  # the first one's zero turns all alike
        for degrees in () if joint.prismatic else (90, -90, 180):
            said = f'{joint.name} counts {degrees} deg more than described'
            yield Hypothesis(said, off=(i, float(np.radians(degrees))))


def of_mounting() -> Iterator[Hypothesis]:
    """The probe turned on the flange by a quarter or half a turn, or by one stylus of three."""
    for axis, name in enumerate(AXES):
        for degrees in (90, -90, 180, 120, -120) if name == 'z' else (90, -90, 180):
            turn = np.zeros(3)
            turn[axis] = np.radians(degrees)
            x, y, z = turn.tolist()
            said = f'the probe is mounted turned by {degrees} deg about its {name} axis'
            yield Hypothesis(said, turn=(x, y, z))
