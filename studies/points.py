# SPDX-License-Identifier: Apache-2.0
"""What does a ball bar give against a laser tracker, pose for pose and hour for hour?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, PassiveProbe
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.transforms import RigidTransform
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.points import identify_points
from studies.running import columns, findings, over_seeds, study
from studies.scenes import (
    Noise,
    Scene,
    anywhere,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
)

ABOUT = """
A KR 5 sixx R650 off as the prior says, calibrated by a tracker that sees one target on the flange
(eq. 10) and by an active probe on a ball bar (eq. 11, eq. 13); rms error, um, of 300 predictions
anywhere, median over the seeds. The joints scatter by 0.03 mrad in every pose. A coordinate of the
laser tracker scatters by 16 um (half of 15 um + 6 um/m at 3 m), of the camera system by 60 um, of
the probe by 1 um; the gauge is off its certificate as that says. The target is where the probe's
sphere would be, its postures are anywhere between the joint limits, without a thought to the line
of sight.

An hour is 10 min for each place of the gauge and 10 s for each pose of the probe: 3 places of 4
spheres, 15 poses of each. Of a tracker it is 20 min for setting it up and 6 s for each point: 400.
"""
#: poses in all, places of the gauge, and poses of each of its 4 spheres
SETS = ((60, 3, 5), (180, 3, 15), (480, 4, 30))
HOUR, POINTS_PER_HOUR = 180, 400
NOISE = Noise(joint=3e-5, reading=1e-6)
#: m, standard deviation of a coordinate
TRACKERS = {'laser tracker, eq. 10': 16e-6, 'camera system, eq. 10': 60e-6}
GAUGES = {'ball bar, eq. 11': 'distance_repeatability', 'ball bar, eq. 13': 'distance'}
STATION = RigidTransform(np.array([2.4, -1.7, 0.6]), np.array([0.4, -0.2, 2.1]))


def errors(seed: int) -> Array:
    """rms error (m) by instrument and equation, and by set; the last is an hour's work."""
    generator = np.random.default_rng((seed, 15))
    bench = kr5()
    arm = off_as_the_prior_says(bench.arm, generator)
    mount = off_mount(bench.probe, generator)
    scenes = [
        measure(
            replace(bench, placements=bench.placements[:locations]),
            arm,
            mount,
            generator,
            poses,
            NOISE,
        )
        for _, locations, poses in SETS
    ]
    of_hour = [total for total, *_ in SETS].index(HOUR)
    found = []
    for sigma in TRACKERS.values():
        counts = (*(len(scene.measured.poses) for scene in scenes), POINTS_PER_HOUR)
        found.append([_by_tracker(scenes[0], sigma, count, generator) for count in counts])
    for objective in GAUGES.values():
        each = [_by_gauge(scene, objective) for scene in scenes]
        found.append([*each, each[of_hour]])
    return np.array(found)


def _by_gauge(scene: Scene, objective: str) -> float:
    done = identify(scene.measured, Options(objective, joint_errors=(), quick=True))
    return _rms(scene.errors(done.arm, done.probe))


def _by_tracker(scene: Scene, sigma: float, count: int, generator: np.random.Generator) -> float:
    nominal = scene.measured.arm
    q, _ = anywhere(nominal, scene.measured.probe, generator, count)
    target = np.tile(scene.mount.translation, (count, 1))
    seen = STATION.apply(scene.points(q, target)) + sigma * generator.normal(size=(count, 3))
    read = q + NOISE.joint * generator.normal(size=q.shape)
    measured = PointMeasurement(nominal, PointSet.of(read, seen))
    done = identify_points(measured, Options('position', joint_errors=(), quick=True))
    return _rms(_away(scene, done.arm, done.probe))


def _away(scene: Scene, arm: Arm, found: PassiveProbe) -> Array:
    """The error at postures anywhere with a target for the probe."""
    true = PassiveProbe('target', RigidTransform(scene.mount.translation))
    return replace(scene, mount=true.flange_T_probe).errors(arm, found)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def table(count: int) -> list[str]:
    """The lines of the study."""
    every = np.array(over_seeds(errors, range(count)))  # (seeds, methods, sets)
    middle = 1e6 * np.median(every, axis=0)
    names = [*TRACKERS, *GAUGES]
    header = ['', *(f'{total} poses' for total, *_ in SETS), 'an hour']
    rows = [
        [name, *(f'{value:.1f}' for value in row)] for name, row in zip(names, middle, strict=True)
    ]
    laser, camera, gauge, distances = middle
    claims = [
        (
            'pose for pose the ball bar tells more than the laser tracker',
            bool((gauge[:-1] < laser[:-1]).all()),
        ),
        ('hour for hour the laser tracker tells more', bool(laser[-1] < gauge[-1])),
        ('the ball bar tells more than the camera system', bool((gauge < camera).all())),
        (
            'of the same poses of the ball bar eq. 11 makes ten times as much as eq. 13, or more',
            bool((10 * gauge < distances).all()),
        ),
    ]
    return [f'{count} seeds', '', *columns(header, rows), '', *findings(claims)]


if __name__ == '__main__':
    study('points', ABOUT, 8, table)
