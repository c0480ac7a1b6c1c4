# SPDX-License-Identifier: Apache-2.0
"""What the launch files let be set, and what nodes and commands are given of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from calib_model.errors import ParameterError
from calib_model.topics import JOINT_STATES, JOINT_TRAJECTORY


@dataclass(frozen=True)
class Argument:
    """An argument of a launch file; with an empty default it is passed on only when given, with
    None it has to be given.

    `text` is passed on as it stands, everything else is read as YAML: 3, 0.5, true, [1, 6].
    """

    name: str
    about: str
    default: str | None = ''
    text: bool = False


UNBUFFERED = {'PYTHONUNBUFFERED': '1'}  # lines come when they are printed, not all at the end
OUTPUT = Argument('output', 'bag to write, a folder that is not there', 'capture', text=True)
NAMESPACE = Argument(
    'namespace', 'of all topics, services and actions, as robot_1; empty: none', text=True
)
PARAMETERS = Argument('params_file', 'path of a YAML file of parameters for the nodes', text=True)
REMAPPED = (
    Argument('joint_states', "topic of the arm's joint states, where it is another", text=True),
    Argument('trajectory', 'topic that the arm takes trajectories from, likewise', text=True),
)
RVIZ = Argument('rviz', 'true: show it in RViz, with robot_state_publisher')
ARM = Argument('arm', "path of the arm's YAML; empty: the KUKA KR 5 sixx R650", text=True)
DEMO = (
    Argument('variant', 'kr5, passive, iiwa14 or faro', 'kr5', text=True),
    Argument('output', 'folder for bags and results; empty: output/demo or _VARIANT', text=True),
    Argument('seed', 'of world and program', '1'),
    Argument('poses', 'per sphere; empty: as the variant has it'),
)
CAPTURE = (
    OUTPUT,
    Argument('locations', 'to visit, as [1, 2]; empty: all that have a place'),
    Argument('between_locations', 'wait, go or simulated; empty: wait', text=True),
    Argument('spheres', 'to probe, as [1, 6]; empty: four spread over the gauge'),
    Argument('poses_per_sphere', 'postures around each sphere', '60'),
    Argument('placements', 'path of a YAML file: where the gauge stands', text=True),
    Argument('taught', 'path of a YAML file that keeps taught locations', text=True),
    Argument('controller', "the arm's, by which the topic of its commands is named", text=True),
    Argument('resume', 'true: go on with the bag in output, or begin it'),
    Argument('serve', 'true: wait for goals on /capture/run and spheres on /capture/teach'),
)
SIMULATION = (
    Argument('simulate', 'false: arm and probe are there already, as hardware', 'true'),
    ARM,
    Argument('probe', "path of the probe's YAML; empty: the active trihedron", text=True),
    Argument('gauge', "path of the gauge's YAML; empty: the bar of the KR 5", text=True),
    Argument('world', 'path of a YAML: how far the truth is from all of these', text=True),
    Argument('time_scale', 'times as fast as real the arm lives; 0: stepped', '1.0'),
    Argument('seed', 'of the simulated world; -1: the one in the world file', '-1'),
)
SOLVER = (Argument('magnification', 'of the residuals on /solver/markers', '500.0'),)
REPLAY = (
    Argument('bag', "a bag's folder or .mcap file", None, text=True),
    Argument('rate', 'times as fast as recorded', '1.0'),
    Argument('loop', 'true: from the start again, until Ctrl-C'),
    Argument('clock', "true: publish the bag's time on /clock"),
)


def parameters(arguments: Iterable[Argument], given: Mapping[str, str]) -> dict[str, Any]:
    """Parameters for a node, from what a launch file was given.

    Raises:
        ParameterError: a value that is no YAML; names it.
    """
    return {
        argument.name: _value(argument, given[argument.name])
        for argument in arguments
        if given[argument.name]
    }


def remappings(given: Mapping[str, str]) -> list[tuple[str, str]]:
    """Topics that are to have another name."""
    named = (
        ('joint_states', JOINT_STATES.relative),
        ('trajectory', JOINT_TRAJECTORY.relative),
    )
    return [(topic, given[argument]) for argument, topic in named if given[argument]]


def told(arguments: Iterable[Argument], given: Mapping[str, str]) -> list[Any]:
    """All that a node is given: the file of parameters, and above it what was given by itself."""
    chosen = parameters(arguments, given)
    return [*([given[PARAMETERS.name]] if given[PARAMETERS.name] else []), chosen]


def options(arguments: Iterable[Argument], given: Mapping[str, str]) -> list[str]:
    """The same as words of a command: flags where true, else an option with its value."""
    words: list[str] = []
    for name, value in parameters(arguments, given).items():
        if value is not False:
            words += [f'--{name}'] if value is True else [f'--{name}', str(value)]
    return words


def chosen(argument: str, given: Mapping[str, str]) -> bool:
    """Whether a yes-or-no argument says yes.

    Raises:
        ParameterError: it says neither.
    """
    value = given[argument].lower()
    if value not in ('', 'true', 'false'):
        raise ParameterError(f"argument '{argument}': expected true or false, got {value!r}")
    return value == 'true'


def _value(argument: Argument, text: str) -> Any:
    if argument.text:
        return text
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ParameterError(f"argument '{argument.name}': cannot be read: {text!r}") from error
