# SPDX-License-Identifier: Apache-2.0
"""Only the values of origins change in a URDF's text."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.errors import DescriptionError
from calib_model.transforms import RigidTransform
from calib_model.urdf.joint_origins import with_origins
from calib_model.urdf.serial_chain import read_chain

URDF = b"""<?xml version="1.0" encoding="ISO-8859-1"?>\r
<!-- <joint name="j1"><origin xyz="9 9 9"/></joint> f\xfcr den Roboter -->\r
<robot name="r">
  <link name="base"><inertial><origin xyz="1 2 3" rpy="0 0 1"/><mass value="1"/></inertial></link>
  <link name="a"><visual><origin xyz="4 5 6"/><geometry><mesh filename="a>b.stl"/></geometry></visual>
  </link>
  <link name="b"/><link name="c"/>
  <transmission name="t"><joint name="j1"><origin xyz="7 7 7"/></joint></transmission>
  <joint type="revolute"
         name="j1">
    <limit lower="-1" upper="1" velocity="1" effort="1"/>
    <parent link="base"/><child link="a"/>
    <origin  rpy = '0 0 0'
       xyz='0 0 0.5' /> <!-- 0.5 m -->
    <axis xyz="0 0 1"/>
  </joint>
  <joint name="j2" type="revolute">
    <parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/>
  </joint>
  <joint name="j3" type="fixed"><origin xyz="1 0 0"></origin><parent link="b"/><child link="c"/></joint>
</robot>
"""  # noqa: E501


def moved(x: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return RigidTransform(np.array([x, 0, 0]), np.array(turn)).matrix()


def test_nothing_but_the_origins_named_changes() -> None:
    new = with_origins(URDF, {'j1': moved(0.25), 'j2': moved(0.5), 'j3': moved(0.75)})
    expected = URDF.replace(
        b"rpy = '0 0 0'\n       xyz='0 0 0.5'", b"rpy = '0.0 0.0 0.0'\n       xyz='0.25 0.0 0.0'"
    )
    expected = expected.replace(
        b'name="j2" type="revolute">\n    ',
        b'name="j2" type="revolute">\n    <origin xyz="0.5 0.0 0.0" rpy="0.0 0.0 0.0"/>\n    ',
    )
    expected = expected.replace(
        b'<origin xyz="1 0 0">', b'<origin rpy="0.0 0.0 0.0" xyz="0.75 0.0 0.0">'
    )
    assert new == expected
    assert with_origins(URDF, {}) == URDF


@settings(max_examples=50)
@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_what_was_written_is_read_back(numbers: list[float]) -> None:
    wanted = RigidTransform(np.array(numbers[:3]), np.array(numbers[3:])).matrix()
    new = with_origins(URDF, dict.fromkeys(('j1', 'j2', 'j3'), wanted))
    for joint in read_chain(new, 'base', 'c').joints:
        np.testing.assert_allclose(joint.origin, wanted, rtol=0, atol=3e-15)


def test_a_joint_that_is_not_there_is_named() -> None:
    with pytest.raises(DescriptionError, match="my.urdf: no joint 'j9' to correct"):
        with_origins(URDF, {'j9': np.eye(4)}, 'my.urdf')


def test_text_of_wide_signs_is_refused() -> None:
    with pytest.raises(DescriptionError, match='not UTF-16'):
        with_origins('<robot/>'.encode('utf-16'), {})
