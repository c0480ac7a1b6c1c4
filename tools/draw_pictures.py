# SPDX-License-Identifier: Apache-2.0
"""Draw the pictures of README from what the demo wrote: `make demo`, then

    python tools/draw_pictures.py

The report's picture needs Chromium.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from PIL import Image

from calib_model import Measurement, read_measurement
from calib_model.arrays import Array
from calib_model.descriptions import parse_placements, read_description
from calib_model.kinematics import forward_kinematics, joint_frames
from calib_model.transforms import RigidTransform

ROOT = Path(__file__).resolve().parent.parent
DEMO = ROOT / 'output' / 'demo'
IMAGES = ROOT / 'docs' / 'images'
PLACES = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config' / 'locations' / 'kr5.yaml'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
PAGE = (900, 1270)  # px, of the proportions of A4
SHADES, WIDTH = 64, 800


def small(image: Image.Image, path: Path) -> None:
    """Write a picture of README's width with few colours."""
    height = round(image.height * WIDTH / image.width)
    image = image.convert('RGB').resize((WIDTH, height), Image.Resampling.LANCZOS)
    image.quantize(SHADES).save(path, optimize=True)
    print(f'{path.relative_to(ROOT)}: {path.stat().st_size // 1024} kB')


def draw_rig(measured: Measurement, places: dict[int, RigidTransform]) -> Image.Image:
    """The arm probing a sphere in some of its postures, and the bar wherever it stood."""
    figure = Figure(figsize=(8, 5.6), dpi=200, layout='constrained')
    axes = figure.add_subplot(projection='3d')
    assert isinstance(axes, Axes3D)
    poses = measured.poses
    for location, place in places.items():
        bar = np.array([place.apply(center) for _, center in measured.gauge.spheres])
        axes.plot(*bar[[0, -1]].T, color='0.55', linewidth=4, solid_capstyle='round')
        axes.scatter(*bar.T, color='tab:orange', s=14, depthshade=False)
        axes.text(*bar[-1], f' {location}', color='0.4')
    place = poses.location[0], poses.sphere[0]
    here = np.flatnonzero((poses.location == place[0]) & (poses.sphere == place[1]))
    for rank, row in enumerate(here[:: max(len(here) // 6, 1)]):
        line = arm_line(measured, poses.joints[row])
        shade = {'color': 'tab:blue', 'linewidth': 5} if rank == 0 else {'color': '0.75'}
        axes.plot(*line.T, solid_capstyle='round', **shade)
    axes.set(xlabel='x (m)', ylabel='y (m)', zlabel='z (m)')
    axes.set_aspect('equal')
    axes.view_init(elev=22, azim=-50)
    stream = io.BytesIO()
    figure.savefig(stream, format='png')
    return Image.open(stream)


def arm_line(measured: Measurement, q: Array) -> Array:
    """Base, joints, flange and probe (K, 3), m, of the nominal arm at q (n,)."""
    at = [np.zeros(3)]
    for frame in joint_frames(measured.arm, q[None]):
        axis, begin = frame.z_joint[0], frame.origin_joint[0]
        at += [begin, begin + axis * (axis @ (frame.origin[0] - begin))]
    flange = RigidTransform.from_matrix(forward_kinematics(measured.arm, q[None])[0])
    seat = measured.probe.flange_T_probe.translation
    return np.array([*at, flange.translation, flange.apply(seat)])


def photograph(page: Path) -> Image.Image:
    """The top of a page as a browser shows it."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit('draw_pictures: no Chromium to show the report')
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder, 'page.png')
        words = ['--headless', '--no-sandbox', '--hide-scrollbars', '--disable-gpu']
        words += [f'--window-size={PAGE[0]},{PAGE[1]}', f'--screenshot={picture}', page.as_uri()]
        subprocess.run([browser, *words], check=True, capture_output=True, timeout=120)
        image = Image.open(picture)
        image.load()
    return image


def main() -> None:
    """All three pictures."""
    measured = read_measurement(DEMO / 'identification')
    small(draw_rig(measured, read_description(PLACES, parse_placements)), IMAGES / 'rig.png')
    small(Image.open(DEMO / 'figures' / 'before_and_after.png'), IMAGES / 'before_and_after.png')
    small(photograph(DEMO / 'report.html'), IMAGES / 'report.png')


if __name__ == '__main__':
    main()
