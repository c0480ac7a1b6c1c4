# SPDX-License-Identifier: Apache-2.0
"""Arms with errors that D-H parameters cannot say: does what is stated cover them?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import read_links
from calib_model.instruments import Arm
from calib_model.kinematics import (
    DEFAULT_SIGMA,
    CorrectedArm,
    Correction,
    JointErrors,
    JointTerms,
    Links,
)
from calib_solver.fitting import Options
from calib_solver.identification import identify
from studies.running import columns, over_seeds, study
from studies.scenes import (
    CONFIG,
    Noise,
    Scene,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
    unseen_distances,
)

ABOUT = """
A KR 5 sixx R650 with an active probe, 7 locations x 4 spheres x 20 poses with noise, every
parameter off as the prior says, and: encoders that sit eccentric (0.1 mrad, standard deviation of
either harmonic), joints that bend under the arm's weight (20 urad/(N m)), or backlash (0.2 mrad
from end to end, on either side by chance). rms errors of distances between points anywhere, mm,
and what is stated of them; per cent of the stated 95 % intervals that hold; what is said of a
place never probed, and by what factor the stated uncertainties grew for it; in how many of the
calibrations joint errors were identified; `quiet`: in how many less than 88 % hold and no line
says so. `no joint errors` leaves them out: what is stated has to cover them.
"""
POSES = 20
PAIRS = 300
WITHIN = 1.959964
#: intervals that hold less often than that are to be told of
ENOUGH = 0.88
ENCODER, COMPLIANCE, BACKLASH = 1e-4, 2e-5, 2e-4
CASES = ('none', 'encoders', 'bending', 'backlash')
CHOICES = {
    'as it comes': Options(),
    'no joint errors': Options(joint_errors=()),
    'links known': Options(),
}


@dataclass(frozen=True)
class Outcome:
    """Errors of distances (PAIRS,), what is stated of them, m, what was judged at places left out
    and stated there (m), the factor, and how many joint errors were identified."""

    off: Array
    stated: Array
    left_out: tuple[float, float]
    factor: float
    identified: int


def true_errors(case: str, arm: Arm, links: Links, generator: np.random.Generator) -> JointErrors:
    """What the arm's joints do beyond their encoders' readings."""
    encoder = ENCODER * generator.normal(size=(2, arm.n)) * (case == 'encoders')
    if case != 'bending':
        return JointErrors(JointTerms(1), encoder)
    compliance = np.abs(COMPLIANCE * generator.normal(size=(1, arm.n)))
    return JointErrors(JointTerms(0, links), compliance)


def scene_of(case: str, seed: int) -> tuple[Scene, Correction]:
    """A calibration of an arm with such errors."""
    bench = kr5()
    links = read_links(CONFIG / 'links/kuka_kr5_sixx_r650.yaml', bench.arm)
    generator = np.random.default_rng((seed, 15))
    arm = off_as_the_prior_says(bench.arm, generator)
    sigma = DEFAULT_SIGMA['probe_translation'], DEFAULT_SIGMA['probe_rotation']
    mount = off_mount(bench.probe, generator, *sigma)
    errors = Correction(arm.joint_names, true_errors(case, arm, links, generator))
    scene = measure(bench, arm, mount, np.random.default_rng((seed, 16)), POSES, Noise())
    there = scene.measured.poses.joints
    read = there
    for _ in range(4):  # what the encoders read where the joints are there
        read = read + there - errors.joints(arm, read)
    if case == 'backlash':
        read = read + BACKLASH / 2 * generator.choice((-1.0, 1.0), size=read.shape)
    poses = replace(scene.measured.poses, joints=read)
    return replace(scene, measured=replace(scene.measured, poses=poses)), errors


def outcomes(given: tuple[str, int]) -> list[Outcome]:
    """By every choice."""
    case, seed = given
    scene, errors = scene_of(case, seed)
    links = read_links(CONFIG / 'links/kuka_kr5_sixx_r650.yaml', scene.arm)
    return [
        outcome(scene, errors, replace(options, links=links if name == 'links known' else None))
        for name, options in CHOICES.items()
    ]


def outcome(scene: Scene, errors: Correction, options: Options) -> Outcome:
    """One calibration judged by distances between points anywhere."""
    done = identify(scene.measured, options)
    true = CorrectedArm(scene.arm, errors)

    def seated(q: Array, centers: Array) -> Array:
        return true.points(q, scene.mount.apply(centers))

    off, stated = unseen_distances(done, seated, np.random.default_rng(1), PAIRS)
    judged = done.left_out
    assert judged is not None
    choice = done.joint_error_choice
    return Outcome(
        off,
        stated,
        (judged.position.rms, judged.position.stated),
        judged.factor,
        len(choice.accepted) if choice is not None else 0,
    )


def table(count: int) -> list[str]:
    """The lines of the study."""
    rows = []
    for case in CASES:
        every = over_seeds(outcomes, [(case, seed) for seed in range(count)])
        for number, name in enumerate(CHOICES):
            of = [each[number] for each in every]
            off, stated = np.array([o.off for o in of]), np.array([o.stated for o in of])
            held = np.abs(off) < WITHIN * stated
            missed = [o for o, share in zip(of, held.mean(axis=1), strict=True) if share < ENOUGH]
            judged = np.sqrt(np.mean(np.square([o.left_out for o in of]), axis=0))
            rows.append(
                [
                    f'{case}, {name}',
                    f'{1e3 * _rms(off):.4f}',
                    f'{1e3 * _rms(stated):.4f}',
                    f'{100 * held.mean():.1f}',
                    f'{100 * held.mean(axis=1).min():.0f}',
                    f'{1e3 * judged[0]:.4f}',
                    f'{1e3 * judged[1]:.4f}',
                    f'{np.median([o.factor for o in of]):.2f}',
                    f'{sum(o.identified > 0 for o in of)}',
                    f'{sum(o.factor == 1 for o in missed)}',
                ]
            )
    head = [
        '',
        'error',
        'stated',
        'holds %',
        'least',
        'left out',
        'stated',
        'factor',
        'identified',
        'quiet',
    ]
    return [f'{count} calibrations of each kind', '', *columns(head, rows)]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == '__main__':
    study('model_errors', ABOUT, 50, table)
