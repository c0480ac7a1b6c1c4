# SPDX-License-Identifier: Apache-2.0
"""Fault signatures: residuals that are mostly one known fault's shadow.

After the fit the deviations are held against what a wrong gain of a stylus, a wrong diameter of the
spheres, an encoder that jumped or a gauge that was pushed in mid-measurement would have left. What
the identified parameters could have taken up is set aside first, so a fault is named only for what
nothing else explains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib_model.instruments import ActiveProbe, Arm, Probe
from calib_model.kinematics import ParameterTable, point_derivatives
from calib_solver.faults.encoder_jumps import likely_jumps
from calib_solver.faults.residual_projection import ResidualProjection
from calib_solver.problem import IntArray, Problem

#: so many poses are looked at, and so many moments at which an encoder may have jumped
POSES, MOMENTS = 1000, 60
#: a fault is named when it alone explains this share of the residuals' variance
SHARE = 0.5
#: too few poses let anything explain everything
FEWEST = 100
#: m, below which residuals are rounding, and no fault's
ROUNDING = 1e-12
#: of two faults that leave much alike, the one that leaves less is not named alone within this
ALIKE = 1.5
STEP = 1e-7  # m, for the derivative by a reading or a diameter


@dataclass(frozen=True)
class FaultSignature:
    """A fault that explains `share` of the residuals' variance; `kind` is what is at fault."""

    share: float
    text: str
    kind: str


def named_signatures(
    problem: Problem, table: ParameterTable, arm: Arm, probe: Probe, pose_of: IntArray
) -> tuple[str, ...]:
    """A line for the fault that explains most of the deviations (3 N,), if any does.

    `pose_of` (N,) are the poses' places in the measurement as it was made.
    """
    rows = np.unique(np.linspace(0, len(problem.joints) - 1, POSES).astype(np.int64))
    if len(rows) < FEWEST:
        return ()
    residuals = ResidualProjection(problem, table, arm, probe, rows)
    if np.abs(residuals.left).max() < ROUNDING:
        return ()
    found = sorted(_signatures(residuals, pose_of), key=lambda one: -one.share)
    best, other = found[0], next((one for one in found if one.kind != found[0].kind), found[0])
    if best.share < SHARE:
        return ()
    if other.kind != best.kind and 1 - other.share < ALIKE * (1 - best.share):
        shares = f'that alone explains {best.share:.0%} or {other.share:.0%} of the residuals'
        return (f'one of: {best.text}; {other.text}: {shares}',)
    return (f'{best.text}: that alone explains {best.share:.0%} of the residuals',)


def _signatures(residuals: ResidualProjection, pose_of: IntArray) -> Iterator[FaultSignature]:
    if isinstance(residuals.probe, ActiveProbe):
        yield from _of_the_probe(residuals, residuals.probe)
    places = np.sort(residuals.when)
    moments = places[np.unique(np.linspace(2, len(places) - 2, MOMENTS).astype(np.int64))]
    for jump in likely_jumps(residuals, moments):
        name = residuals.arm.joint_names[jump.joint]
        yield FaultSignature(
            jump.share, f'joint {name} {jump.text(residuals.arm, pose_of)}', 'joint'
        )
    yield _push(residuals, moments, pose_of)


def _push(residuals: ResidualProjection, moments: IntArray, pose_of: IntArray) -> FaultSignature:
    """The gauge pushed at the one of some moments (K,), places in the measurement, that explains
    most, until it is carried on."""
    where = residuals.measured.poses.location
    later = residuals.when >= moments[:, None]
    fits, among = residuals.products_of_shifts(
        later & (where[residuals.when] == where[moments][:, None])
    )
    # the part that no parameter takes up may lack a direction
    steps = np.einsum('kij,kj->ki', np.linalg.pinv(among, hermitian=True, rcond=1e-6), fits)
    shares = residuals.share(np.einsum('ki,ki->k', fits, steps))
    best = int(np.argmax(shares))
    location, near = where[moments[best]], pose_of[moments[best]] + 1
    size = np.linalg.norm(steps[best]) * 1e3
    text = f'the gauge at location {location} was pushed by {size:.3f} mm near pose {near}'
    return FaultSignature(float(shares[best]), text, 'gauge')


def _of_the_probe(residuals: ResidualProjection, probe: ActiveProbe) -> Iterator[FaultSignature]:
    """Each stylus' reading off by a factor, and the spheres' diameter off by something."""
    diameter = residuals.measured.gauge.sphere_diameter
    read = residuals.measured.poses.displacement[residuals.when]
    flange = point_derivatives(residuals.arm, residuals.joints, residuals.p_probe).flange
    turn = flange @ probe.flange_T_probe.rotation
    by_reading = np.empty((*read.shape, 4))
    for stylus in range(3):
        moved = np.array(read)
        moved[:, stylus] += STEP
        by_reading[:, :, stylus] = probe.centers(moved, diameter) - residuals.p_probe
        by_reading[:, :, stylus] *= read[:, [stylus]]
    by_reading[:, :, 3] = probe.centers(read, diameter + STEP) - residuals.p_probe
    shares, sizes = residuals.explained(np.einsum('nij,njf->nif', turn, by_reading / STEP))
    for stylus in range(3):
        much = 'much' if sizes[stylus] > 0 else 'little'
        size = f'{abs(sizes[stylus]):.2%}'
        yield FaultSignature(
            float(shares[stylus]), f'stylus {stylus + 1} reads {size} too {much}', 'stylus'
        )
    text = f"the spheres' diameter is {-sizes[3] * 1e3:+.3f} mm from the gauge's {diameter * 1e3:g}"
    yield FaultSignature(float(shares[3]), f'{text} mm, or the tips are so in all', 'sphere')
