# SPDX-License-Identifier: Apache-2.0
"""What `result.json` says of all that goes beyond the D-H parameters: joint errors and eq. 12."""

from __future__ import annotations

from typing import Protocol

from calib_model.kinematics import KINDS
from calib_solver.error_models import CorrectionChoice, Gain, JointErrorChoice
from calib_solver.fitting import ParameterEstimate
from calib_solver.identified import Identification
from calib_solver.quality import Quality
from calib_solver.results.quality import Record, quality_record


class WithJointErrors(Protocol):
    """An identification of either kind, as far as joint errors go."""

    @property
    def joint_error_choice(self) -> JointErrorChoice | None:
        """What was offered and tried."""
        ...

    @property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter."""
        ...


def estimate_record(estimate: ParameterEstimate) -> Record:
    """A parameter with its value before and after, SI."""
    return {
        'name': estimate.parameter.name,
        'unit': estimate.parameter.unit,
        'initial': estimate.parameter.nominal,
        'identified': estimate.identified,
        'standard_uncertainty': estimate.standard_uncertainty,
        'free': estimate.parameter.free,
        'identifiable': estimate.identifiable,
        'reason': estimate.reason,
    }


def joint_errors_record(done: WithJointErrors) -> Record | None:
    """Which joint errors were offered and which identified; None where none was asked for."""
    choice = done.joint_error_choice
    if choice is None:
        return None
    return {
        'offered': list(choice.offered),
        'identified': list(choice.accepted),
        'verdict': choice.lines,
        'folds': choice.folds,
        'tried': [
            {'kind': one.kind, 'identified': one.accepted, **gain_record(one.gain)}
            for one in choice.tried
        ],
        'parameters': [
            estimate_record(one) for one in done.estimates if one.parameter.kind in KINDS
        ],
    }


def correction_record(done: Identification, test: Quality | None = None) -> Record | None:
    """What came of eq. 12, None where it was not asked for; `test` is the held-out quality with
    the correction. Errors left out are rms over gauge locations not fitted to, m."""
    if done.choice_12 is None:
        return None
    record = choice_record(done.choice_12)
    if done.corrected is not None:
        record['quality'] = {
            'identified': quality_record(done.corrected),
            'test': quality_record(test) if test is not None else None,
        }
    return record


def choice_record(choice: CorrectionChoice) -> Record:
    """The same but for the quality. Measured points have neither 2 sigma nor distances."""
    record: Record = {
        'accepted': choice.accepted,
        'verdict': choice.verdict,
        'turn_harmonics': choice.turn,
        'shift_harmonics': choice.shift,
        'attitude': choice.attitude,
        'strength': choice.strength,
        'folds': choice.folds,
        'gain': None,
        'quality': None,
    }
    if choice.gain is not None:
        nothing = (None, None)
        two_sigma, distance = choice.two_sigma or nothing, choice.distance or nothing
        record['gain'] = {
            **gain_record(choice.gain),
            'two_sigma_before': two_sigma[0],
            'two_sigma_after': two_sigma[1],
            'distance_before': distance[0],
            'distance_after': distance[1],
        }
    return record


def gain_record(gain: Gain) -> Record:
    """A gain on locations left out: `change` is a ratio less 1, below zero where it helps."""
    return {
        'change': gain.ratio - 1,
        'standard_error': gain.standard_error,
        'rms_before': gain.before,
        'rms_after': gain.after,
    }
