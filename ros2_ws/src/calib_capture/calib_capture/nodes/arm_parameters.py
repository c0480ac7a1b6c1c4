# SPDX-License-Identifier: Apache-2.0
"""What the simulated arm is told at its start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib_capture.default_files import CONFIGURED_BY, FILES, configured, explained
from calib_capture.motion import MotionLimits, motion_limits
from calib_model.arrays import Array, frozen
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe
from calib_model.errors import ParameterError
from calib_model.files import shared_file
from calib_model.instruments import Arm
from calib_model.nodes import Parameters, unheard
from calib_model.topics import CONTROLLER

ACCELERATION, JERK = 10.0, 100.0  # rad/s^2, rad/s^3: what a small industrial arm can do
NOISE, STEP = 5e-7, 2 * np.pi / 2**21  # rad: an encoder of 21 bits
CONTROLLER_TEXT = 'name of the controller: topic and action of the commands are named by it'
START_TEXT = (
    'rad (m of a rail) of the joints to begin at; empty: zeros, or, where arm or floor would be '
    'touched there, a posture that is free'
)


@dataclass(frozen=True)
class ArmParameters:
    """What the arm is told at the start; `rate` is in Hz of the wall clock, `noise` and `step` of
    the encoders in rad of the joint; it begins at `start` (n,), None: at zero."""

    arm: Arm
    rate: float
    time_scale: float
    limits: MotionLimits
    noise: float
    step: float
    controller: str
    start: Array | None


def read_parameters(
    node: Any,
    on_rate: Callable[[float], None] = unheard,
    on_scale: Callable[[float], None] = unheard,
) -> ArmParameters:
    """Declare the arm's parameters on `node`, a Node or a Sheet.

    Raises:
        ParameterError: one of them cannot be used; names it.
        DescriptionError: the arm cannot be read.
    """
    parameters = Parameters(node)
    path = parameters.text('arm', '', explained('arm'))
    text = 'joint states per second of the wall clock'
    rate = parameters.number('rate', 250.0, text, 1.0, 1000.0, on_rate)
    text = 'how many times faster than real the arm lives, 0: stepped, as fast as can be'
    scale = parameters.number('time_scale', 1.0, text, 0.0, 1000.0, on_scale)
    text = 'rad/s^2, limit of the joints for which the description has none'
    acceleration = parameters.number('acceleration', ACCELERATION, text, 1e-3, 1e6)
    text = 'rad/s^3, limit of the joints for which the description has none'
    jerk = parameters.number('jerk', JERK, text, 1e-3, 1e9)
    text = 'rad, standard deviation of the encoders'
    noise = parameters.number('noise', NOISE, text, 0.0, 0.1)
    text = 'rad, step of the encoders, 0: none'
    step = parameters.number('step', STEP, text, 0.0, 0.1)
    controller = parameters.text('controller', CONTROLLER, CONTROLLER_TEXT)
    start = parameters.numbers('start', (), START_TEXT)
    arm = configured('arm', path, parse_arm)
    limits = motion_limits(arm, acceleration, jerk)
    begins = _begins(arm, start) if start or path else None
    return ArmParameters(arm, rate, scale, limits, noise, step, controller, begins)


def _begins(arm: Arm, start: Sequence[float]) -> Array | None:
    """The posture (n,) to begin at, None for zero."""
    if start:
        posture = frozen(start)
        if len(start) != arm.n or (posture != np.clip(posture, *arm.limits.T)).any():
            raise ParameterError(
                f"parameter 'start': expected {arm.n} joint positions within the limits of "
                f'{arm.name}, got {", ".join(f"{each:g}" for each in start)}'
            )
        return posture
    if shared_file(CONFIGURED_BY, FILES['probe'][0]) is None:
        return None
    from calib_capture.program import (
        posture_to_begin_in,  # loads what plans: not for the shipped arm
    )

    probe, gauge = configured('probe', '', parse_probe), configured('gauge', '', parse_gauge)
    return posture_to_begin_in(arm, probe, gauge)
