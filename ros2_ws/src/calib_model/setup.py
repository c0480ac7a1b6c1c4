# SPDX-License-Identifier: Apache-2.0
import sys

from setuptools import find_packages, setup

PACKAGE = 'calib_model'


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
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
    description='What is measured',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'arm_from_urdf = calib_model.commands.arm_from_urdf:main',
        ],
    },
)
