# SPDX-License-Identifier: Apache-2.0
"""A URDF's serial chain as Denavit-Hartenberg parameters, held against the URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib_model.errors import DescriptionError
from calib_model.files import file_content
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics
from calib_model.urdf.denavit_hartenberg import arm_of_chain
from calib_model.urdf.serial_chain import SerialChain, read_chain

POSTURES = 100
EXACT = 1e-9  # m and rad


def arm_from_urdf(
    text: str | bytes, base: str = '', flange: str = '', source: str = 'URDF', name: str = ''
) -> Arm:
    """The arm of a URDF text, its forward kinematics held against the URDF's.

    Raises:
        DescriptionError: not a URDF, or no serial arm of moving joints from `base` to `flange`.
    """
    chain = read_chain(text, base, flange, source)
    arm = arm_of_chain(chain, name)
    off = largest_difference(arm, chain)
    if not off < EXACT:
        raise DescriptionError(source, '', f'its D-H parameters are {off:.2g} m off the URDF')
    return arm


def largest_difference(arm: Arm, chain: SerialChain) -> float:
    """By how much the flange poses of arm and chain differ at random postures: any element, m."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES, arm.n))
    expected = np.array([chain.forward(posture) for posture in q])
    return float(np.abs(forward_kinematics(arm, q) - expected).max())


def read_urdf(path: str | Path) -> bytes:
    """A URDF file's content, as it is.

    Raises:
        DescriptionError: it cannot be read.
    """
    try:
        return file_content(path)
    except OSError as error:
        raise DescriptionError(str(path), '', f'cannot be read: {error.strerror}') from error
