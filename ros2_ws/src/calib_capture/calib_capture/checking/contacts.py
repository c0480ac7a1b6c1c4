# SPDX-License-Identifier: Apache-2.0
"""Readings in contact, with the joints at their instants."""

from __future__ import annotations

import numpy as np

from calib_capture.checking.hypotheses import (
    AS_DESCRIBED,
    NOISE,
    STEP,
    Contact,
    Explained,
    explained,
)
from calib_capture.checking.signs import Told, fits, told_by
from calib_capture.checking.streams import Heard, arrival_offset
from calib_model.arrays import Array
from calib_model.instruments import ActiveProbe, Arm, Gauge, known_centers
from calib_model.kinematics import points
from calib_model.pairing import Reading, interpolated
from calib_model.stamps import SECOND

MOST_ROWS, FEWEST = 60, 10
USUAL_GAPS, SHORT = 2.5, 0.004  # of the usual time between joint states, and s, to interpolate over
FAR = 0.03  # s between clocks beyond which speeds at a reading's stamp are of another instant
AGAIN = 0.01  # s between clocks, from which on all is told again
STUCK = 0.05  # of the way of the liveliest stylus, that each makes at least


def contact_of(heard: Heard, shift: float = 0.0, rows: int = MOST_ROWS) -> Contact | None:
    """Readings in contact with the joints `shift` s after their stamps, evenly thinned; None of
    too few."""
    joints = {each.stamp: each.joints for each in heard.joints}
    stamps = np.array(sorted(joints), dtype=np.int64)
    good = [each for each in heard.readings if not any(each.status)]
    if len(stamps) < 4 or len(good) < FEWEST:
        return None
    q = np.array([joints[stamp] for stamp in stamps.tolist()])
    noise = max(NOISE, noise_of(np.array([each.displacement for each in good])))
    thin = good[:: max(len(good) // rows, 1)]
    return _interpolated(stamps, q, thin, shift, noise)


def noise_of(values: Array) -> float:
    """The largest standard deviation of values (N, k) in motion, by third differences, of which
    motion has next to nothing; their median leaves out where contact begins and ends."""
    thirds = np.abs(np.diff(values, n=3, axis=0))
    return float(np.median(thirds, axis=0).max() * 1.4826 / np.sqrt(20))


def _interpolated(
    stamps: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    q: Array,
    readings: list[Reading],
    shift: float,
    noise: float,
) -> Contact | None:
    at = np.array([each.stamp for each in readings], dtype=np.int64) + round(shift * SECOND)
    step = round(STEP * SECOND)
    usual = float(np.median(np.diff(stamps))) / SECOND
    gap = max(USUAL_GAPS * usual, SHORT)
    here, before, after = (interpolated(stamps, q, at + apart, gap) for apart in (0, -step, step))
    known = here.known & before.known & after.known
    if known.sum() < FEWEST:
        return None
    return Contact(
        here.joints[known],
        np.array([each.displacement for each in readings])[known],
        before.joints[known],
        after.joints[known],
        np.zeros(int(known.sum()), dtype=np.int64),
        noise,
        shift,
    )


def in_step(arm: Arm, probe: ActiveProbe, gauge: Gauge, heard: Heard) -> Contact | None:
    """As `contact_of`, by the stamps or, where the sphere stands stiller then, by what comes
    together: clocks may be far apart."""
    by_stamps = contact_of(heard)
    late = arrival_offset(heard)
    if by_stamps is not None and (
        abs(late) < FAR or fits(explained(arm, probe, gauge, by_stamps, AS_DESCRIBED))
    ):
        return by_stamps
    by_arrival = contact_of(heard, late)
    tried = [each for each in (by_stamps, by_arrival) if each is not None]

    def cost(contact: Contact) -> float:
        found: Explained = explained(arm, probe, gauge, contact, AS_DESCRIBED)
        return found.cost / found.rows

    return min(tried, key=cost, default=None)


def told_of(arm: Arm, probe: ActiveProbe, gauge: Gauge, heard: Heard, contact: Contact) -> Told:
    """What a contact of what was heard tells, by the joints of the right instants."""
    told = told_by(arm, probe, gauge, contact)
    late = (told.found or told.plain).late
    again = contact_of(heard, late) if abs(late - contact.shift) > AGAIN else None
    return told if again is None else told_by(arm, probe, gauge, again)


def apart(
    arm: Arm, probe: ActiveProbe, gauge: Gauge, touches: tuple[Array, Array], places: Array
) -> Array:
    """How far (N, M), m, the sphere is from each of `places` (M, 3) that touches the styli, as
    described, by joints (N, n) and displacements (N, 3); NaN where no sphere gives these."""
    joints, displacement = touches
    p_probe = known_centers(probe, displacement, gauge.sphere_diameter)
    p_base = points(arm, joints, probe.flange_T_probe.apply(p_probe))
    distances: Array = np.linalg.norm(p_base[:, None] - places[None], axis=2)
    return distances


def stuck(contact: Contact) -> int | None:
    """The stylus (from 0) that stays where it is while the others move; None where all move."""
    ways = np.ptp(contact.displacement, axis=0)
    least = int(np.argmin(ways))
    return least if ways[least] < STUCK * ways.max() and ways.max() > 5 * contact.noise else None
