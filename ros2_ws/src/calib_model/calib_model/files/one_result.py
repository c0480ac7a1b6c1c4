# SPDX-License-Identifier: Apache-2.0
"""A result folder is one result: `result.json` says which files are of it, by their SHA-256."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from calib_model.errors import CalibrationError
from calib_model.files.bounded_read import file_content
from calib_model.files.held_folder import is_there

RECORD = 'result.json'
#: files that a result may lack, and that are of another one where it does not list them
OPTIONAL = ('correction.yaml', 'robot.urdf', 'report.pdf')
#: all names that a result's files may have; users keep others beside them
RESULT_FILES = (
    RECORD,
    'arm.yaml',
    'probe.yaml',
    'arm.urdf',
    'report.html',
    'report.json',
    'uncertainty.json',
    *OPTIONAL,
)


def file_hashes(contents: Mapping[str, bytes]) -> dict[str, str]:
    """What `files` of `result.json` says: names and the SHA-256 of their content."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}


def refuse_mixture(folder: str | Path) -> None:
    """Nothing, where the files of a folder are those of its `result.json`, or where that is of a
    version that does not list any.

    Raises:
        CalibrationError: one is missing, is not the one that was written with it, or was left
            there by another run; names it.
    """
    folder = Path(folder)
    try:
        record = json.loads(file_content(folder / RECORD).decode('utf-8'))
        listed = record.get('files')
    except OSError as error:
        raise CalibrationError(f'{folder / RECORD}: cannot be read: {error.strerror}') from error
    except (ValueError, AttributeError, RecursionError) as error:
        raise CalibrationError(f'{folder / RECORD}: not what identify writes') from error
    if not isinstance(listed, dict):
        return
    for name, expected in listed.items():
        path = folder / Path(str(name)).name
        try:
            found = file_hashes({name: file_content(path)})[name]
        except OSError as error:
            raise CalibrationError(
                f'{path}: cannot be read: {error.strerror}; {RECORD} beside it lists it'
            ) from error
        if found != expected:
            raise CalibrationError(
                f'{path}: not the file that {RECORD} beside it was written with: '
                'the folder holds parts of two calibrations'
            )
    for name in OPTIONAL:
        if name not in listed and is_there(folder / name):
            raise CalibrationError(
                f'{folder / name}: of another calibration, {RECORD} beside it has none'
            )
