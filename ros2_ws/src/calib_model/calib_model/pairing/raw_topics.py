# SPDX-License-Identifier: Apache-2.0
"""The topics that raw streams are on."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS


@dataclass(frozen=True)
class RawTopics:
    """Where the streams are, and `joints`, the arm's in its order by the names they have there."""

    joint_states: str = JOINT_STATES.name
    displacements: str = PROBE_DISPLACEMENTS.name
    joints: tuple[str, ...] = ()
