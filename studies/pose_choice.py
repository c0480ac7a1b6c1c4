# SPDX-License-Identifier: Apache-2.0
"""How many fewer poses do the work of a random choice when they are chosen by what they tell?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calib_capture.candidates import branch_names, joints_of
from calib_capture.choice import Indices, Pool, Telling, choose, information_of, log_det
from calib_capture.planner import Draft, Planner
from calib_capture.program import ProgramSettings
from calib_model.probing import Measurement, ProbingSet
from calib_model.rotation import Array
from calib_solver.identification import identify
from calib_solver.workspace import over_workspace
from studies.running import columns, over_seeds, study
from studies.scenes import Bench, Scene, kr5, off_as_the_prior_says, off_mount, reach

ABOUT = """
A KR 5 sixx R650 with an active probe, 7 locations x 4 spheres, poses of 0.02 mm noise per
coordinate. Around each sphere a pool of 360 candidates that touch nothing and can be approached:
hands spread evenly over a cap of 70 deg, all branches. `chosen`: exchanged until log det of the
information is at its plateau. `random`: drawn from the same pool. `one branch`: drawn from the
candidates of the branch that most hands of the sphere have; `20 deg`: and of a cap of 20 deg.
`bound`: what no choice of so many poses out of the pool can surpass, even if a pose could be taken
in part or more than once.

