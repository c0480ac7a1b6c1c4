# SPDX-License-Identifier: Apache-2.0
"""One function over many items in parallel processes; results come in the order of the items."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from typing import Any, Protocol, TypeVar

from calib_model.errors import CalibrationError
from calib_model.starting import ENDING

Item = TypeVar('Item')
Result = TypeVar('Result')
Advance = Callable[[], None]
NICE = 10  # of processes that work in the background


class Spread(Protocol):
    """`work(shared, item)` for every item, somewhere; `advance` is called after each."""

    def __call__(
        self,
        work: Callable[[Any, Item], Result],
        shared: object,
        items: Sequence[Item],
        advance: Advance,
    ) -> list[Result]: ...


def in_processes(workers: int) -> Spread:
    """Spread work over `workers` processes of this machine; with one, over none but this."""

    def spread(
        work: Callable[[Any, Item], Result],
        shared: object,
        items: Sequence[Item],
        advance: Advance,
    ) -> list[Result]:
        if workers <= 1 or len(items) <= 1:
            return [_advanced(work(shared, item), advance) for item in items]
        return _pooled(work, shared, items, advance, min(workers, len(items)))

    return spread


def in_order(futures: Sequence[Any], finished: Iterable[Any], advance: Advance) -> list[Any]:
    """Results in the order of `futures`, while `finished` gives them as they are done."""
    results = {id(future): _advanced(future.result(), advance) for future in finished}
    return [results[id(future)] for future in futures]


def _advanced(result: Result, advance: Advance) -> Result:
    advance()
    return result


def _pooled(
    work: Callable[[Any, Item], Result],
    shared: object,
    items: Sequence[Item],
    advance: Advance,
    workers: int,
) -> list[Result]:
    # spawned, not forked: the solver's threads, and a node's, do not survive a fork
    pool = ProcessPoolExecutor(workers, get_context('spawn'), _begin, (shared,))
    try:
        futures = _submitted(pool, work, items, workers)
        return in_order(futures, as_completed(futures), advance)
    except BrokenProcessPool as error:
        raise CalibrationError(
            'a worker process died; with too little memory, fewer of them may do (CALIB_THREADS)'
        ) from error
    except KeyboardInterrupt:
        for process in active_children():  # else the end waits for what they are at
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _submitted(
    pool: ProcessPoolExecutor,
    work: Callable[[Any, Item], Result],
    items: Sequence[Item],
    workers: int,
) -> list[Future[Result]]:
    # each of the first submissions starts a worker, which inherits the mask: signals are this
    # process' to answer, from a worker's first moment on, and not before it has been told its work
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        first = [pool.submit(_do, work, item) for item in items[:workers]]
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return [*first, *(pool.submit(_do, work, item) for item in items[workers:])]


_shared: object = None


def _begin(shared: object) -> None:
    """In a worker: keep what all items share, take one core, end when the parent has."""
    global _shared  # a worker process has one job only
    _shared = shared
    os.environ['CALIB_THREADS'] = '1'
    os.nice(NICE)  # a node that has this done answers others meanwhile
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(work: Callable[[Any, Item], Result], item: Item) -> Result:
    return work(_shared, item)
