# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from calib_capture.program.taught_spheres import (
    TaughtBook,
    TaughtSphere,
    TeachError,
    probed_sphere,
    taught_location,
)
from calib_model.descriptions import parse_placements, placements_yaml
from calib_model.errors import DataError, DescriptionError
from calib_model.instruments import Gauge
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform, nearest_rotation

pytestmark = pytest.mark.timeout(30)


def anywhere(generator):
    return RigidTransform(generator.uniform(-1, 1, 3), generator.uniform(-np.pi, np.pi, 3) / 2)


def taught(gauge, place, first=1, last=15):
    return [TaughtSphere(n, place.apply(gauge.center(n))) for n in (first, last)]


def bent(generator):
    """A gauge whose spheres are in no line, least of all along x."""
    spheres = tuple((n, tuple(generator.uniform(-0.3, 0.3, 3))) for n in range(1, 6))
    return Gauge('bent', 0.022, spheres)


@pytest.mark.parametrize('seed', range(40))
def test_taught_spheres_come_out_where_they_were_measured(gauge, seed):
    generator = np.random.default_rng(seed)
    for bar, last in ((gauge, 15), (bent(generator), 4)):
        measured = taught(bar, anywhere(generator), 2, last)
        found = taught_location(bar, 3, *measured)
        centers = found.centers(bar)
        for sphere in measured:
            assert np.abs(centers[sphere.number] - sphere.p_base_sphere).max() < 1e-12
        assert found.measured_length == pytest.approx(found.certified_length, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(40))
def test_no_turn_about_the_bar_lifts_the_z_axis_higher(gauge, seed):
    generator = np.random.default_rng(seed)
    place = anywhere(generator)
    found = taught_location(gauge, 1, *taught(gauge, place))
    height = found.T_base_gauge.rotation[2, 2]
    along = place.apply(gauge.center(15)) - place.apply(gauge.center(1))
    along /= np.linalg.norm(along)
    for angle in np.radians(np.arange(1, 360)):
        turn = RigidTransform(np.zeros(3), angle * along).rotation
        assert (turn @ found.T_base_gauge.rotation)[2, 2] <= height + 1e-12
    # z is not quite square to the line from sphere 1 to 15, so it does not quite get there
    assert height == pytest.approx(np.sqrt(1 - along[2] ** 2), abs=1e-4)


def test_all_spheres_of_a_straight_bar_are_found_whatever_its_turn_was(gauge):
    generator = np.random.default_rng(1)
    for _ in range(20):
        place = anywhere(generator)
        centers = taught_location(gauge, 1, *taught(gauge, place)).centers(gauge)
        for number in gauge.numbers:  # the spheres are up to 9 um off the line
            assert np.linalg.norm(centers[number] - place.apply(gauge.center(number))) < 2e-5


def test_an_upright_bar_turns_its_z_axis_to_the_arm(gauge):
    for down in (1.0, -1.0):
        x = np.array([0.0, 0.0, down])
        rotation = nearest_rotation(np.stack([x, [0, 1, 0], np.cross(x, [0, 1, 0])], axis=-1))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation, (0.5, 0.3, 0.4)
        found = taught_location(gauge, 1, *taught(gauge, RigidTransform.from_matrix(T)))
        z = found.T_base_gauge.rotation[:, 2]
        assert z @ -np.array([0.5, 0.3, 0.0]) / np.hypot(0.5, 0.3) > 0.999


def test_what_the_length_is_off_is_shared_by_both_ends(gauge):
    first, last = taught(gauge, RigidTransform())
    stretched = TaughtSphere(15, last.p_base_sphere + [0.0008, 0.0, 0.0])
    found = taught_location(gauge, 1, first, stretched)
    centers = found.centers(gauge)
    assert centers[1][0] - first.p_base_sphere[0] == pytest.approx(0.0004, abs=1e-9)
    assert stretched.p_base_sphere[0] - centers[15][0] == pytest.approx(0.0004, abs=1e-9)
    assert found.measured_length - found.certified_length == pytest.approx(0.0008, abs=1e-9)


