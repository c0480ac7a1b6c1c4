# SPDX-License-Identifier: Apache-2.0
import sys

from setuptools import find_packages, setup

PACKAGE = 'calib_capture'


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
    description='Moves the arm around the ball bar, pairs joints with readings, records the bag',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'arm = calib_capture.nodes.arm_node:main',
            'sim_arm = calib_capture.nodes.arm_node:main',
            'check = calib_capture.nodes.check_node:main',
            'capture = calib_capture.nodes.capture_node:main',
            'capture_points = calib_capture.nodes.points_node:main',
            'place = calib_capture.commands.place:main',
            'plan = calib_capture.commands.plan:main',
            'replay = calib_capture.nodes.replay_node:main',
            'import_csv = calib_capture.commands.import_csv:main',
            'import_points = calib_capture.commands.import_points:main',
            'recover = calib_capture.commands.recover:main',
            'pair = calib_capture.commands.pair:main',
        ],
    },
)
