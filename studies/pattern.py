# SPDX-License-Identifier: Apache-2.0
"""The chapter's findings on its FARO Sterling, over twenty arms."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.arrays import Array
from calib_solver.quality import Quality
from studies import faro
from studies.running import columns, findings, over_seeds, study

ABOUT = """
Tables 1 and 2 and the comparison of eqs. 11 and 13 on twenty simulated FARO Sterlings, each with
errors, encoders, gauge and operator of its own, captured in full by both probes. Means, mm:
`dist` of the distance errors, `2s` of 2 sigma (`z/xy`: of Z over the larger of X and Y), by eq. 11,
at the seven locations that identify and (`test`) the one never used; `dist13` and `2s13` by eq. 13.
"""


@dataclass(frozen=True)
class Means:
    """Mean distance error and mean 2 sigma, overall and by coordinate (3,), mm."""

    distance: float
    two_sigma: float
    xyz: Array

    @classmethod
    def of(cls, quality: Quality) -> Means:
        """The means of a quality."""
        return cls(
            faro.distance_mean(quality), faro.two_sigma_mean(quality), faro.two_sigma_xyz(quality)
        )

    @property
    def z_over_xy(self) -> float:
        """2 sigma in Z over that in X or Y, whichever is larger."""
        return float(self.xyz[2] / self.xyz[:2].max())


@dataclass(frozen=True)
class Outcome:
    """One probe on one arm, at the locations that identify and at the one never used."""

    own: Means
    test: Means
    own_13: Means
    test_13: Means


Pair = dict[str, Outcome]


def outcomes(seed: int, poses: int = faro.POSES, test_poses: int = faro.TEST_POSES) -> Pair:
    """Both probes on the arm of a seed."""
    found = {}
    for kind in faro.KINDS:
        means = []
        for objective in (faro.EQ_11, faro.EQ_13):
            done = faro.identified(kind, seed, objective, poses)
            test = faro.tested(kind, seed, objective, poses, test_poses)
            means += [Means.of(done.identified), Means.of(test)]
        found[kind] = Outcome(*means)
    faro.forget()
    return found


def claims(pair: Pair) -> dict[str, bool]:
    """What the chapter found, and whether it holds for both probes on one arm."""
    passive, active = (pair[kind] for kind in faro.KINDS)
    both = (passive, active)
    return {
        "eq. 13's mean distance error is less than half of eq. 11's where it was identified": all(
            one.own_13.distance < 0.5 * one.own.distance for one in both
        ),
        "eq. 13's mean 2 sigma is at least three times eq. 11's": all(
            one.own_13.two_sigma >= 3 * one.own.two_sigma for one in both
        ),
        'the same at the location never used': all(
            one.test_13.two_sigma >= 3 * one.test.two_sigma for one in both
        ),
        "eq. 11's mean distance error at the location never used is below eq. 13's": all(
            one.test.distance < one.test_13.distance for one in both
        ),
        'active below passive, mean distance error, Table 1': active.own.distance
        < passive.own.distance,
        'active below passive, mean distance error, Table 2': active.test.distance
        < passive.test.distance,
        'active below passive, 2 sigma in X, Y and Z, Table 1': bool(
            (active.own.xyz < passive.own.xyz).all()
        ),
        'active below passive, 2 sigma in X, Y and Z, Table 2': bool(
            (active.test.xyz < passive.test.xyz).all()
        ),
        'the passive probe has its largest mean 2 sigma in Z, Table 1': passive.own.z_over_xy > 1,
        'the passive probe has its largest mean 2 sigma in Z, Table 2': passive.test.z_over_xy > 1,
        'what the active probe gains in 2 sigma is most in Z, both tables': all(
            int((one.xyz - other.xyz).argmax()) == 2
            for one, other in ((passive.own, active.own), (passive.test, active.test))
        ),
    }


def table(count: int) -> list[str]:
    """The lines of the study."""
    found = over_seeds(outcomes, range(1, count + 1))
    rows = []
    for seed, pair in enumerate(found, start=1):
        for kind, one in pair.items():
            values = (
                one.own.distance,
                one.own.two_sigma,
                one.own.z_over_xy,
                one.test.distance,
                one.test.two_sigma,
                one.test.z_over_xy,
                one.own_13.distance,
                one.own_13.two_sigma,
                one.test_13.distance,
                one.test_13.two_sigma,
            )
            rows.append((f'{seed} {kind}', *(f'{value:.3f}' for value in values)))
    header = (
        '',
        'dist',
        '2s',
        'z/xy',
        'test dist',
        '2s',
        'z/xy',
        'dist13',
        '2s13',
        'test dist13',
        '2s13',
    )
    held = [claims(pair) for pair in found]
    said = []
    for claim in held[0]:
        times = sum(each[claim] for each in held)
        said.append((f'{times} of {count}: {claim}', times == count))
    return [*columns(header, rows), '', *findings(said), '', *_margins(found)]


def _margins(found: list[Pair]) -> list[str]:
    """The arm on which each finding holds least."""
    passive, active = ([pair[kind] for pair in found] for kind in faro.KINDS)
    repeat = min(one.own_13.two_sigma / one.own.two_sigma for one in (*passive, *active))
    general = min(one.test_13.distance / one.test.distance for one in (*passive, *active))
    pairs = list(zip(passive, active, strict=True))
    gain = [
        min(values)
        for values in (
            [one.own.distance / other.own.distance for one, other in pairs],
            [one.test.distance / other.test.distance for one, other in pairs],
        )
    ]
    steep = [min(one.own.z_over_xy for one in passive), min(one.test.z_over_xy for one in passive)]
    return [
        'On the arm on which it holds least:',
        f"eq. 13's mean 2 sigma over eq. 11's: {repeat:.1f}",
        f"eq. 13's mean distance error at the location never used over eq. 11's: {general:.1f}",
        f'passive over active, mean distance error: Table 1 {gain[0]:.2f}, Table 2 {gain[1]:.2f}',
        f'passive, 2 sigma in Z over X or Y: Table 1 {steep[0]:.2f}, Table 2 {steep[1]:.2f}',
    ]


if __name__ == '__main__':
    study('pattern', ABOUT, 20, table)
