# SPDX-License-Identifier: Apache-2.0
"""Identify an arm from a bag and look at what is left: sphere by sphere, and the worst poses.

python examples/residuals.py [BAG]
"""

import sys

import numpy as np

from calib_model import read_measurement
from calib_solver import identify

bag = sys.argv[1] if len(sys.argv) > 1 else 'bags/demo/identification'
done = identify(read_measurement(bag))

# 2 sigma of each sphere, mm: nominal parameters, then identified ones
print('location sphere   nominal  identified')
before, after = done.initial.spheres, done.identified.spheres
for (location, sphere), nominal, identified in zip(
    after.keys, before.two_sigma.mean(axis=1), after.two_sigma.mean(axis=1), strict=True
):
    print(f'{location:8} {sphere:6} {nominal * 1e3:9.4f} {identified * 1e3:11.4f}')

# the poses furthest from their sphere's mean; rows are in the order of done.problem
away = np.linalg.norm(done.identified.deviation, axis=1)
poses = done.problem.measured.poses.take(done.problem.order)
print('\nthe five worst poses, mm')
for row in np.argsort(-away)[:5]:
    joints = ' '.join(f'{angle:7.1f}' for angle in np.degrees(poses.joints[row]))
    print(f'{poses.location[row]:8} {poses.sphere[row]:6} {away[row] * 1e3:9.4f}   {joints} deg')

for line in done.warnings:
    print('to doubt:', line)
