# SPDX-License-Identifier: Apache-2.0
"""The report of a finished calibration made anew, with what people know of it, and as PDF."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calib_model.descriptions import read_description
from calib_model.errors import CalibrationError
from calib_model.files import (
    FolderLock,
    file_content,
    file_hashes,
    refuse_mixture,
    write_together,
)
from calib_solver import report
from calib_solver.acceptance.paper import PAPERS, as_pdf
from calib_solver.results import Info, parse_info

PDF = 'report.pdf'


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
    record, evidence = (_read(path / name) for name in ('result.json', report.EVIDENCE))
    page = report.report_html(record, evidence, known)
    texts = {'report.html': page.encode('utf-8', 'backslashreplace')}
    if pdf:
        texts[PDF] = as_pdf(page, paper)
    files = {name: digest for name, digest in record.get('files', {}).items() if name != PDF}
    record['files'] = files | file_hashes(texts)
    text = json.dumps(record, indent=1, allow_nan=False) + '\n'
    try:
        with FolderLock(path):
            refuse_mixture(path)
            write_together(path, {**texts, 'result.json': text.encode()})
            if not pdf:
                (path / PDF).unlink(missing_ok=True)
    except OSError as error:
        raise CalibrationError(f'{folder}: cannot be written: {error.strerror}') from error
    return [path / name for name in texts]


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(file_content(path).decode('utf-8'))
    except FileNotFoundError as error:
        raise CalibrationError(
            f'{path}: there is none: the result is of a version without it, identify it anew'
        ) from error
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be read: {error.strerror}') from error
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f'{path}: not what identify writes: {error}') from error
    if not isinstance(found, dict):
        raise CalibrationError(f'{path}: not what identify writes')
    return found
