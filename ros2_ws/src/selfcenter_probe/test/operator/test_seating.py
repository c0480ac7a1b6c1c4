# SPDX-License-Identifier: Apache-2.0
import numpy as np

from calib_model.kinematics import point_derivatives
from selfcenter_probe.operator.seating import reach, seated

P_FLANGE = np.array([0.0, 0.0, 0.1])


def test_the_jacobian_is_that_of_the_model(scene):
    known = point_derivatives(scene.arm, scene.joints, P_FLANGE)
    found = reach(scene.arm, scene.joints, P_FLANGE)
    np.testing.assert_allclose(found.p_base, known.p_base, atol=1e-15)
    np.testing.assert_allclose(found.jacobian, known.joints, atol=1e-15)
    np.testing.assert_allclose(found.rotation, known.flange, atol=1e-15)


def test_a_seated_point_is_where_it_should_be(scene):
    generator = np.random.default_rng(2)
    aim = reach(scene.arm, scene.joints, P_FLANGE).p_base
    start = scene.joints + generator.uniform(-0.3, 0.3, scene.joints.shape)
    q, there = seated(scene.arm, start, P_FLANGE, aim)
    assert there.all()
    assert np.abs(reach(scene.arm, q, P_FLANGE).p_base - aim).max() < 2e-12
    assert np.abs(q - start).max() > 0.01


def test_a_posture_that_is_seated_already_stays(scene):
    aim = reach(scene.arm, scene.joints, P_FLANGE).p_base
    q, there = seated(scene.arm, scene.joints, P_FLANGE, aim)
    assert there.all()
    assert np.array_equal(q, scene.joints)


def test_a_point_beyond_the_arm_is_not_reached(scene):
    _, there = seated(scene.arm, scene.joints, P_FLANGE, np.array([3.0, 0.0, 0.0]))
    assert not there.any()
