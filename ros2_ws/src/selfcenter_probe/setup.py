# SPDX-License-Identifier: Apache-2.0
import sys
from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'selfcenter_probe'


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml'))),
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
    description='The self-centering probe',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'probe = selfcenter_probe.nodes.probe_node:main',
            'sim_probe = selfcenter_probe.nodes.probe_node:main',
            'hand_guided = selfcenter_probe.commands.hand_guided:main',
            'operator = selfcenter_probe.nodes.operator_node:main',
        ],
    },
)
