# SPDX-License-Identifier: Apache-2.0
"""Where a node's descriptions come from: the path given to it, or the suite's own configuration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from calib_model.descriptions import read_description
from calib_model.errors import ParameterError
from calib_model.files import shared_file

T = TypeVar('T')
CONFIGURED_BY = 'calib_bringup'
#: parameter: the file it defaults to, and what it is
FILES = {
    'arm': ('config/arms/kuka_kr5_sixx_r650.yaml', 'arm description, nominal'),
    'probe': ('config/probes/active_trihedron.yaml', 'probe description, nominal'),
    'gauge': ('config/gauges/ball_bar_kr5.yaml', 'gauge description: the certificate'),
    'placements': ('config/locations/kr5.yaml', 'where the gauge stands, location by location'),
}


def explained(name: str) -> str:
    """What the parameter `name` is."""
    file, what = FILES[name]
    return f'path of a YAML file: {what}; empty: {file} of {CONFIGURED_BY}'


def refuse_other_arm(arm: str, placements: str = '--placements') -> None:
    """Nothing, where the shipped placements are for this arm; they are taken where none are given.

    Raises:
        ParameterError: they are not; says how to find some.
    """
    shipped = Path(FILES['arm'][0]).stem
    if arm != shipped:
        raise ParameterError(
            f'{arm}: no {placements} given, and those of {CONFIGURED_BY} are for {shipped}: find '
            'some with `ros2 run calib_capture place --arm ARM.yaml --probe PROBE.yaml --gauge '
            'GAUGE.yaml places.yaml`'
        )


def configured(name: str, given: str, parse: Callable[[str, str], T]) -> T:
    """What the file `given` for parameter `name` says, or the default's content when empty.

    Raises:
        DescriptionError: the file cannot be read or used.
        ParameterError: no file is given and there is no default.
    """
    if given:
        return read_description(given, parse)
    path = shared_file(CONFIGURED_BY, FILES[name][0])
    if path is None:
        raise ParameterError(
            f"parameter '{name}' is empty and {CONFIGURED_BY} is not installed: give a path"
        )
    return read_description(path, parse)
