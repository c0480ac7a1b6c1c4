# SPDX-License-Identifier: Apache-2.0
"""When the readings of a calibration were taken, where their stamps are a time of day."""

from __future__ import annotations

from datetime import datetime, timezone

from calib_model.measured_points import PointSet
from calib_model.measurement import ProbingSet

#: stamps (ns) before 2001 are no time of day but a count
FIRST_DATE = 10**18


def readings_record(taken: ProbingSet | PointSet) -> dict[str, str | None]:
    """First and last reading that was identified from, ISO 8601 in UTC; null without a date."""
    span = reading_times(taken)
    first, last = (None, None) if span is None else (one.isoformat('T', 'seconds') for one in span)
    return {'first': first, 'last': last}


def reading_times(taken: ProbingSet | PointSet) -> tuple[datetime, datetime] | None:
    """First and last reading as times of day; None where their stamps are none."""
    first, last = int(taken.stamp.min()), int(taken.stamp.max())
    if first < FIRST_DATE:
        return None
    begin, end = (datetime.fromtimestamp(t / 1e9, timezone.utc) for t in (first, last))
    return begin, end
