# SPDX-License-Identifier: Apache-2.0
"""CDR bytes of the suite's messages, by way of rosbags' type system: no ROS install needed."""

from __future__ import annotations

import struct
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from calib_model.topics import (
    DISPLACEMENTS,
    JOINT_STATE,
    MEASURED_POINT,
    PROBING_POSE,
    STRING,
    TRAJECTORY,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

SLACK = 64

# the fields of the messages that bags hold, here too so that bags need no built workspace, and
# reading them not all of ROS; tests hold them equal to the .msg files and to Jazzy's types
DEFINITIONS = {
    'builtin_interfaces/msg/Time': 'int32 sec\nuint32 nanosec\n',
    'builtin_interfaces/msg/Duration': 'int32 sec\nuint32 nanosec\n',
    'std_msgs/msg/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
    STRING: 'string data\n',
    JOINT_STATE: """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
""",
    DISPLACEMENTS: """\
uint8 OK=0
uint8 NO_CONTACT=1
uint8 OVER_TRAVEL=2
uint8 WEAK_SIGNAL=3
std_msgs/Header header
float64[3] displacement
uint8[3] status
""",
    PROBING_POSE: """\
std_msgs/Header header
uint16 location
uint16 sphere
float64[] joint_position
float64[3] displacement
uint32 readings
""",
    'trajectory_msgs/msg/JointTrajectoryPoint': """\
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
""",
    TRAJECTORY: """\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
""",
    MEASURED_POINT: """\
std_msgs/Header header
string target
uint32 station
float64[] joint_position
float64[3] position
float64[4] orientation
float64 sigma
""",
}


@cache
def typestore() -> Typestore:
    """The types of `DEFINITIONS`; rosbags takes long to load, and bags of poses do without it."""
    from rosbags.typesys import get_types_from_msg
    from rosbags.typesys.store import Typestore

    store = Typestore()
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


@cache
def _all_types() -> Typestore:
    """Every type of ROS 2 Jazzy too; they take a while to load."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name in (DISPLACEMENTS, PROBING_POSE, MEASURED_POINT):
        store.register(get_types_from_msg(DEFINITIONS[name], name))
    return store


def _store_of(type_name: str) -> Typestore:
    return typestore() if type_name in DEFINITIONS else _all_types()


@cache
def schema_text(type_name: str) -> bytes:
    """A message type with its dependencies in `ros2msg` form, as MCAP schemas hold it."""
    text, _ = _store_of(type_name).generate_msgdef(type_name, ros_version=2)
    return text.encode()


@cache
def type_hash(type_name: str) -> str:
    """The type's RIHS01 hash."""
    return _store_of(type_name).hash_rihs01(type_name)


def _refuse_other_encodings(type_name: str, data: bytes) -> None:
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise ValueError(f'not a {type_name}: not plain CDR')


def text_of(data: bytes) -> str:
    """The text of a std_msgs/String, as `decode` reads it.

    Raises:
        ValueError: the bytes do not hold such a message.
    """
    _refuse_other_encodings(STRING, data)
    if len(data) < 8:
        raise ValueError(f'not a {STRING}: too short')
    (size,) = struct.unpack_from('<I' if data[1] else '>I', data, 4)
    end = 8 + size
    if size < 1 or end > len(data):
        raise ValueError(f'not a {STRING}: a text of {size} bytes in {len(data) - 8}')
    if len(data) - end > SLACK:
        raise ValueError(f'not a {STRING}: {len(data) - end} bytes too many')
    try:
        return data[8 : end - 1].decode()
    except UnicodeDecodeError as error:
        raise ValueError(f'not a {STRING}: {error}') from error


def decode(type_name: str, data: bytes) -> Any:
    """A message from its CDR bytes.

    rclpy's serialize_message leaves some bytes of its memory behind messages with empty sequences,
    and bags written with it hold them: up to `SLACK` bytes too many are let pass. (The store's own
    `deserialize_cdr` takes 3, so the definition's decoder is called here.)

    Raises:
        ValueError: the bytes do not hold such a message.
    """
    from rosbags.serde import SerdeError

    _refuse_other_encodings(type_name, data)
    store = _store_of(type_name)
    definition = store.get_msgdef(type_name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    try:
        message, end = read(data[4:], 0, definition.cls, store)
    except (SerdeError, struct.error, ValueError) as error:
        raise ValueError(f'not a {type_name}: {error}') from error
    if len(data) - 4 - end > SLACK:
        raise ValueError(f'not a {type_name}: {len(data) - 4 - end} bytes too many')
    return message


def encode(message: Any) -> bytes:
    """The CDR bytes of a message made by one of the functions below."""
    store = _store_of(message.__msgtype__)
    return bytes(store.serialize_cdr(message, message.__msgtype__))


def string(text: str) -> Any:
    """A std_msgs/String."""
    return typestore().types[STRING](data=text)


def header(stamp: int, frame: str) -> Any:
    """A std_msgs/Header of a stamp in ns."""
    types = typestore().types
    seconds, nanoseconds = divmod(int(stamp), 1_000_000_000)
    time = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
    return types['std_msgs/msg/Header'](stamp=time, frame_id=frame)


def stamp_of(message: Any) -> int:
    """A message's header stamp in ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def joint_state(stamp: int, frame: str, names: list[str], position: np.ndarray) -> Any:
    """A sensor_msgs/JointState with positions (n,) in rad."""
    empty = np.zeros(0)
    return typestore().types[JOINT_STATE](
        header=header(stamp, frame),
        name=names,
        position=np.asarray(position, dtype=np.float64),
        velocity=empty,
        effort=empty,
    )


def displacements(stamp: int, frame: str, values: np.ndarray, status: np.ndarray) -> Any:
    """A StylusDisplacements of three readings (3,) in m and their status (3,)."""
    return typestore().types[DISPLACEMENTS](
        header=header(stamp, frame),
        displacement=np.asarray(values, dtype=np.float64),
        status=np.asarray(status, dtype=np.uint8),
    )


def probing_pose(
    stamp: int,
    frame: str,
    location: int,
    sphere: int,
    joints: np.ndarray,
    values: np.ndarray,
    readings: int,
) -> Any:
    """A ProbingPose of joints (n,) in rad and mean displacements (3,) in m."""
    return typestore().types[PROBING_POSE](
        header=header(stamp, frame),
        location=location,
        sphere=sphere,
        joint_position=np.asarray(joints, dtype=np.float64),
        displacement=np.asarray(values, dtype=np.float64),
        readings=readings,
    )


def measured_point(
    stamp: int,
    frame: str,
    target: str,
    station: int,
    joints: np.ndarray,
    position: np.ndarray,
    orientation: np.ndarray,
    sigma: float,
) -> Any:
    """A MeasuredPoint: joints (n,), a position (3,) in m, a quaternion (4,) x y z w or zeros."""
    return typestore().types[MEASURED_POINT](
        header=header(stamp, frame),
        target=target,
        station=station,
        joint_position=np.asarray(joints, dtype=np.float64),
        position=np.asarray(position, dtype=np.float64),
        orientation=np.asarray(orientation, dtype=np.float64),
        sigma=float(sigma),
    )
