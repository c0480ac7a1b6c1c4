# SPDX-License-Identifier: Apache-2.0
"""The report of a finished calibration made anew, with what people know of it, and as PDF."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calib_model.descriptions import read_description
from calib_model.errors import CalibrationError
from calib_model.files import (
    RESULT_FILES,
    file_hashes,
    is_there,
    refuse_mixture,
    replace_set,
)
from calib_solver import report
from calib_solver.acceptance.paper import PAPERS, as_pdf
from calib_solver.results import Info, needed_content, parse_info

PDF, RECORD = 'report.pdf', 'result.json'


def report_anew(
    folder: str, info: str = '', pdf: bool = False, paper: str = PAPERS[0]
) -> list[Path]:
    """Write `report.html` and, if wanted, `report.pdf` of the result in a folder; `info` is the
    path of a YAML file. A PDF of an earlier page is taken away. No bag is needed.

    Raises:
        CalibrationError: the folder is no result, is one of a version that kept nothing to draw
            or a mixture of several, `info` cannot be used, or there is no PDF to be had.
    """
    known = read_description(info, parse_info) if info else Info()
    path = Path(folder)
    refuse_mixture(path)
    record, evidence = (_read(path / name) for name in (RECORD, report.EVIDENCE))
    page = report.report_html(record, evidence, known)
    texts = {'report.html': page.encode('utf-8', 'backslashreplace')}
    if pdf:
        texts[PDF] = as_pdf(page, paper)
    kept = (name for name in RESULT_FILES if name != PDF and is_there(path / name))
    contents = {name: needed_content(path / name) for name in kept}
    contents |= texts
    del contents[RECORD]
    record['files'] = file_hashes(contents)
    contents[RECORD] = (json.dumps(record, indent=1, allow_nan=False) + '\n').encode()
    try:
        replace_set(path, contents, RESULT_FILES)
    except OSError as error:
        raise CalibrationError(f'{folder}: cannot be written: {error.strerror}') from error
    return [path / name for name in texts]


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(needed_content(path).decode('utf-8'))
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error
    if not isinstance(found, dict):
        raise CalibrationError(f'{path}: not what identify writes')
    return found
