# SPDX-License-Identifier: Apache-2.0
"""Spheres and locations told apart by centres that an arm not yet calibrated sees."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_model.instruments import Gauge
from calib_model.labelling.certificate_match import Certificate
from calib_model.labelling.sphere_clusters import NEAR, SphereClustering
from calib_model.labelling.sphere_numbering import numbered, renumbered
from calib_model.transforms import RigidTransform

SPHERES = (1, 6, 10, 14)
ERROR = 5e-4  # m: of the nominal arm


@pytest.fixture
def placed():
    """Three standings of a bar in an arm's reach."""
    rng = np.random.default_rng(4)
    return [
        RigidTransform(rng.uniform(-0.5, 0.5, 3), Rotation.random(rng=rng).as_rotvec())
        for _ in range(3)
    ]


def seen(gauge, visits, poses=5, error=ERROR, seed=0):
    """Where an arm sees spheres on `visits` (T_base_gauge, number), and what each pose was of."""
    rng = np.random.default_rng(seed)
    p, labels = [], []
    for placement, number in visits:
        center = placement.apply(gauge.center(number)) if placement is not None else number
        off = rng.normal(0, error / 2, 3)
        p += [center + off + rng.normal(0, error / 3, 3) for _ in range(poses)]
        labels += [(id(placement), number)] * poses
    return np.array(p), labels


def grouped(gauge, p, only=()):
    certificate = Certificate(gauge, only)
    grouping = SphereClustering(p, certificate)
    found = grouping.run()
    return found, numbered(found.locations, certificate, grouping.near), certificate


def labels_of(found, numbering, count):
    labels = [None] * count
    for number, (location, match) in enumerate(zip(found.locations, numbering.chosen, strict=True)):
        for place, sphere in zip(location.places, match.numbers, strict=True):
            for row in place.rows:
                labels[row] = (number, sphere)
    return labels


def assert_same_grouping(found, numbering, labels):
    theirs = labels_of(found, numbering, len(labels))
    order = list(dict.fromkeys(place for place, _ in labels))
    assert theirs == [(order.index(place), sphere) for place, sphere in labels]


def test_locations_and_spheres_come_in_the_order_of_probing(gauge, placed):
    p, labels = seen(gauge, [(where, n) for where in placed for n in SPHERES])
    found, numbering, _ = grouped(gauge, p)
    assert_same_grouping(found, numbering, labels)
    assert not found.strays


def test_spheres_visited_again_are_the_same_spheres(gauge, placed):
    visits = [(where, n) for where in placed for n in (1, 6, 10, 14, 10, 1, 6, 14)]
    p, labels = seen(gauge, visits)
    found, numbering, _ = grouped(gauge, p)
    assert_same_grouping(found, numbering, labels)
    assert [len(location.places) for location in found.locations] == [4, 4, 4]


def test_a_bar_turned_about_a_sphere_is_a_new_location(gauge, placed):
    """Its sphere 1 stays where it was and is the first to be probed again."""
    first = placed[0]
    turn = Rotation.from_rotvec(first.rotation_vector.copy()) * Rotation.from_rotvec([0, 0, 1.0])
    turned = RigidTransform(first.translation, turn.as_rotvec())
    p, labels = seen(gauge, [(first, n) for n in SPHERES] + [(turned, n) for n in SPHERES])
    found, numbering, _ = grouped(gauge, p)
    assert_same_grouping(found, numbering, labels)


def test_what_is_no_sphere_is_left_out_and_told(gauge, placed):
    table = np.array([0.9, 0.1, 0.05])
    visits = [
        (placed[0], 1),
        (placed[0], 6),
        (None, table),
        (placed[0], 10),
        (placed[1], 1),
        (placed[1], 6),
        (placed[1], 14),
    ]
    p, labels = seen(gauge, visits)
    found, numbering, _ = grouped(gauge, p)
    assert [len(location.places) for location in found.locations] == [3, 3]
    (stray,) = found.strays
    assert 'left out: they fit no sphere' in stray.line()
    assert ' mm from the next one seen where the certificate has ' in stray.line()
    assert np.abs(stray.place.center - table).max() < 2 * ERROR
    kept = [label for label in labels if label[0] != id(None)]
    assert [label for label in labels_of(found, numbering, len(labels)) if label] == [
        ([id(placed[0]), id(placed[1])].index(place), sphere) for place, sphere in kept
    ]


