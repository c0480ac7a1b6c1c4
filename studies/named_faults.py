# SPDX-License-Identifier: Apache-2.0
"""What was wired, counted or written down wrong: is it named, or does it do harm in silence?"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import CalibrationError
from calib_model.measurement import Measurement
from calib_solver.identification import identify
from calib_solver.identified import Identification
from calib_solver.problem import Problem
from calib_solver.quality import assess
from studies.robustness import moved
from studies.running import columns, over_seeds, study
from studies.scenes import (
    CONFIG,
    LOCATIONS,
    SPHERES,
    Noise,
    Scene,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
)

ABOUT = """
A KR 5 sixx R650 and an LBR iiwa 14 with an active probe, 7 locations x 4 spheres x 20 poses with
noise; six locations identify the arm, the seventh is held out. Each fault comes with a joint, a
stylus, a sphere, a sign and a moment of its own in every seed. `named`: the calibration refuses, or
a warning says what is wrong and where. `other`: there is a warning, of something else or without
saying where. `silent`: there is none; `harm` is the worst rms error of the held-out poses then,
against that of the same arm identified without the fault (a fault that lasts is in them, too).
"""
ARMS = ('kuka_kr5_sixx_r650', 'kuka_lbr_iiwa14')
POSES = 20
HELD_OUT = LOCATIONS

#: a measurement with a fault, and what a line that names it has in it
Spoilt = tuple[Measurement, str]
Spoil = Callable[[Scene, Measurement, np.random.Generator], Spoilt]
FAULTS: dict[str, Spoil] = {}
#: faults that last: the held-out poses have them, too
LASTING = ('exchanged', 'reversed', 'degrees', 'zero', 'gain', 'diameter', 'jumps', 'number', 'end')


def fault(name: str) -> Callable[[Spoil], Spoil]:
    """Enter a fault under its name."""

    def enter(spoil: Spoil) -> Spoil:
        FAULTS[name] = spoil
        return spoil

    return enter


def _read(measured: Measurement, displacement: Array) -> Measurement:
    return replace(measured, poses=replace(measured.poses, displacement=displacement))


def _turned(measured: Measurement, joints: Array) -> Measurement:
    return replace(measured, poses=replace(measured.poses, joints=joints))


@fault('a stylus stuck')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    stylus, read = rng.integers(3), np.array(measured.poses.displacement)
    read[:, stylus] = rng.uniform(-1e-3, 1e-3)
    return _read(measured, read), f'stylus {stylus + 1} reads'


@fault('a stylus stuck from some pose on')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    stylus, read = rng.integers(3), np.array(measured.poses.displacement)
    first = int(rng.uniform(0.25, 0.8) * len(read))
    read[first:, stylus] = read[first, stylus]
    return _read(measured, read), f'stylus {stylus + 1} reads'


@fault('styli exchanged')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    (i, j), read = sorted(rng.choice(3, 2, replace=False)), np.array(measured.poses.displacement)
    read[:, [i, j]] = read[:, [j, i]]
    return _read(measured, read), f'styli {i + 1} and {j + 1} exchanged'


@fault('a stylus reversed')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    stylus, read = rng.integers(3), np.array(measured.poses.displacement)
    read[:, stylus] *= -1
    return _read(measured, read), f'sign of stylus {stylus + 1} reversed'


def _gain(size: float) -> Spoil:
    def spoil(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
        stylus, read = rng.integers(3), np.array(measured.poses.displacement)
        read[:, stylus] *= 1 + size * rng.choice((-1, 1))
        return _read(measured, read), f'stylus {stylus + 1} reads .* too'

    return spoil


for _size in (0.005, 0.02, 0.1):
    FAULTS[f'a gain {_size * 100:g} % off'] = _gain(_size)


@fault('the diameter for the radius of tip and sphere')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    gauge = measured.gauge
    wrong = replace(gauge, sphere_diameter=2 * gauge.sphere_diameter)
    return replace(measured, gauge=wrong), 'made for spheres of about 22 mm, those of .* have 44 mm'


def _jump(size: float) -> Spoil:
    def spoil(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
        joint, q = rng.integers(measured.arm.n), np.array(measured.poses.joints)
        q[int(rng.uniform(0.15, 0.85) * len(q)) :, joint] += size * rng.choice((-1, 1))
        return _turned(measured, q), f'{measured.arm.joint_names[joint]} .*jumped'

    return spoil


for _size in (0.2e-3, 2e-3, 20e-3, 0.2):
    FAULTS[f'an encoder jumps by {_size * 1e3:g} mrad'] = _jump(_size)


@fault('an encoder jumps by 5 mrad and back')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    joint, q = rng.integers(measured.arm.n), np.array(measured.poses.joints)
    q[int(0.4 * len(q)) : int(0.6 * len(q)), joint] += 5e-3
    return _turned(measured, q), f'{measured.arm.joint_names[joint]} .*jumped'


@fault('two joints exchanged')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    i, j = sorted(rng.choice(measured.arm.n, 2, replace=False))
    names, q = measured.arm.joint_names, np.array(measured.poses.joints)
    q[:, [i, j]] = q[:, [j, i]]
    return _turned(measured, q), f'{names[i]} and {names[j]} exchanged'


@fault('a joint reversed')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    joint, q = rng.integers(measured.arm.n), np.array(measured.poses.joints)
    q[:, joint] *= -1
    return _turned(measured, q), f'joint {measured.arm.joint_names[joint]} counted the other way'


@fault('a joint counted from a zero 90 deg away')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    joint, q = rng.integers(measured.arm.n), np.array(measured.poses.joints)
    q[:, joint] += np.pi / 2
    name = measured.arm.joint_names[joint]
    return _turned(measured, q), f'-90 deg added to joint {name}|theta_0_{joint + 1} by'


@fault('a joint in degrees')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    joint, q = rng.integers(measured.arm.n), np.array(measured.poses.joints)
    q[:, joint] *= 180 / np.pi
    return _turned(measured, q), f'joint {measured.arm.joint_names[joint]} taken as degrees'


@fault('all joints in degrees')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    return _turned(measured, np.degrees(measured.poses.joints)), 'positions taken as degrees'


@fault('mm for m in the readings')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    return _read(measured, 1e3 * np.array(measured.poses.displacement)), 'mm for m'


@fault('mm for m on the certificate')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    return _certified(measured, lambda number, center: 1e3 * center), 'both in m'


def _certified(measured: Measurement, change: Callable[[int, Array], Array]) -> Measurement:
    gauge = measured.gauge
    spheres = tuple((n, tuple(change(n, np.array(center)))) for n, center in gauge.spheres)
    return replace(measured, gauge=replace(gauge, spheres=spheres))


def _misplaced(size: float) -> Spoil:
    def spoil(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
        sphere, along = rng.choice(SPHERES), np.array([size * rng.choice((-1, 1)), 0, 0])
        wrong = _certified(measured, lambda number, center: center + along * (number == sphere))
        return wrong, f'sphere {sphere} is .* on the certificate'

    return spoil


for _size in (0.05e-3, 0.2e-3, 2e-3):
    FAULTS[f'a certified sphere {_size * 1e3:g} mm off'] = _misplaced(_size)


@fault('a certificate 0.1 % too long')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    return _certified(measured, lambda number, center: 1.001 * center), 'wrong in scale'


@fault('a certificate 2 % too long')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    return _certified(measured, lambda number, center: 1.02 * center), 'wrong in scale'


def _pushed(size: float) -> Spoil:
    def spoil(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
        poses, location = measured.poses, int(rng.integers(1, HELD_OUT))
        here = np.flatnonzero(poses.location == location)
        first = here[int(rng.uniform(0.1, 0.9) * len(here))]
        bad = (poses.location == location) & (np.arange(len(poses)) >= first)
        push = rng.normal(size=3)
        shift = np.tile(size * push / np.linalg.norm(push), (int(bad.sum()), 1))
        wrong = replace(measured, poses=moved(scene, poses, bad, shift))
        return wrong, f'location {location}[:,].*(gauge moved|sphere)'

    return spoil


for _size in (0.1e-3, 1e-3):
    FAULTS[f'the gauge pushed by {_size * 1e3:g} mm in mid-location'] = _pushed(_size)


def _renumbered(where: str, count: Callable[[Array], Array]) -> Spoil:
    def spoil(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
        poses, location = measured.poses, rng.integers(1, HELD_OUT)
        there = (poses.location == location) if where == 'one' else True
        sphere = np.where(there, count(np.array(poses.sphere)), poses.sphere)
        return replace(measured, poses=replace(poses, sphere=sphere)), 'sphere number|other end'

    return spoil


FAULTS['numbers one too high at one location, even bar'] = _renumbered('one', lambda k: k + 1)
FAULTS['every number one too high, even bar'] = _renumbered('every', lambda k: k + 1)
FAULTS['counted from the other end at one location, even bar'] = _renumbered(
    'one', lambda k: 16 - k
)


@fault('two spheres of a location exchanged')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    poses, location = measured.poses, rng.integers(1, HELD_OUT)
    one, two = rng.choice(SPHERES, 2, replace=False)
    here, sphere = poses.location == location, np.array(poses.sphere)
    sphere[here & (poses.sphere == one)] = two
    sphere[here & (poses.sphere == two)] = one
    wrong = replace(measured, poses=replace(poses, sphere=sphere))
    return wrong, f'location {location}: sphere .*mislabelled'


@fault('two locations under one number')
def _(scene: Scene, measured: Measurement, rng: np.random.Generator) -> Spoilt:
    poses = measured.poses
    one, two = rng.choice(np.arange(1, HELD_OUT), 2, replace=False)
    location = np.where(poses.location == two, one, poses.location)
    wrong = replace(measured, poses=replace(poses, location=location))
    return wrong, 'two places under one location number'


@dataclass(frozen=True)
class Outcome:
    """Whether a fault was named, whether there was any other line, and the harm it did."""

    named: bool
    other: bool
    harm: float


def outcomes(seed: int) -> dict[str, list[Outcome]]:
    """Every fault on every arm."""
    found: dict[str, list[Outcome]] = {name: [] for name in ('none', *FAULTS)}
    for arm in ARMS:
        scene = _scene(arm, seed)
        measured, held_out = scene.held_out(HELD_OUT)
        done = identify(measured)
        best = _error(held_out, done)
        found['none'].append(Outcome(True, bool(done.warnings), 1.0))
        for number, (name, spoil) in enumerate(FAULTS.items()):
            key = (seed, 8, number)
            wrong, pattern = spoil(scene, measured, np.random.default_rng(key))
            judged = [held_out]
            if any(word in name for word in LASTING):
                judged.append(_as_it_lasts(name, scene, wrong, measured, held_out, key))
            try:
                done = identify(wrong)
                lines = [*done.warnings, *(one.reason for one in done.rejected)]
                harm = min(_error(each, done) for each in judged) / best
            except CalibrationError as error:
                lines, harm = [str(error)], np.inf
            named = any(re.search(pattern, line) for line in lines)
            found[name].append(Outcome(named, bool(lines), harm))
    return found


def _as_it_lasts(
    name: str,
    scene: Scene,
    wrong: Measurement,
    right: Measurement,
    held_out: Measurement,
    key: tuple[int, ...],
) -> Measurement:
    """The held-out poses with the fault as the measurement ended with it."""
    if 'jumps' in name:
        step = wrong.poses.joints[-1] - right.poses.joints[-1]
        return _turned(held_out, held_out.poses.joints + step)
    return FAULTS[name](scene, held_out, np.random.default_rng(key))[0]


def _error(judged: Measurement, done: Identification) -> float:
    try:
        position = assess(Problem.of(judged), done.arm, done.probe).position
    except CalibrationError:
        return float('inf')
    return float(np.sqrt(np.mean(position**2)))


def _scene(name: str, seed: int) -> Scene:
    arm = read_description(CONFIG / f'arms/{name}.yaml', parse_arm)
    bench = replace(kr5(), arm=arm)
    rng = np.random.default_rng((seed, 7))
    true, mount = off_as_the_prior_says(arm, rng), off_mount(bench.probe, rng)
    return measure(bench, true, mount, rng, POSES, Noise())


def table(count: int) -> list[str]:
    """The lines of the study."""
    found = over_seeds(outcomes, range(count))
    rows = []
    for name in ('none', *FAULTS):
        of = [one for each in found for one in each[name]]
        silent = [one.harm for one in of if not one.named and not one.other]
        rows.append(
            [
                name,
                '-' if name == 'none' else str(sum(one.named for one in of)),
                str(sum(one.other and (name == 'none' or not one.named) for one in of)),
                '-' if name == 'none' else str(len(silent)),
                f'{max(silent):.2f}' if silent else '',
            ]
        )
    header = ['', 'named', 'other', 'silent', 'harm']
    return [f'{count} seeds, {2 * count} calibrations a fault', '', *columns(header, rows)]


if __name__ == '__main__':
    study('named_faults', ABOUT, 6, table)
