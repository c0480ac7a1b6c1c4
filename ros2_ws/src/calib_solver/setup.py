# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from setuptools import Extension, find_packages, setup

PACKAGE = 'calib_solver'


def shared(*folders: str) -> list[tuple[str, list[str]]]:
    """Every file under `folders`, to be installed in the same place under share/."""
    found: dict[str, list[str]] = {}
    for folder in folders:
        for path in sorted(Path(folder).rglob('*')):
            if path.is_file() and '__pycache__' not in path.parts:
                found.setdefault(f'share/{PACKAGE}/{path.parent}', []).append(str(path))
    return list(found.items())


def kernel() -> list[Extension]:
    """The compiled inner loop; without a compiler the package installs without it."""
    source = Path(PACKAGE, '_kernel.c')
    if not source.exists():
        return []
    return [
        Extension(
            f'{PACKAGE}._kernel',
            [str(source)],
            depends=[str(source.with_name('_kernel_pass.h'))],
            extra_compile_args=['-O3'],
            optional=True,
        )
    ]


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *shared('config', 'launch', 'data'),
    ],
    ext_modules=kernel(),
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='Calibration maintainers',
    maintainer_email='calibration@example.com',
    description='Identifies probe placement (eq. 15) and arm parameters (eq. 11) from a bag',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'solver = calib_solver.solver_node:main',
            'identify = calib_solver.identify:main',
            'evaluate = calib_solver.evaluate:main',
            'compensate = calib_solver.compensate:main',
            'kuka_figures = calib_solver.kuka_figures:main',
        ],
    },
)