def test_a_wild_pose_takes_nothing_else_with_it(gauge, placed):
    p, _ = seen(gauge, [(placed[0], n) for n in SPHERES], poses=9)
    p[[3, 20]] += [[0.03, 0.0, 0.0], [0.0, -0.2, 0.1]]
    found, _, _ = grouped(gauge, p)
    (location,) = found.locations
    assert sorted(len(place.rows) for place in location.places) == [8, 8, 9, 9]
    assert sum(len(stray.place.rows) for stray in found.strays) == 2


def test_uneven_spheres_get_their_numbers_from_their_distances(placed):
    """Probed in any order: nothing is left to assume."""
    uneven = Gauge(
        'bar',
        0.022,
        tuple((n, (x, 0.0, 0.0)) for n, x in ((1, 0.0), (2, 0.06), (3, 0.16), (4, 0.31), (5, 0.5))),
        1e-6,
        1e-6,
    )
    p, labels = seen(uneven, [(where, n) for where in placed for n in (4, 1, 5, 2)])
    found, numbering, _ = grouped(uneven, p)
    assert_same_grouping(found, numbering, labels)
    assert not numbering.open
    assert not numbering.assumed
    assert numbering.line() == 'spheres 1 2 4 5, by their distances'


def asked(found, numbering, certificate, gauge, placed, numbers, error):
    """Renumbered by an arm that is off by `error`, with the truth that `numbers` were probed."""
    rng = np.random.default_rng(8)
    centers = [
        np.array([where.apply(gauge.center(n)) for n in numbers]) + rng.normal(0, error, (4, 3))
        for where in placed
    ]
    variance = [np.full(4, error**2)] * len(placed)
    return renumbered(numbering, certificate, centers, variance)


def test_micrometres_of_the_certificate_tell_which_spheres_of_an_even_bar_they_were(gauge, placed):
    truth = (2, 7, 11, 15)  # a step along from what is taken first
    p, labels = seen(gauge, [(where, n) for where in placed for n in truth])
    found, numbering, certificate = grouped(gauge, p)
    assert numbering.assumed
    assert numbering.numbers == (SPHERES,) * 3
    assert '--spheres' in numbering.line()
    told = asked(found, numbering, certificate, gauge, placed, truth, 2e-7)
    assert told.numbers == (truth,) * 3
    assert not told.assumed
    assert 'by the identified distances' in told.line()
    assert_same_grouping(found, told, labels)


def test_an_arm_that_sees_no_micrometres_changes_no_numbers(gauge, placed):
    p, _ = seen(gauge, [(where, n) for where in placed for n in (2, 7, 11, 15)])
    found, numbering, certificate = grouped(gauge, p)
    told = asked(found, numbering, certificate, gauge, placed, (2, 7, 11, 15), 1e-4)
    assert told.numbers == numbering.numbers
    assert told.assumed


def test_spheres_that_are_said_need_not_be_told(gauge, placed):
    truth = (2, 7, 11, 15)
    p, labels = seen(gauge, [(where, n) for where in placed for n in truth])
    found, numbering, _ = grouped(gauge, p, only=truth)
    assert_same_grouping(found, numbering, labels)
    assert not numbering.assumed


def test_the_order_of_probing_tells_the_ends_of_an_even_set(gauge, placed):
    """1, 8, 15 read from the other end are 15, 8, 1: counted upwards, until the arm sees it."""
    uneven = replace(
        gauge, spheres=tuple((n, (x + 3e-5 * (n == 8), y, z)) for n, (x, y, z) in gauge.spheres)
    )
    truth = (15, 8, 1)
    p, _ = seen(uneven, [(where, n) for where in placed for n in truth])
    found, numbering, certificate = grouped(uneven, p)
    assert numbering.numbers == ((1, 8, 15),) * 3
    assert numbering.unsure == 3
    centers = [np.array([where.apply(uneven.center(n)) for n in truth]) for where in placed]
    told = renumbered(numbering, certificate, centers, [np.full(3, 1e-13)] * 3)
    assert told.numbers == (truth,) * 3
    assert not told.assumed


def test_near_is_what_tells_neighbours_apart(gauge):
    assert SphereClustering(np.zeros((1, 3)), Certificate(gauge)).near == pytest.approx(
        0.00999, abs=1e-4
    )
    assert NEAR == 0.010
