# SPDX-License-Identifier: Apache-2.0
"""What a hand-guided arm is put into: instruments, gauge locations, and a world around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from calib_model.command_line import UsageError
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    read_description,
)
from calib_model.files import shared_file
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.transforms import RigidTransform
from selfcenter_probe.simulation import Magnitudes, World, parse_magnitudes

T = TypeVar('T')
PROBES = {'passive': 'passive_seat_faro', 'active': 'active_trihedron_faro'}
#: name: the package and file it defaults to, and what it is
FILES = {
    'arm': ('calib_bringup', 'config/arms/faro_sterling.yaml', 'description of the arm'),
    'gauge': ('calib_bringup', 'config/gauges/ball_bar_1500.yaml', 'certificate of the gauge'),
    'placements': ('calib_bringup', 'config/locations/faro.yaml', 'where the gauge stands'),
    'world': ('selfcenter_probe', 'config/world_faro.yaml', 'how far the truth is from all these'),
}


@dataclass(frozen=True)
class Scene:
    """What everyone is told, and how far the truth may be from it."""

    arm: Arm
    probe: Probe
    gauge: Gauge
    placements: dict[int, RigidTransform]
    magnitudes: Magnitudes

    def world(self, seed: int) -> World:
        """The truth of that seed."""
        generator = np.random.default_rng(seed)
        return World.drawn(
            self.arm, self.probe, self.gauge, self.placements, self.magnitudes, generator
        )


def _described(package: str, file: str, given: Path | None, parse: Callable[[str, str], T]) -> T:
    """What the given file says, or the one of an installed package.

    Raises:
        DescriptionError: the file cannot be read or used.
        UsageError: no file was given and the package is not installed.
    """
    if given is not None:
        return read_description(given, parse)
    path = shared_file(package, file)
    if path is None:
        raise UsageError(f'{package} is not installed: give the path of a {file}')
    return read_description(path, parse)


def read_scene(probe: str, files: Mapping[str, Path | None]) -> Scene:
    """The scene around a probe: one of `PROBES` or the path of its description.

    `files` are paths by the names of `FILES`; what is left out or None is the installed one.

    Raises:
        DescriptionError: a file cannot be used.
        UsageError: there is no such file here.
    """

    def described(name: str, parse: Callable[[str, str], T]) -> T:
        package, file, _ = FILES[name]
        return _described(package, file, files.get(name), parse)

    named = PROBES.get(probe)
    path = None if named else Path(probe)
    return Scene(
        described('arm', parse_arm),
        _described('calib_bringup', f'config/probes/{named}.yaml', path, parse_probe),
        described('gauge', parse_gauge),
        described('placements', parse_placements),
        described('world', parse_magnitudes),
    )
