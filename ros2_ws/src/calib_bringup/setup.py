# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'calib_bringup'


def shared(*folders: str) -> list[tuple[str, list[str]]]:
    """Every file under `folders`, to be installed in the same place under share/."""
    found: dict[str, list[str]] = {}
    for folder in folders:
        for path in sorted(Path(folder).rglob('*')):
            if path.is_file() and '__pycache__' not in path.parts:
                found.setdefault(f'share/{PACKAGE}/{path.parent}', []).append(str(path))
    return list(found.items())


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *shared('config', 'launch', 'rviz', 'foxglove', 'plotjuggler', 'security', 'data'),
    ],
    install_requires=['setuptools'],
    # signals wait until Python can answer them, as calib_model.starting says
    options={
        'build_scripts': {
            'executable': f'/usr/bin/env -S --block-signal=INT,TERM,HUP {sys.executable}'
        }
    },
    zip_safe=False,
    maintainer='Calibration maintainers',
    maintainer_email='calibration@example.com',
    description='Configuration of arms, probes and gauges, launch files',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'demo = calib_bringup.demo:main',
        ],
    },
)
