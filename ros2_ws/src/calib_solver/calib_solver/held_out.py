# SPDX-License-Identifier: Apache-2.0
"""What was measured but not identified from, to judge the identified parameters by."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib_model.descriptions import probe_yaml
from calib_model.errors import DataError
from calib_model.measurement import Measurement
from calib_model.transforms import RigidTransform
from calib_solver.identified import Identification
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess


def refuse_other_instruments(measured: Measurement, first: Measurement) -> None:
    """Nothing, when both were measured with one arm and one probe, wherever it was mounted.

    Raises:
        DataError: they were not.
    """
    if measured.arm.joint_names != first.arm.joint_names:
        raise DataError(f'{measured.source}: other joints than in {first.source}')
    if measured.probe.kind != first.probe.kind:
        raise DataError(
            f'{measured.source}: {measured.probe.kind} probe, '
            f'but {first.source} is {first.probe.kind}'
        )
    refuse_other_probe(
        replace(measured, probe=measured.probe.mounted(RigidTransform())),
        replace(first, probe=first.probe.mounted(RigidTransform())),
    )


def refuse_other_probe(measured: Measurement, first: Measurement, remedy: str = '') -> None:
    """Nothing, when the probe of both is described alike: two probes have two places on the flange.
    `remedy` ends the message.

    Raises:
        DataError: it is not; names the bag and both probes.
    """
    # a bag's probe may say that it was simulated, the one of a result does not
    told, known = (probe_yaml(replace(m.probe, simulated=False)) for m in (measured, first))
    if told == known:
        return
    if measured.probe.name == first.probe.name:
        raise DataError(
            f'{measured.source}: the probe {first.probe.name} is described in another way than in '
            f'{first.source}{remedy}'
        )
    raise DataError(
        f'{measured.source}: another probe, {measured.probe.name}, than in {first.source}, '
        f'{first.probe.name}{remedy}'
    )


@dataclass(frozen=True)
class HeldOut:
    """Held-out poses, and their quality with the parameters before and after."""

    problem: Problem
    initial: Quality
    identified: Quality
    corrected: Quality | None = None

    @classmethod
    def by(cls, measured: Measurement, done: Identification) -> HeldOut:
        """Judge `measured` with the parameters that `done` started from and what it identified;
        `corrected` is with the correction of eq. 12 too, where there is one.

        Raises:
            DataError: a pose does not fit the arm, the probe or the gauge, or it was measured
                with another arm or kind of probe.
        """
        nominal = done.problem.measured
        refuse_other_instruments(measured, nominal)
        problem = Problem.of(measured)
        corrected = done.corrected is not None
        return cls(
            problem,
            assess(problem, nominal.arm, nominal.probe),
            assess(problem, done.arm, done.probe, done.model),
            assess(problem, done.arm, done.probe, done.correction) if corrected else None,
        )
