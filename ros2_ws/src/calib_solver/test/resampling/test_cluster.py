# SPDX-License-Identifier: Apache-2.0
"""On a Dask cluster the work ends where it ends on one machine; two workers on this one try it."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import kr5, passive, simulate
from simulated_points import tracked

from calib_model.bags import write_measurement, write_points
from calib_model.errors import CalibrationError
from calib_model.kinematics import identifiable_table
from calib_solver.calibration import Sources, load
from calib_solver.commands.identify import main, run
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.problem import Problem, accumulate
from calib_solver.resampling.cluster import connected
from calib_solver.resampling.processes import in_processes
from calib_solver.resampling.resampling import Plan, resample

pytest.importorskip('distributed', reason='dask is not installed: an optional extra')
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
START = """
import sys
from distributed.cli.{0} import main
sys.argv[0] = {0!r}
main()
"""


def started(what, *words):
    """A process of Dask's own command line, `dask scheduler` or `dask worker`."""
    return subprocess.Popen(
        [sys.executable, '-c', START.format(f'dask_{what}'), *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def free_port():
    with socket.socket() as listening:
        listening.bind(('127.0.0.1', 0))
        return listening.getsockname()[1]


@pytest.fixture(scope='module')
def scheduler():
    """The address of a scheduler with two workers, each a process of its own."""
    port = str(free_port())
    address = f'tcp://127.0.0.1:{port}'
    place = ['--host', '127.0.0.1', '--no-dashboard']
    processes = [started('scheduler', *place, '--port', port)]
    processes += [started('worker', address, *place, '--nthreads', '1') for _ in range(2)]
    try:
        wait_for_two(address)
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(timeout=20)


def wait_for_two(address):
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        with connected(address, timeout=30) as cluster:
            if len(cluster.workers) == 2:
                return
        time.sleep(0.1)
    raise AssertionError('two workers did not start')


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Three bags of one arm, locations 1 and 2, 3 and 4, 5: each numbers its own from 1."""
    folder = tmp_path_factory.mktemp('bags')
    measured = simulate(kr5(), passive(), 81, locations=5, poses=10, noise=1e-4).measured
    found = []
    for first in (1, 3, 5):
        own = np.isin(measured.poses.location, (first, first + 1))
        poses = measured.poses.take(own)
        part = replace(poses, location=poses.location - first + 1)
        write_measurement(folder / f'bag{first}', replace(measured, poses=part))
        found.append(str(folder / f'bag{first}'))
    return found


@pytest.fixture(scope='module')
def measured(bags):
    return load(Sources(tuple(bags)))


def test_a_pass_over_parts_on_workers_is_the_local_one_to_the_last_bit(scheduler, measured):
    problem = Problem.of(measured)
    table = identifiable_table(measured.arm, measured.probe)
    with connected(scheduler) as cluster:
        passes = cluster.passes()
        for full in (table.nominal, table.nominal + 1e-4):
            here, there = accumulate(problem, table, full), passes(problem, table, full)
            for name, values in vars(here).items():
                np.testing.assert_array_equal(getattr(there, name), values, err_msg=name)
        assert len(passes._parts) == 2  # both workers hold some of the locations
        held = [client_side.result() for _, client_side in passes._parts]
    assert sum(len(part.joints) for part in held) == len(problem.joints)


@pytest.mark.parametrize('objective', ['distance_repeatability', 'distance', 'position'])
def test_many_bags_on_workers_identify_the_same_arm(scheduler, measured, objective):
    options = Options(objective)
    here = identify(measured, options)
    with connected(scheduler) as cluster:
        there = identify(measured, options, cluster.passes())
    np.testing.assert_allclose(there.full, here.full, rtol=1e-12, atol=1e-15)
    assert there.identified.phi == pytest.approx(here.identified.phi, rel=1e-12)
    np.testing.assert_allclose(there.uncertainty.standard, here.uncertainty.standard, rtol=1e-12)
    assert (there.fit.converged, there.fit.iterations) == (here.fit.converged, here.fit.iterations)


def test_gross_errors_are_left_out_there_too(scheduler, measured):
    joints = measured.poses.joints.copy()
    joints[::37, 2] += 0.01
    spoiled = replace(measured, poses=replace(measured.poses, joints=joints))
    here = identify(spoiled)
    with connected(scheduler) as cluster:
        there = identify(spoiled, None, cluster.passes())
    assert here.rejected
    assert there.rejected == here.rejected
    np.testing.assert_allclose(there.full, here.full, rtol=1e-12, atol=1e-15)


def test_repetitions_there_are_those_made_here(scheduler, measured):
    done = identify(measured)
    plan = Plan(6, 6, 3)
    advanced = []
    here = resample(done, plan, in_processes(1))
    with connected(scheduler) as cluster:
        assert cluster.spread(pow, 2, [3, 4, 5], lambda: advanced.append(1)) == [8, 16, 32]
        there = resample(done, plan, cluster.spread)
    assert len(advanced) == 3
    for name in ('monte_carlo', 'bootstrap'):
        np.testing.assert_array_equal(getattr(there, name).deviation, getattr(here, name).deviation)


def test_repetitions_of_measured_points_there_are_those_made_here(scheduler, tmp_path):
    write_points(tmp_path / 'bag', tracked(6, 40, noise=4e-5).measured)
    words = [str(tmp_path / 'bag'), '--quick', '--monte-carlo', '3', '--bootstrap', '3']
    here, there = (run([*words, *more]).record for more in ([], ['--scheduler', scheduler]))
    assert there['parameters'] == here['parameters']
    assert there['resampling']['parameters'] == here['resampling']['parameters']


def test_the_command_takes_the_address(scheduler, bags, tmp_path):
    words = [*bags, '--monte-carlo', '4', '--bootstrap', '4']
    run([*words, '--output', str(tmp_path / 'here')])
    run([*words, '--output', str(tmp_path / 'there'), '--scheduler', scheduler])
    here, there = (
        json.loads((tmp_path / place / 'result.json').read_text()) for place in ('here', 'there')
    )
    assert there['parameters'] == here['parameters']
    assert there['resampling']['parameters'] == here['resampling']['parameters']


@pytest.mark.parametrize('address', ['nowhere', 'smoke://signals:1', 'tcp://127.0.0.1:99999999'])
def test_what_is_no_address_is_one_line(bags, capsys, address):
    assert main([*bags, '--scheduler', address]) == 2
    said = capsys.readouterr()
    assert said.out == ''
    assert len(said.err.splitlines()) == 1
    assert f'no Dask scheduler answers at {address}' in said.err


def test_an_address_where_nothing_answers_is_given_up_in_time():
    begun = time.monotonic()
    nowhere = connected(f'tcp://127.0.0.1:{free_port()}', timeout=1.0)
    refused = pytest.raises(CalibrationError, match='no Dask scheduler answers at .* within 1 s')
    with refused, nowhere:
        pass
    assert time.monotonic() - begun < 15


def test_without_dask_the_line_says_what_to_install(bags, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main([*bags, '--scheduler', 'tcp://127.0.0.1:8786']) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "pip install 'dask[distributed]'" in said


def test_nothing_else_needs_dask(bags):
    code = (
        'import sys; sys.modules["distributed"] = sys.modules["dask"] = None; '
        'from calib_solver.commands.identify import main; sys.exit(main(sys.argv[1:]))'
    )
    words = [sys.executable, '-c', code, *bags, '--monte-carlo', '2']
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
