# SPDX-License-Identifier: Apache-2.0
"""How many fewer poses do the work of a random choice when they are chosen by what they tell?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cache
from itertools import groupby

import numpy as np

from calib_capture.motion import travel_time
from calib_capture.program import (
    Draft,
    Indices,
    Information,
    Planner,
    Pool,
    ProgramSettings,
    branch_names,
    choose,
    information_matrix,
    joints_of,
    log_det,
)
from calib_model.arrays import Array
from calib_model.measurement import Measurement, ProbingSet
from calib_solver.identification import identify
from studies.running import columns, over_seeds, paragraph, study
from studies.scenes import Bench, Scene, kr5, off_as_the_prior_says, off_mount, reach

ABOUT = """
A KR 5 sixx R650 with an active probe, 7 locations x 4 spheres, poses of 0.02 mm noise per
coordinate. Around each sphere a pool of 360 candidates that touch nothing and can be approached:
hands over a cap of 70 deg, in all branches of the arm. `chosen`: exchanged until log det of the
information is at its plateau. What it is compared with depends on what a random program is:

`one branch`      hands drawn at random, the arm bent the way it is at each sphere: the branch that
                  most of the sphere's hands have. So a program is taught, and so a controller goes
                  whose status of shoulder, elbow and wrist is given.
`nearest branch`  hands drawn at random, each in the branch that is the shortest way from the pose
                  before, as a controller goes that is free to choose.
`all branches`    drawn at random out of the pool itself, evenly over hands and branches: what this
                  suite's own program is without choosing.

`bound`: what no choice of so many poses out of the pool can surpass, even if a pose could be taken
in part or more than once.

