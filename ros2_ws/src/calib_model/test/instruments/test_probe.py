# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from calib_model.errors import ContactError, DataError
from calib_model.instruments.probe import ActiveProbe, PassiveProbe, Stylus, trihedron
from calib_model.transforms import RigidTransform, rotation_matrix

DIAMETER = 0.022
STROKE = (-0.003, 0.003)


def bent_trihedron(seed: int) -> ActiveProbe:
    """Styli up to about 0.2 rad and 1.5 mm off the ideal, tips of different radii."""
    rng = np.random.default_rng(seed)
    styli = []
    for stylus in trihedron(RigidTransform()).styli:
        turn = rotation_matrix(rng.uniform(-0.12, 0.12, 3))
        origin = np.array(stylus.origin) + rng.uniform(-1.5e-3, 1.5e-3, 3)
        direction = turn @ np.array(stylus.direction)
        radius = float(rng.uniform(0.5e-3, 4e-3))
        styli.append(Stylus(tuple(origin), tuple(direction), radius, STROKE))
    return ActiveProbe('bent', RigidTransform(), tuple(styli))


@given(st.integers(0, 2**32), st.integers(0, 2**32))
def test_displacements_and_centres_are_inverse_for_any_styli(shape: int, place: int) -> None:
    probe = bent_trihedron(shape)
    centers = np.random.default_rng(place).uniform(-1.5e-3, 1.5e-3, (8, 3))
    displacement = probe.displacements(centers, DIAMETER)
    assume(np.isfinite(displacement).all())
    np.testing.assert_allclose(probe.centers(displacement, DIAMETER), centers, atol=1e-13)


@given(st.integers(0, 2**32))
def test_every_tip_touches_the_sphere_from_the_housing(shape: int) -> None:
    probe = bent_trihedron(shape)
    centers = np.random.default_rng(shape).uniform(-1.5e-3, 1.5e-3, (8, 3))
    displacement = probe.displacements(centers, DIAMETER)
    assume(np.isfinite(displacement).all())
    for i, stylus in enumerate(probe.styli):
        direction = np.array(stylus.direction) / np.linalg.norm(stylus.direction)
        tips = np.array(stylus.origin) + displacement[:, i, None] * direction
        gap = np.linalg.norm(tips - centers, axis=1) - (DIAMETER / 2 + stylus.tip_radius)
        np.testing.assert_allclose(gap, 0, atol=1e-15)
        # the sphere is in front: further into the housing there is no second contact
        assert (((tips - centers) @ direction) > 0).all()


def test_the_ideal_trihedron_reads_zero_at_its_origin_and_is_orthogonal() -> None:
    probe = trihedron(RigidTransform())
    np.testing.assert_allclose(probe.displacements(np.zeros((1, 3)), DIAMETER), 0, atol=1e-17)
    directions = np.array([stylus.direction for stylus in probe.styli])
    np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-15)
    assert np.ptp(directions[:, 2]) < 1e-15


def test_the_sphere_pushes_the_styli_in() -> None:
    pushed = trihedron(RigidTransform()).displacements(np.array([[0, 0, -1e-3]]), DIAMETER)
    assert (pushed > 0).all()


def test_the_length_of_a_direction_does_not_matter() -> None:
    ideal = trihedron(RigidTransform())
    scaled = tuple(
        Stylus(s.origin, tuple(7.0 * x for x in s.direction), s.tip_radius, s.stroke)
        for s in ideal.styli
    )
    centers = np.array([[1e-3, -5e-4, 2e-4]])
    found = ActiveProbe('scaled', RigidTransform(), scaled).displacements(centers, DIAMETER)
    np.testing.assert_allclose(found, ideal.displacements(centers, DIAMETER), atol=1e-17)


def test_a_tip_that_passes_by_reads_nan() -> None:
    probe = trihedron(RigidTransform())
    assert np.isnan(probe.displacements(np.array([[0.05, 0.0, 0.0]]), DIAMETER)).any()


def test_readings_without_a_sphere_name_their_row() -> None:
    probe = trihedron(RigidTransform())
    readings = np.zeros((4, 3))
    readings[2] = [0.5, -0.5, 0.0]
    with pytest.raises(ContactError, match=r'no sphere of that diameter .*\(reading 3 of 4\)'):
        probe.centers(readings, DIAMETER)


def test_tips_in_line_name_their_row() -> None:
    tip = Stylus((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.003, STROKE)
    others = [Stylus((x, 0.0, 0.0), (0.0, 0.0, -1.0), 0.003, STROKE) for x in (0.01, 0.02)]
    probe = ActiveProbe('flat', RigidTransform(), (tip, *others))
    with pytest.raises(ContactError, match=r'flat: .* in line \(reading 1 of 2\)'):
        probe.centers(np.zeros((2, 3)), DIAMETER)


def test_readings_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(ContactError):
        trihedron(RigidTransform()).centers(np.array([[0.0, np.nan, 0.0]]), DIAMETER)


def test_three_styli_are_needed() -> None:
    styli = trihedron(RigidTransform()).styli
    with pytest.raises(DataError, match='expected 3 styli, got 2'):
        ActiveProbe('short', RigidTransform(), styli[:2])


def test_the_stroke_is_judged_stylus_by_stylus() -> None:
    probe = trihedron(RigidTransform())
    inside = probe.within_stroke(np.array([[0.0, 0.0031, -0.0031]]))
    assert inside.tolist() == [[True, False, False]]


def test_a_passive_seat_is_always_at_its_centre() -> None:
    seat = PassiveProbe('seat', RigidTransform(), np.array([0.0, 0.1, 0.2]))
    assert seat.centers(np.zeros((4, 3)), DIAMETER).tolist() == [[0.0, 0.1, 0.2]] * 4
