# SPDX-License-Identifier: Apache-2.0
"""Result records as the typed fields of calib_interfaces' service answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from calib_interfaces.msg import (
    CalibrationChange,
    Diagnostics,
    DistanceQuality,
    GaugeScale,
    IdentifiedParameter,
    JointErrors,
    LeftOut,
    LeftOutGain,
    LengthQuality,
    LimitJudgement,
    MeasuringArm,
    OrientationQuality,
    ParameterChange,
    PositionQuality,
    PriorChoice,
    PriorWidth,
    ProbedSphere,
    ProbeFitReport,
    Quality,
    Readings,
    RejectedPoint,
    RejectedPose,
    RepeatabilityCorrection,
    Repetitions,
    ResampledParameter,
    Resampling,
    RigidTransform,
    SinglePointQuality,
    SolverReport,
    StandardFigures,
    StationPlace,
    TargetPlace,
    TriedJointErrors,
    TwoSigmaQuality,
)
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from calib_solver.results import Record
from calib_solver.serving import Residuals

LINE_WIDTH = 0.0008  # m


def filled(message: Any, record: Record) -> Any:
    """`message` with the values of a record of the same names.

    What a record says with null becomes NaN in a float field, and stays at the field's default in
    the others.
    """
    for name, kind in message.get_fields_and_field_types().items():
        if name not in record:
            continue
        value = record[name]
        if value is None:
            if kind in ('double', 'float'):
                setattr(message, name, math.nan)
        elif isinstance(value, list):
            setattr(message, name, [math.nan if item is None else item for item in value])
        else:
            setattr(message, name, value)
    return message


def unfilled(message: Any) -> Any:
    """`message` with NaN in all its float fields."""
    return filled(message, dict.fromkeys(message.get_fields_and_field_types()))


def quality(record: Record) -> Quality:
    """Q of the contract; what only a gauge or only orientations tell is NaN without."""
    parts = {
        'distance': DistanceQuality(),
        'two_sigma': TwoSigmaQuality(),
        'position': PositionQuality(),
        'standards': StandardFigures(),
        'orientation': OrientationQuality(),
    }
    told = {
        name: filled(part, record[name]) if record.get(name) is not None else unfilled(part)
        for name, part in parts.items()
    }
    arm = measuring_arm(record['measuring_arm'])
    return Quality(phi=record['phi'], measuring_arm=arm, **told)


def measuring_arm(record: Record | None) -> MeasuringArm:
    """The arm as a measuring arm; what could not be computed counts nothing."""
    if record is None:
        return MeasuringArm()
    return MeasuringArm(
        basis=record['basis'],
        single_point=filled(SinglePointQuality(), record['single_point'] or {}),
        length=filled(LengthQuality(), record['length'] or {}),
    )


def spheres(records: list[Record]) -> list[ProbedSphere]:
    """The probed spheres."""
    return [filled(ProbedSphere(), record) for record in records]


def parameters(records: list[Record]) -> list[IdentifiedParameter]:
    """The parameters; an unknown uncertainty is NaN."""
    return [filled(IdentifiedParameter(), record) for record in records]


def transform(record: Record) -> RigidTransform:
    """A rigid transform, m and rad."""
    return filled(RigidTransform(), record)


def solver(record: Record) -> SolverReport:
    """How the iteration went."""
    return filled(SolverReport(), record)


def probe_fit(record: Record) -> ProbeFitReport:
    """Eq. 15's account of itself."""
    return filled(ProbeFitReport(), record)


def rejected(records: list[Record]) -> list[RejectedPose]:
    """Poses left out."""
    return [filled(RejectedPose(), record) for record in records]


def rejected_points(records: list[Record]) -> list[RejectedPoint]:
    """Measured points left out."""
    return [filled(RejectedPoint(), record) for record in records]


def targets(records: list[Record]) -> list[TargetPlace]:
    """Targets on the flange; those without a measured orientation have no rotation."""
    found = [filled(TargetPlace(), record) for record in records]
    for message, record in zip(found, records, strict=True):
        message.has_rotation = record['rotation_vector'] is not None
    return found


def stations(records: list[Record]) -> list[StationPlace]:
    """The arm's base in the frame of each tracker."""
    return [filled(StationPlace(), record) for record in records]


