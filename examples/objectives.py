# SPDX-License-Identifier: Apache-2.0
"""Compare the objectives on one measurement: each identifies, and is judged by what it never saw.

python examples/objectives.py [BAG HELD_OUT_BAG]

The chapter's point: distances alone (eq. 13) bring the distances right and leave the spread of the
poses; eq. 11, which looks at both, generalises.
"""

import sys

import numpy as np

from calib_model import read_measurement
from calib_solver import Options, assess, identify
from calib_solver.problem import Problem

bags = sys.argv[1:3] or ['bags/demo/identification', 'bags/demo/held_out']
measured, held_out = (read_measurement(bag) for bag in bags)
unseen = Problem.of(held_out)

print(f'{"mm, held out":32} distance error    2 sigma')
nominal = assess(unseen, held_out.arm, held_out.probe)
rows = [('nominal', nominal)]
for equation, name in (
    ('eq. 11', 'distance_repeatability'),
    ('eq. 13', 'distance'),
    ('eq. 10', 'position'),
):
    done = identify(measured, Options(objective=name, quick=True))
    rows.append((f'{equation}, {name}', assess(unseen, done.arm, done.probe)))
for what, quality in rows:
    distance = np.abs(quality.distance).mean() * 1e3
    print(f'{what:32} {distance:14.4f} {quality.spheres.two_sigma.mean() * 1e3:10.4f}')