Predicted: standard uncertainty of a position anywhere in the workspace (rms), and the geometric
mean over all parameters, in units of what was known beforehand. As many random poses: how many of
them predict the same, by position and by that mean.
"""
POSES = (10, 20, 30, 40, 50, 60)
FULL = 60
POOL = 6
NOISE = 2e-5
BOUND_STEPS = 300


@dataclass(frozen=True)
class Candidates:
    """What there is to choose from: postures, seats and branches go with the rows of `pools`."""

    bench: Bench
    telling: Telling
    pools: tuple[Pool, ...]
    drafts: tuple[Draft, ...]

    def only(self, rows: Sequence[Indices]) -> tuple[Pool, ...]:
        """The pools cut down to some of their candidates."""
        pairs = zip(self.pools, rows, strict=True)
        return tuple(replace(pool, rows=pool.rows[own]) for pool, own in pairs)


@cache
def candidates(cap: float = 70.0) -> Candidates:
    """The pools of all spheres at all locations of the bench."""
    bench = kr5()
    settings = ProgramSettings(poses_per_sphere=FULL, pool=POOL, cap=np.radians(cap))
    planner = Planner(bench.arm, bench.probe, bench.gauge, settings)
    places = dict(enumerate(bench.placements, start=1))
    drafts = [planner.draft(at, n, s) for n, at in places.items() for s in bench.spheres]
    pools = [planner.pool(places[draft.location], draft) for draft in drafts]
    return Candidates(bench, planner.telling, tuple(pools), tuple(drafts))


def common_branch(given: Candidates) -> list[Indices]:
    """The candidates of each sphere that are in its most frequent branch."""
    rows = []
    for draft in given.drafts:
        joints = joints_of(draft.candidates.found, given.bench.arm.n)
        names = np.array(branch_names(given.bench.arm, joints))
        kinds, counts = np.unique(names, return_counts=True)
        rows.append(np.flatnonzero(names == kinds[np.argmax(counts)]))
    return rows


def drawn(pools: Sequence[Pool], poses: int, seed: int) -> list[Indices]:
    """So many candidates of every sphere, at random."""
    generator = np.random.default_rng((seed, poses))
    return [generator.permutation(len(pool.rows))[:poses] for pool in pools]


@dataclass(frozen=True)
class Predicted:
    """Position in m; parameters as a ratio to what was known."""

    position: float
    parameters: float


def predicted(telling: Telling, information: Array) -> Predicted:
    """What a program with this information promises."""
    parameters = np.exp(-log_det(information) / (2 * len(information)))
    return Predicted(telling.position_uncertainty(information), float(parameters))


def random_prediction(
    telling: Telling, pools: Sequence[Pool], poses: int, draws: int
) -> Predicted:
    """The mean over `draws` random programs."""
    each = [
        predicted(telling, information_of(telling, pools, drawn(pools, poses, seed)))
        for seed in range(draws)
    ]
    return Predicted(
        float(np.mean([one.position for one in each])),
        float(np.mean([one.parameters for one in each])),
    )


def bound(telling: Telling, pools: Sequence[Pool], poses: int) -> float:
    """What the parameters' mean uncertainty cannot fall below, whatever the choice.

    log det is concave in the weights of the candidates: from any weights it rises by no more than
    its slope promises at the best corner. The weights are first brought near to the best ones, by
    Titterington's multiplicative steps, so that there is little left to promise.
    """
    weights = [np.full(len(pool.rows), poses / len(pool.rows)) for pool in pools]
    for _ in range(BOUND_STEPS):
        _, told = _slopes(telling, pools, weights)
        pairs = zip(weights, told, strict=True)
        weights = [own * slope * poses / (own @ slope) for own, slope in pairs]
    total, told = _slopes(telling, pools, weights)
    promised = sum(
        poses * slope.max() - own @ slope for own, slope in zip(weights, told, strict=True)
    )
    return float(np.exp(-(log_det(total) + promised) / (2 * len(total))))


def _slopes(
    telling: Telling, pools: Sequence[Pool], weights: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """The information of weighted candidates, and how log det rises with each weight."""
    scaled = _weighted(pools, weights)
    total = information_of(telling, scaled, [np.arange(len(pool.rows)) for pool in pools])
    free = len(total)
    told: list[Array] = [np.empty(0)] * len(pools)
    for at in sorted({pool.location for pool in pools}):
        members = [i for i, pool in enumerate(pools) if pool.location == at]
        own = telling.of_location(
            [pools[i].sphere for i in members], np.array([pools[i].center for i in members]),
            [scaled[i].rows for i in members],
        )  # fmt: skip
        own[:free, :free] += total - telling.about_parameters(own)
        covariance = np.linalg.inv(own)
        for place, i in enumerate(members):
            part = telling.place_of(place)
            inner = pools[i].rows @ covariance[np.ix_(part, part)]
            told[i] = np.einsum('nkf,nkf->n', inner, pools[i].rows)
    return total, told


def _weighted(pools: Sequence[Pool], weights: Sequence[Array]) -> list[Pool]:
    return [
        replace(pool, rows=pool.rows * np.sqrt(own)[:, None, None])
        for pool, own in zip(pools, weights, strict=True)
    ]


def predictions(draws: int) -> list[str]:
    """The table of what programs promise."""
    wide, narrow = candidates(), candidates(20.0)
    telling = wide.telling
    reference = {n: random_prediction(telling, wide.pools, n, draws) for n in POSES}
    rows, every = [], {}
    for n in POSES:
        chosen = choose(telling, wide.pools, n).chosen
        programs = {
            'random': reference[n],
            'chosen': predicted(telling, information_of(telling, wide.pools, chosen)),
            'bound': Predicted(np.nan, bound(telling, wide.pools, n)),
        }
        if n in (20, FULL):
            single = wide.only(common_branch(wide))
            programs['one branch'] = random_prediction(telling, single, n, draws)
            single = narrow.only(common_branch(narrow))
            programs['one branch, 20 deg'] = random_prediction(telling, single, n, draws)
        for name, one in programs.items():
            every[n, name] = one
            rows.append([
                f'{n}', name, _shown(one.position * 1e6, 2), _shown(one.parameters * 1e3, 3),
                _shown(_as_many(reference, one, 'position'), 0),
                _shown(_as_many(reference, one, 'parameters'), 0),
            ])  # fmt: skip
    header = ['poses a sphere', 'program', 'position um', 'parameters 1e-3', 'random: position',
              'random: parameters']  # fmt: skip
    return [*columns(header, rows), '', *_conclusions(every)]


def _shown(number: float, digits: int) -> str:
    return f'{number:.{digits}f}' if np.isfinite(number) else '-'


def _conclusions(every: dict[tuple[int, str], Predicted]) -> list[str]:
    """How few chosen poses promise at least what the full programs do, by position and by mean."""
    lines = []
    for name in ('random', 'one branch', 'one branch, 20 deg'):
        full = every[FULL, name]
        enough = [
            n for n in POSES
            if every[n, 'chosen'].position <= full.position
            and every[n, 'chosen'].parameters <= full.parameters
        ]  # fmt: skip
        lines.append(f'{FULL} poses, {name}: {min(enough)} chosen ones promise as much or more')
    return lines


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
    stated = over_workspace(done).position
    return Outcome(float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(stated**2))))


def calibrations(seed: int) -> dict[str, Outcome]:
    """One truth calibrated with four programs."""
    given = candidates()
    return {
        f'{n} {name}': calibrated(
            given,
            choose(given.telling, given.pools, n).chosen if name == 'chosen'
            else drawn(given.pools, n, seed),
            seed,
        )
        for n, name in ((FULL, 'random'), (50, 'chosen'), (20, 'random'), (20, 'chosen'))
    }  # fmt: skip


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
        *predictions(count), '',
        f'Simulated calibrations by eq. 11, {count} truths: error of positions anywhere (rms; the',
        'base left free) and what the identification states (the base held where d1 and theta_0_1',
        'are).', '', *errors(count),
    ]  # fmt: skip


if __name__ == '__main__':
    study('pose_choice', ABOUT, 20, table)
