# SPDX-License-Identifier: Apache-2.0
"""What a fit says of itself beyond its quality: rank, noise, misfit, where residuals gather."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Gauge
from calib_solver.fitting import USUAL_PRIOR, Options
from calib_solver.identified import Identification

#: kinds of an arm's parameters, for people
KINDS = {
    'a': 'lengths a',
    'alpha': 'twists alpha',
    'd': 'offsets d',
    'theta_0': 'zeros',
    'beta': 'tilts beta',
}
#: so many times what is usual is worth a word
FURTHER = 2.0


class Chosen(Protocol):
    """An identification of either kind, as far as its options go."""

    @property
    def options(self) -> Options:
        """What was chosen, with the widths that the evidence gave."""
        ...


def diagnostics_record(done: Identification) -> dict[str, Any]:
    """What `result.json` says under `diagnostics`, SI."""
    sure = done.position_uncertainty
    deviation, gauge = done.identified.deviation, done.problem.measured.gauge
    return {
        'rank': done.observability.rank,
        'free': len(done.fit.x),
        'condition': finite(done.observability.condition),
        'noise': done.uncertainty.noise,
        'misfit': done.uncertainty.misfit,
        'prior': prior_record(done),
        'position_uncertainty_rms': float(np.sqrt(np.mean(sure**2))),
        'position_uncertainty_max': float(sure.max()),
        'by_location': by_location(done, deviation),
        'by_joint': by_joint(done, deviation),
        'untold': list(done.untold),
        'scale': vars(gauge.scale) if gauge.scale is not None else None,
    }


def scale_words(gauge: Gauge) -> str:
    """What the temperature does to all lengths, or would if it were known."""
    expansion, scale = gauge.expansion, gauge.scale
    if expansion is None:
        return (
            "neither the gauge's temperature nor its expansion is given: of steel, each kelvin "
            'from that of its certificate is 11.5 um/m of every length'
        )
    per_kelvin = f'{expansion.coefficient * 1e6:.3g} um/m'
    if scale is None:
        return (
            f"the gauge's temperature is not given: each kelvin from {expansion.reference:g} deg C "
            f'is {per_kelvin} of every length'
        )
    return (
        f"the gauge's lengths are taken at {scale.temperature:g} deg C: "
        f'{(scale.factor - 1) * 1e6:+.2f} um/m, sure to '
        f'{scale.standard_uncertainty * 1e6:.2f} um/m ({per_kelvin} a kelvin)'
    )


def prior_record(done: Chosen) -> dict[str, Any]:
    """The strength used, and by how many times what is usual each kind is off by the evidence."""
    prior = done.options.prior
    return {
        'strength': prior.strength,
        'cross_validation': None,
        'evidence': prior.evidence,
        'widths': [{'kind': kind, 'times': times} for kind, times in prior.times.items()],
    }


def prior_words(result: dict[str, Any]) -> str:
    """What the prior was, and which kinds were found further off than is usual, in words for
    people; `result` is a result's record."""
    record = result['diagnostics']['prior']
    if record['strength'] == 0:
        return 'No prior: the poses alone decide.'
    times = {one['kind']: one['times'] for one in record['widths']}
    if not times:
        return f'The prior draws parameters to nominal with strength {record["strength"]:g}.'
    widths = ', '.join(
        f'{KINDS.get(kind, kind)} {_two_digits(size)}' for kind, size in times.items()
    )
    text = f'The prior is as wide as the poses say, times what is usual: {widths}.'
    far = [
        f"this arm's {KINDS[kind]} are {_two_digits(off)} times"
        for kind, off in _found_off(result['parameters']).items()
        if off > FURTHER
    ]
    return f'{text} Further off than is usual: {", ".join(far)}.' if far else text


def _found_off(parameters: list[dict[str, Any]]) -> dict[str, float]:
    """Times what is usual, how far off each of KINDS was found (root mean square). How wide a kind
    is held tells less: the others count in that."""
    offsets: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for one in parameters:
        kind = one['name'].rstrip('0123456789').rstrip('_')
        if one['free'] and kind in offsets:
            offsets[kind].append((one['identified'] - one['initial']) / USUAL_PRIOR.sigma[kind])
    return {
        kind: float(np.sqrt(np.mean(np.square(each)))) for kind, each in offsets.items() if each
    }


def _two_digits(size: float) -> str:
    """Without an exponent, as people write it."""
    return f'{float(f"{size:.2g}"):g}'


def finite(value: float) -> float | None:
    """The value, None where it is infinite or no number."""
    return value if np.isfinite(value) else None


def by_location(done: Identification, deviation: Array) -> list[dict[str, Any]]:
    """Spread and distance errors of each location."""
    problem = done.problem
    location = np.repeat(problem.keys[:, 0], problem.counts)
    of_pair = problem.keys[problem.pairs[:, 0], 0]
    records = []
    for number in np.unique(location):
        size = np.linalg.norm(deviation[location == number], axis=1)
        errors = done.identified.distance[of_pair == number]
        records.append(
            {
                'location': int(number),
                'poses': len(size),
                'rms': float(np.sqrt(np.mean(size**2))),
                'max': float(size.max()),
                'distance_mean': float(errors.mean()) if len(errors) else None,
            }
        )
    return records


def by_joint(done: Identification, deviation: Array) -> list[dict[str, Any]]:
    """What of the poses' deviations (N, 3), m, goes with each joint."""
    return joint_shares(done.arm.joint_names, done.problem.joints, deviation)


def joint_shares(names: Sequence[str], joints: Array, deviation: Array) -> list[dict[str, Any]]:
    """The share of the residuals' variance that goes with one joint's angle alone.

    Regressed on the first two harmonics of each joint; what is much above its share by chance
    says that the joint has an error that Denavit-Hartenberg parameters cannot say.
    """
    total = float((deviation**2).sum())
    records = []
    for name, q in zip(names, joints.T, strict=True):
        harmonics = np.stack([np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)], axis=1)
        harmonics = np.concatenate([np.ones((len(q), 1)), harmonics], axis=1)
        fitted = harmonics @ np.linalg.lstsq(harmonics, deviation, rcond=1e-10)[0]
        share = float((fitted**2).sum()) / total if total > 0 else 0.0
        records.append({'joint': name, 'explained': share, 'by_chance': 4 / max(len(q), 5)})
    return records