Predicted: standard uncertainty of a position anywhere in the workspace (rms over it, and where it
is worst), and the geometric mean over all parameters, in units of what was known beforehand. As
many: how many poses drawn from all branches predict the same, by position and by that mean.
"""
POSES = (10, 20, 30, 40, 50, 60)
FULL = 60
THIRD = 20
POOL = 6
NOISE = 2e-5
BOUND_STEPS = 300


@dataclass(frozen=True)
class Candidates:
    """What there is to choose from: postures, seats and branches go with the rows of `pools`."""

    bench: Bench
    information: Information
    pools: tuple[Pool, ...]
    drafts: tuple[Draft, ...]


@cache
def candidates() -> Candidates:
    """The pools of all spheres at all locations of the bench."""
    bench = kr5()
    settings = ProgramSettings(poses_per_sphere=FULL, pool=POOL)
    planner = Planner(bench.arm, bench.probe, bench.gauge, settings)
    places = dict(enumerate(bench.placements, start=1))
    drafts = [planner.draft(at, n, s) for n, at in places.items() for s in bench.spheres]
    pools = [planner.pool(places[draft.location], draft) for draft in drafts]
    return Candidates(bench, planner.information, tuple(pools), tuple(drafts))


def all_branches(given: Candidates, poses: int, seed: int) -> list[Indices]:
    """So many candidates of every sphere, at random."""
    generator = np.random.default_rng((seed, poses))
    return [generator.permutation(len(pool.rows))[:poses] for pool in given.pools]


@cache
def _common_branch() -> list[Indices]:
    """The candidates of each sphere that are in its most frequent branch."""
    given, rows = candidates(), []
    for draft in given.drafts:
        joints = joints_of(draft.candidates.found, given.bench.arm.n)
        names = np.array(branch_names(given.bench.arm, joints))
        kinds, counts = np.unique(names, return_counts=True)
        rows.append(np.flatnonzero(names == kinds[np.argmax(counts)]))
    return rows


def one_branch(given: Candidates, poses: int, seed: int) -> list[Indices]:
    """So many candidates of the most frequent branch of every sphere, at random."""
    generator = np.random.default_rng((seed, poses))
    return [generator.permutation(rows)[:poses] for rows in _common_branch()]


def nearest_branch(given: Candidates, poses: int, seed: int) -> list[Indices]:
    """So many hands of every sphere at random, each in the branch that is nearest when its turn
    has come."""
    arm, generator = given.bench.arm, np.random.default_rng((seed, poses))
    here, rows = arm.ranges.mean(axis=1), []
    for draft in given.drafts:
        found, own = draft.candidates.found, []
        # the branches of one hand follow one another
        hands = [
            [row for row, _ in each]
            for _, each in groupby(enumerate(found), lambda pair: pair[1].p_probe_sphere.tobytes())
        ]
        for hand in generator.permutation(len(hands))[:poses]:
            ways = [travel_time(here, found[row].postures, arm.velocity) for row in hands[hand]]
            best = int(np.argmin([way.min() for way in ways]))
            own.append(hands[hand][best])
            here = found[own[-1]].postures[int(np.argmin(ways[best]))]
        rows.append(np.array(own))
    return rows


Drawn = Callable[[Candidates, int, int], list[Indices]]
RANDOM: dict[str, Drawn] = {
    'one branch': one_branch,
    'nearest branch': nearest_branch,
    'all branches': all_branches,
}


@dataclass(frozen=True)
class Predicted:
    """Position (rms and worst) in m; parameters as a ratio to what was known."""

    position: float
    worst: float
    parameters: float


def predicted(given: Candidates, rows: Sequence[Indices]) -> Predicted:
    """What a program promises."""
    information = given.information
    matrix = information_matrix(information, given.pools, rows)
    parameters = np.exp(-log_det(matrix) / (2 * len(information.table.free)))
    return Predicted(
        information.position_uncertainty(matrix),
        float(information.position_uncertainties(matrix).max()),
        float(parameters),
    )


def random_prediction(given: Candidates, draw: Drawn, poses: int, draws: int) -> Predicted:
    """The mean over `draws` random programs."""
    each = [astuple(predicted(given, draw(given, poses, seed))) for seed in range(draws)]
    return Predicted(*np.mean(each, axis=0).tolist())


def bound(information: Information, pools: Sequence[Pool], poses: int) -> float:
    """What the parameters' mean uncertainty cannot fall below, whatever the choice.

    log det is concave in the weights of the candidates: from any weights it rises by no more than
    its slope promises at the best corner. The weights are first brought near to the best ones, by
    Titterington's multiplicative steps, so that there is little left to promise.
    """
    weights = [np.full(len(pool.rows), poses / len(pool.rows)) for pool in pools]
    for _ in range(BOUND_STEPS):
        _, told = _slopes(information, pools, weights)
        pairs = zip(weights, told, strict=True)
        weights = [own * slope * poses / (own @ slope) for own, slope in pairs]
    total, told = _slopes(information, pools, weights)
    promised = sum(
        poses * slope.max() - own @ slope for own, slope in zip(weights, told, strict=True)
    )
    return float(np.exp(-(log_det(total) + promised) / (2 * len(total))))


def _slopes(
    information: Information, pools: Sequence[Pool], weights: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """The information of weighted candidates, and how log det rises with each weight."""
    scaled = _weighted(pools, weights)
    total = information_matrix(information, scaled, [np.arange(len(pool.rows)) for pool in pools])
    free = len(total)
    told: list[Array] = [np.empty(0)] * len(pools)
    for at in sorted({pool.location for pool in pools}):
        members = [i for i, pool in enumerate(pools) if pool.location == at]
        own = information.of_location(
            [pools[i].sphere for i in members],
            np.array([pools[i].center for i in members]),
            [scaled[i].rows for i in members],
        )
        own[:free, :free] += total - information.about_parameters(own)
        covariance = np.linalg.inv(own)
        for place, i in enumerate(members):
            part = information.place_of(place)
            inner = pools[i].rows @ covariance[np.ix_(part, part)]
            told[i] = np.einsum('nkf,nkf->n', inner, pools[i].rows)
    return total, told


def _weighted(pools: Sequence[Pool], weights: Sequence[Array]) -> list[Pool]:
    return [
        replace(pool, rows=pool.rows * np.sqrt(own)[:, None, None])
        for pool, own in zip(pools, weights, strict=True)
    ]


def predictions(draws: int) -> list[str]:
    """The table of what programs promise, what follows from it first."""
    given = candidates()
    reference = {n: random_prediction(given, all_branches, n, draws) for n in POSES}
    rows, every = [], {}
    for n in POSES:
        programs = {
            name: random_prediction(given, draw, n, draws)
            for name, draw in RANDOM.items()
            if n in (THIRD, FULL) and draw is not all_branches
        }
        programs['all branches'] = reference[n]
        programs['chosen'] = _chosen(given, n)
        if n in (THIRD, FULL):
            least = bound(given.information, given.pools, n)
            programs['bound'] = Predicted(np.nan, np.nan, least)
        for name, one in programs.items():
            every[n, name] = one
            rows.append(
                [
                    f'{n}',
                    name,
                    _shown(one.position * 1e6, 2),
                    _shown(one.worst * 1e6, 2),
                    _shown(one.parameters * 1e3, 3),
                    _shown(_as_many(reference, one, 'position'), 0),
                    _shown(_as_many(reference, one, 'parameters'), 0),
                ]
            )
    header = [
        'poses a sphere',
        'program',
        'position um',
        'worst um',
        'parameters 1e-3',
        'as many: position',
        'parameters',
    ]
    return [*_conclusions(given, every), '', *columns(header, rows)]


def _shown(number: float, digits: int) -> str:
    return f'{number:.{digits}f}' if np.isfinite(number) else '-'


def _conclusions(given: Candidates, every: dict[tuple[int, str], Predicted]) -> list[str]:
    """How few chosen poses promise at least what the full random programs do, in all respects."""
    told = {}
    for name in RANDOM:
        full = astuple(every[FULL, name])
        told[name] = next(
            n
            for n in range(5, FULL + 1, 5)
            if np.less_equal(astuple(_chosen(given, n)), full).all()
        )
    lines = [
        f'{FULL} random poses a sphere, {name}: {n} chosen ones ({n / FULL:.0%}) promise as much '
        'or more'
        for name, n in told.items()
    ]
    enough = [name for name, n in told.items() if n <= THIRD]
    others = [name for name in told if name not in enough]
    least = 1 - every[FULL, 'bound'].parameters / every[FULL, 'all branches'].parameters
    lines += paragraph(
        f'A third of the poses is enough against: {", ".join(enough) or "none of them"}. It is '
        f'not against: {", ".join(others) or "none of them"}. What the other branches tell no '
        'number of poses in one does; where a random program goes through them by itself there is '
        'less to be won, and out of this pool no choice, by the bound, lowers the mean over the '
        f'parameters by more than {least:.0%} against poses drawn from all of it.'
    )
    return lines


@cache
def _chosen_rows(poses: int) -> tuple[Indices, ...]:
    given = candidates()
    return choose(given.information, given.pools, poses).chosen


def _chosen(given: Candidates, poses: int) -> Predicted:
    return predicted(given, _chosen_rows(poses))


def _as_many(reference: dict[int, Predicted], one: Predicted, what: str) -> float:
    """How many random poses promise the same: uncertainty falls with the root of their number
    less the one that the sphere's centre takes."""
    found = [
        (n - 1) * (getattr(each, what) / getattr(one, what)) ** 2 + 1
        for n, each in reference.items()
    ]
    return float(np.median(found))


