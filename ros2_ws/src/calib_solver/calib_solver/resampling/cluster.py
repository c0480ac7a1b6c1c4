# SPDX-License-Identifier: Apache-2.0
"""Where one machine is not enough: the same work on a Dask cluster, an optional extra.

Workers need this package installed; they get everything else from here. Only give the address of
a scheduler that is yours: Dask runs whatever its clients send.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.kinematics import ParameterTable
from calib_solver.problem import IntArray, Problem, SphereSums, accumulate, gathered, take_groups
from calib_solver.resampling.processes import Advance, in_order

Item = TypeVar('Item')
Result = TypeVar('Result')
#: s until a scheduler must have answered, and have a worker
TIMEOUT = 10.0


@contextmanager
def connected(address: str, timeout: float = TIMEOUT) -> Iterator[Cluster]:
    """The Dask cluster whose scheduler is at `address`, as in `tcp://192.168.0.7:8786`.

    Raises:
        CalibrationError: dask is not installed, nothing answers there within `timeout` (s), or it
            has no worker that can do our work.
    """
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise CalibrationError(
            "--scheduler needs Dask, which is not installed: pip install 'dask[distributed]'"
        ) from error
    # it reports every failed attempt by itself; ours is one line
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    try:
        get_address_host_port(address)
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError, ImportError, RuntimeError) as error:
        raise CalibrationError(
            f'no Dask scheduler answers at {address} within {timeout:g} s: {error}'
        ) from error
    try:
        yield Cluster(client, _ready_workers(client, address, timeout))
    finally:
        client.close()


def _ready_workers(client: Any, address: str, timeout: float) -> tuple[str, ...]:
    """The workers' addresses, once there is one and each has shown that it knows our package."""
    try:
        client.wait_for_workers(1, timeout=timeout)
    except TimeoutError as error:
        raise CalibrationError(f'the Dask scheduler at {address} has no workers') from error
    workers = tuple(sorted(client.scheduler_info(n_workers=-1)['workers']))
    try:
        client.run(_ready, workers=list(workers))
    except (ImportError, AttributeError) as error:
        raise CalibrationError(
            f'the Dask workers of {address} cannot do this work: {error}'
        ) from error
    return workers


def _ready() -> bool:
    """Importable where it runs, or the call fails there."""
    return True


@dataclass(frozen=True)
class Cluster:
    """A connection and the addresses of its `workers`."""

    client: Any
    workers: tuple[str, ...]

    def spread(
        self,
        work: Callable[[Any, Item], Result],
        shared: object,
        items: Sequence[Item],
        advance: Advance,
    ) -> list[Result]:
        """`work(shared, item)` for every item, as `parallel.Spread`.

        Raises:
            CalibrationError: workers were lost and the rest could not make up for it.
        """
        from distributed import as_completed

        with _lost_workers():
            held = self.client.scatter(shared, broadcast=True, hash=False)
            futures = [self.client.submit(work, held, item, pure=False) for item in items]
            return in_order(futures, as_completed(futures, loop=self.client.loop), advance)

    def passes(self) -> ClusterPasses:
        """`sums.accumulate`, its poses held by the workers."""
        return ClusterPasses(self)


@contextmanager
def _lost_workers() -> Iterator[None]:
    from distributed import KilledWorker

    try:
        yield
    except (KilledWorker, CancelledError, OSError) as error:
        raise CalibrationError(f'the Dask cluster gave up: {error}') from error


class ClusterPasses:
    """Passes over a problem whose poses lie on the workers, whole locations each.

    Bags keep their locations apart, so with many bags each worker holds some of them. A pass sends
    the parameters out and brings `SphereSums` back; sums are per sphere, so putting them one
    after another is the local result to the last bit.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._problem: Problem | None = None
        self._parts: list[tuple[str, Any]] = []
        self._order: IntArray = np.zeros(0, dtype=np.int64)

    def __call__(self, problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
        """As `sums.accumulate`.

        Raises:
            CalibrationError: a worker was lost.
        """
        with _lost_workers():
            if problem is not self._problem:
                self._hold(problem)
            client = self._cluster.client
            futures = [
                client.submit(_pass, part, table, full, workers=[worker], pure=False)
                for worker, part in self._parts
            ]
            found: list[SphereSums] = client.gather(futures)
        columns = zip(*(vars(sums).values() for sums in found), strict=True)
        return SphereSums(*(np.concatenate(column)[self._order] for column in columns))

    def _hold(self, problem: Problem) -> None:
        """Give each worker its part of the problem's spheres."""
        workers = self._cluster.workers
        shares = _shares(problem, len(workers))
        self._parts = []
        for worker, rows in zip(workers, shares, strict=False):
            part = _without_measurement(take_groups(problem, gathered(problem, rows)))
            held = self._cluster.client.scatter(part, workers=[worker], hash=False)
            self._parts.append((worker, held))
        self._order = np.argsort(np.concatenate(shares), kind='stable')
        self._problem = problem


def _pass(problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
    return accumulate(problem, table, full)


def _without_measurement(problem: Problem) -> Problem:
    measured = problem.measured
    none = measured.poses.take(np.zeros(0, dtype=np.int64))
    return replace(problem, measured=replace(measured, poses=none))


def _shares(problem: Problem, parts: int) -> list[IntArray]:
    """Rows of `problem.keys`, whole locations, in up to `parts` shares of about as many poses."""
    counts = problem.counts
    shares: list[list[IntArray]] = [[] for _ in range(parts)]
    poses = np.zeros(parts)
    for rows in sorted(problem.locations, key=lambda rows: -int(counts[rows].sum())):
        least = int(np.argmin(poses))
        shares[least].append(rows)
        poses[least] += counts[rows].sum()
    return [np.sort(np.concatenate(share)) for share in shares if share]
