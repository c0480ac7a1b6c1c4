# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

PACKAGE = 'calib_solver'


def kernel() -> list[Extension]:
    """The compiled inner loop; without a compiler the package installs without it."""
    source = Path(PACKAGE, 'problem', '_kernel.c')
    if not source.exists():
        return []
    return [
        Extension(
            f'{PACKAGE}.problem._kernel',
            [str(source)],
            depends=[str(source.with_name(f'_kernel_{part}.h')) for part in ('pass', 'points')],
            extra_compile_args=['-O3'],
            optional=True,
        )
    ]


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed'], f'{PACKAGE}.report': ['*.j2', '*.css']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    ext_modules=kernel(),
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
    description='Identifies probe placement (eq. 15) and arm parameters (eq. 11) from a bag',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'solver = calib_solver.nodes.solver_node:main',
            'identify = calib_solver.commands.identify:main',
            'evaluate = calib_solver.commands.evaluate:main',
            'compensate = calib_solver.commands.compensate:main',
            'report = calib_solver.commands.report:main',
            'verify = calib_solver.commands.verify:main',
            'compare = calib_solver.commands.compare:main',
            'kuka_figures = calib_solver.commands.kuka_figures:main',
            'ur_kinematics = calib_solver.commands.ur_kinematics:main',
        ],
    },
)