@pytest.mark.parametrize('off', [-0.0021, 0.0021, 0.04, np.nan])
def test_lengths_that_disagree_are_refused_with_both(gauge, off):
    first, last = taught(gauge, RigidTransform())
    wrong = TaughtSphere(15, last.p_base_sphere + [off, 0.0, 0.0])
    with pytest.raises(TeachError, match=r'location 4: spheres 1 and 15 .* 560\.001 mm') as told:
        taught_location(gauge, 4, first, wrong)
    assert f'{(0.5600006 + off) * 1e3:.3f} mm apart' in str(told.value)
    if off == off:
        taught_location(gauge, 4, first, wrong, tolerance=abs(off) + 1e-6)


def test_one_sphere_twice_and_spheres_that_are_not_there_are_refused(gauge):
    first, _ = taught(gauge, RigidTransform())
    with pytest.raises(TeachError, match='sphere 1 was taught twice'):
        taught_location(gauge, 1, first, first)
    with pytest.raises(DataError, match='no sphere 77'):
        taught_location(gauge, 1, first, TaughtSphere(77, np.ones(3)))


def test_a_probed_sphere_is_where_the_arm_has_it(kr5, probe, gauge):
    q = np.array([0.3, 0.8, -1.0, 0.4, 0.9, -0.2])
    p_probe = np.array([0.0007, -0.0004, 0.0009])
    displacement = probe.displacements(p_probe[None], gauge.sphere_diameter)[0]
    found = probed_sphere(kr5, probe, gauge, 6, q, displacement)
    T_base_probe = forward_kinematics(kr5, q[None])[0] @ probe.flange_T_probe.matrix()
    expected = T_base_probe[:3, :3] @ p_probe + T_base_probe[:3, 3]
    assert found.number == 6
    assert np.abs(found.p_base_sphere - expected).max() < 1e-12
    with pytest.raises(DataError, match='no sphere 99'):
        probed_sphere(kr5, probe, gauge, 99, q, displacement)


def test_a_taught_place_reads_back_bit_for_bit(gauge, placements):
    found = taught_location(gauge, 5, *taught(gauge, anywhere(np.random.default_rng(3))))
    again = parse_placements(found.yaml())[5]
    assert np.array_equal(again.translation, found.T_base_gauge.translation)
    assert np.array_equal(again.rotation_vector, found.T_base_gauge.rotation_vector)
    read = parse_placements(placements_yaml(placements))
    assert list(read) == list(placements)
    assert all(np.array_equal(read[n].matrix(), placements[n].matrix()) for n in placements)


def test_taught_locations_are_kept_whole_or_not_and_read_again(tmp_path):
    places = {n: anywhere(np.random.default_rng(n)) for n in (7, 2)}
    book = TaughtBook(str(tmp_path / 'new' / 'taught.yaml'))
    assert book.read() == {}
    assert book.write(places, 'base') == f'kept in {book.path}'
    again = book.read()
    assert sorted(again) == [2, 7]
    for number, place in places.items():
        assert np.array_equal(again[number].matrix(), place.matrix())
    book.write({}, 'base')  # what is taught anew holds no more
    assert book.read() == {}
    assert list((tmp_path / 'new').iterdir()) == []


def test_a_book_that_cannot_be_written_or_read_says_so_and_keeps_what_it_has(tmp_path):
    place = {1: anywhere(np.random.default_rng(1))}
    (tmp_path / 'file').write_text('locations: nonsense')
    with pytest.raises(DescriptionError, match='locations'):
        TaughtBook(str(tmp_path / 'file')).read()
    with pytest.raises(TeachError, match='taught, but .* cannot be written'):
        TaughtBook(str(tmp_path / 'file' / 'taught.yaml')).write(place, 'base')
    assert 'not kept' in TaughtBook('').write(place, 'base')