@dataclass(frozen=True)
class Outcome:
    """Errors of positions (rms, m): true, and as the identification states them."""

    true: float
    stated: float


def calibrated(given: Candidates, chosen: Sequence[Indices], seed: int) -> Outcome:
    """A simulated calibration with these poses by eq. 11, the truth off as the prior says."""
    bench, generator = given.bench, np.random.default_rng(seed)
    arm = off_as_the_prior_says(bench.arm, generator)
    mount = off_mount(bench.probe, generator)
    joints, seats, targets, keys = [], [], [], []
    for draft, pool, rows in zip(given.drafts, given.pools, chosen, strict=True):
        picked = [draft.candidates.found[i] for i in rows]
        joints.append(joints_of(picked, bench.arm.n))
        seats.append(np.array([each.p_probe_sphere for each in picked]))
        targets.append(np.tile(pool.center, (len(picked), 1)))
        keys += [(pool.location, pool.sphere)] * len(picked)
    seat, target = np.concatenate(seats), np.concatenate(targets)
    q, arrived = reach(arm, np.concatenate(joints), mount.apply(seat), target)
    read = seat + NOISE * generator.normal(size=seat.shape)
    location, sphere = np.array(keys)[arrived].T
    displacement = bench.probe.displacements(read[arrived], bench.gauge.sphere_diameter)
    taken = ProbingSet.of(location, sphere, q[arrived], displacement)
    measured = Measurement(bench.arm, bench.probe, bench.gauge, taken, 'simulated')
    done = identify(measured)
    off = Scene(arm, mount, measured).errors(done.arm, done.probe, seed)
    stated = done.workspace.uncertainty(done.uncertainty.covariance)
    return Outcome(float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(stated**2))))


def calibrations(seed: int) -> dict[str, Outcome]:
    """One truth calibrated with several programs."""
    given = candidates()
    found = {
        f'{FULL} {name}': calibrated(given, draw(given, FULL, seed), seed)
        for name, draw in RANDOM.items()
    }
    for n in (50, 30, THIRD):
        found[f'{n} chosen'] = calibrated(given, _chosen_rows(n), seed)
    return found


def errors(seeds: int) -> list[str]:
    """The table of what calibrations bring."""
    each = over_seeds(calibrations, range(1, seeds + 1))
    rows = []
    for program in each[0]:
        true, stated = (
            np.sqrt(np.mean([getattr(one[program], what) ** 2 for one in each])) * 1e6
            for what in ('true', 'stated')
        )
        rows.append([program, f'{true:.2f}', f'{stated:.2f}'])
    return columns(['poses a sphere', 'true error um', 'stated um'], rows)


def table(count: int) -> list[str]:
    """Both tables."""
    return [
        *predictions(count),
        '',
        f'Simulated calibrations by eq. 11, {count} truths: error of positions anywhere (rms; the',
        'base left free) and what the identification states (the base held where d1 and theta_0_1',
        'are).',
        '',
        *errors(count),
    ]


if __name__ == '__main__':
    study('pose_choice', ABOUT, 10, table)