def diagnostics(record: Record) -> Diagnostics:
    """The fit's account of itself."""
    prior = record['prior']
    widths = [filled(PriorWidth(), one) for one in prior['widths']]
    scale = filled(GaugeScale(), record['scale'] or {})
    told = {
        'orientation_noise': None,
        **record,
        'prior': PriorChoice(widths=widths),
        'scale': scale,
    }
    message = filled(Diagnostics(), told)
    message.has_scale = record['scale'] is not None
    message.prior.strength, message.prior.evidence = prior['strength'], prior['evidence']
    return message


def resampling(record: Record) -> Resampling:
    """Identifications made again; a kind that was not asked for has no repetitions."""
    kinds = {
        kind: filled(Repetitions(), record[kind] or {}) for kind in ('monte_carlo', 'bootstrap')
    }
    parameters = [filled(ResampledParameter(), one) for one in record['parameters']]
    return filled(Resampling(), {**record, **kinds, 'parameters': parameters})


def joint_errors(record: Record) -> JointErrors:
    """What D-H parameters cannot say, and what it brings."""
    tried = [
        TriedJointErrors(kind=one['kind'], identified=one['identified'], gain=left_out_gain(one))
        for one in record['tried']
    ]
    told = {**record, 'tried': tried, 'parameters': parameters(record['parameters'])}
    return filled(JointErrors(), told)


def left_out(record: Record) -> LeftOut:
    """How a calibration does on what it is not told; NaN where there are no distances."""
    nothing = {'rms': math.nan, 'stated': math.nan}
    position, distance = record['position'], record['distance'] or nothing
    message = LeftOut(by=record['by'], folds=record['folds'], factor=record['factor'])
    message.position_rms, message.position_stated = position['rms'], position['stated']
    message.distance_rms, message.distance_stated = distance['rms'], distance['stated']
    return message


def left_out_gain(record: Record | None) -> LeftOutGain:
    """A gain on locations left out; NaN where none was judged."""
    nothing = dict.fromkeys(LeftOutGain.get_fields_and_field_types(), math.nan)
    known = {key: value for key, value in (record or {}).items() if key in nothing}
    return filled(LeftOutGain(), {**nothing, **known})


def correction(record: Record) -> RepeatabilityCorrection:
    """What came of eq. 12."""
    found = {**record, 'gain': left_out_gain(record['gain'])}
    of_both = found.pop('quality') or {'identified': None, 'test': None}
    message = filled(RepeatabilityCorrection(), found)
    for name, judged in of_both.items():
        if judged is not None:
            setattr(message, name, quality(judged))
    message.has_quality = of_both['identified'] is not None
    message.has_test = of_both['test'] is not None
    return message


def readings(record: Record) -> Readings:
    """When the poses were read."""
    return filled(Readings(), record)


def limits(records: list[Record]) -> list[LimitJudgement]:
    """How a calibration stands to each limit."""
    return [filled(LimitJudgement(), record) for record in records]


def change(record: Record) -> CalibrationChange:
    """What changed from one calibration to the next."""
    there = record['positions']
    message = filled(
        CalibrationChange(),
        {
            'earlier': record['earlier'],
            'later': record['later'],
            'changed': record['verdict'] == 'changed',
            'chance': record['chance'],
            'arm_changed': record['arm']['changed'],
            'probe_changed': record['probe']['changed'],
            'position_rms': there['rms'],
            'position_max': there['max'],
            'position_standard_uncertainty': there['standard_uncertainty'],
            'max_position': there['max_position'],
            'share_beyond': there['share_beyond'],
        },
    )
    message.parameters = [filled(ParameterChange(), one) for one in record['parameters']]
    return message


def residual_markers(frame: str, shown: Sequence[Residuals], magnification: float) -> MarkerArray:
    """Residuals for RViz and Foxglove, in place of all that were there before."""
    header = Header(frame_id=frame)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, one in enumerate(shown):
        red, green, blue, opacity = one.color
        marker = Marker(
            header=header,
            ns=one.name,
            id=number,
            type=Marker.LINE_LIST,
            action=Marker.ADD,
            scale=Vector3(x=LINE_WIDTH),
            color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
            points=[Point(x=x, y=y, z=z) for x, y, z in one.lines(magnification).tolist()],
        )
        marker.pose.orientation.w = 1.0
        markers.append(marker)
    return MarkerArray(markers=markers)
