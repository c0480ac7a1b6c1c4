# SPDX-License-Identifier: Apache-2.0
"""What the report shows besides `result.json`, kept as `report.json`: charts, instruments, files.

So a report is made anew without the bags that it was made from.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.report.charts import Band, Chart, Note, Series
from calib_solver.report.figures import (
    convergence_chart,
    joint_charts,
    quality_charts,
    residual_charts,
)
from calib_solver.report.instruments import (
    Inputs,
    certificate_rows,
    file_rows,
    instrument_rows,
    versions,
)
from calib_solver.report.workspace import workspace_charts

EVIDENCE, SCHEMA = 'report.json', 1
#: digits of what is drawn, which a screen has not
DIGITS = 6


def evidence_of(
    done: Identification, given: Inputs, held_out: HeldOut | None = None
) -> dict[str, Any]:
    """The content of `report.json`."""
    measured = done.problem.measured
    return {
        'schema': SCHEMA,
        'poses': len(done.problem.joints),
        'spheres': len(done.problem.keys),
        'locations': len(done.problem.locations),
        'gauge': measured.gauge.name,
        'probe': measured.probe.name,
        'simulated': measured.probe.simulated,
        'instruments': instrument_rows(done, held_out),
        'certificate': certificate_rows(measured.gauge),
        'files': file_rows(given),
        'versions': versions(),
        'charts': {
            'quality': chart_records(quality_charts(done, held_out)),
            'residuals': chart_records(residual_charts(done, held_out)),
            'joints': chart_records(joint_charts(done)),
            'workspace': chart_records(workspace_charts(done, held_out)),
            'convergence': chart_records([convergence_chart(done)]),
        },
    }


def evidence_text(evidence: dict[str, Any]) -> str:
    """The file's content."""
    return json.dumps(evidence, allow_nan=False) + '\n'


def charts_of(evidence: dict[str, Any], group: str) -> list[Chart]:
    """The charts of a group as they are drawn.

    Raises:
        KeyError, TypeError, ValueError: they are not what `evidence_of` makes.
    """
    return [_chart(record) for record in evidence['charts'][group]]


def chart_records(charts: list[Chart]) -> list[dict[str, Any]]:
    """Charts as `report.json` has them."""
    return [
        {**asdict(replace(chart, series=())), 'series': [_series(one) for one in chart.series]}
        for chart in charts
    ]


def _series(one: Series) -> dict[str, Any]:
    return {**vars(one), 'x': _numbers(one.x), 'y': _numbers(one.y), 'names': list(one.names)}


def _numbers(values: Array) -> list[float | None]:
    return [
        float(f'{value:.{DIGITS}g}') if np.isfinite(value) else None
        for value in np.asarray(values, dtype=float).tolist()
    ]


def _chart(record: dict[str, Any]) -> Chart:
    series = tuple(
        Series(
            **{
                **one,
                'x': np.array(one['x'], dtype=float),
                'y': np.array(one['y'], dtype=float),
                'names': tuple(one['names']),
            }
        )
        for one in record['series']
    )
    bands = tuple(Band(**one) for one in record['bands'])
    notes = tuple(Note(**one) for one in record['notes'])
    return Chart(**{**record, 'series': series, 'bands': bands, 'notes': notes})
