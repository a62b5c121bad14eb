"""Does work on several cores, or on a Dask cluster, and returns the results in the order of the jobs."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from itertools import count
from typing import Any, NamedTuple, TypeVar

from anytraverse.errors import AnyTraverseError
from anytraverse.release import to_install

Job = TypeVar("Job")
Result = TypeVar("Result")

_CONNECT_S = 10
_LOOKS = 0.5
"""Seconds between two looks at how far the processes are."""


class _Counting:
    """Counts the steps of the work that this process does."""

    tick: Callable[[], None] | None = None


class SpreadError(AnyTraverseError):
    """Reports a cluster that cannot be used, or a job that failed. The text says what to do."""


class _Failed(NamedTuple):
    """A job that failed with an error of ours. Errors themselves may not survive the way back."""

    text: str


def tick() -> None:
    """Count a step of the work that is being done, wherever that is. `spread` tells how many there are."""
    if _Counting.tick is not None:
        _Counting.tick()


def _begin(steps: Any) -> None:
    """Begin a process. It ends with its parent, and counts steps in a value that it shares."""
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def count_one() -> None:
        with steps.get_lock():
            steps.value += 1

    _Counting.tick = count_one


def _end_with_parent() -> None:
    """Wait for the parent's end. A job would go on for minutes after it, and nobody would get its result."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _guarded(work: Callable[[Any], Any], job: Any) -> Any:
    """Do a job in another process."""
    try:
        return work(job)
    except (AnyTraverseError, OSError) as error:
        return _Failed(str(error))


def spread(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    processes: int = 1,
    dask: str | None = None,
    done: Callable[[int, Result], None],
    ticked: Callable[[int], None] | None = None,
) -> list[Result]:
    """Do all jobs. Without processes and cluster, one after the other in this process.

    work: a function of a module, so that another process can import it; so are the jobs' types. dask: the
    address of a scheduler, e.g. "tls://host:8786", with certificates from Dask's own configuration; its
    workers need this package and the same files. Results are unpickled: a cluster must be trusted.
    done: called with the number of each job that is done, and its result. ticked: called now and then with
    how often the jobs have called `tick` so far; never for a cluster.
    Raises SpreadError, and what `work` raises where it runs in this process.
    """
    if dask is not None:
        return _on_cluster(work, jobs, dask, done)
    if processes <= 1 or len(jobs) <= 1:
        return _here(work, jobs, done, ticked)
    # spawn: a fork would take over the threads of native libraries in any state
    context = multiprocessing.get_context("spawn")
    steps = context.Value("Q", 0)
    with ProcessPoolExecutor(
        min(processes, len(jobs)), mp_context=context, initializer=_begin, initargs=(steps,)
    ) as pool:
        numbers: dict[Future[Any], int] = {
            pool.submit(_guarded, work, job): number for number, job in enumerate(jobs)
        }
        try:
            left = set(numbers)
            while left:
                over, left = wait(left, timeout=_LOOKS, return_when=FIRST_COMPLETED)
                if ticked is not None:
                    ticked(steps.value)
                for future in over:
                    done(numbers[future], _checked(future.result()))
        except BrokenProcessPool:
            raise SpreadError("a process died, perhaps for lack of memory: give fewer --jobs") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in numbers]


def _here(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    done: Callable[[int, Result], None],
    ticked: Callable[[int], None] | None,
) -> list[Result]:
    before, steps, results = _Counting.tick, count(1), list[Result]()
    _Counting.tick = None if ticked is None else lambda: ticked(next(steps))
    try:
        for number, job in enumerate(jobs):
            results.append(work(job))
            done(number, results[-1])
    finally:
        _Counting.tick = before
    return results


def _on_cluster(
    work: Callable[[Job], Result], jobs: Sequence[Job], address: str, done: Callable[[int, Result], None]
) -> list[Result]:
    try:
        import distributed
    except ImportError:
        raise SpreadError(f"--dask needs distributed: {to_install('dask')}") from None
    if address.startswith("tls:") and not distributed.Security().get_connection_args("client")["ssl_context"]:
        raise SpreadError(
            f"{address} needs certificates: set ca-file, client.cert and client.key of distributed.comm.tls "
            "in Dask's configuration"
        )
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SpreadError(
            f"no Dask scheduler answers at {address}: start one, or leave --dask away"
        ) from error
    with client:
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise SpreadError(
                f"the scheduler at {address} has no workers: start one with `dask worker {address}`"
            )
        futures = client.map(partial(_guarded, work), jobs, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        results = dict[int, Result]()
        try:
            for future, result in distributed.as_completed(futures, with_results=True, loop=client.loop):
                number = numbers[future.key]
                results[number] = _checked(result)
                done(number, results[number])
        except (distributed.KilledWorker, CancelledError) as error:
            raise SpreadError(
                f"the workers at {address} died at their work, or its scheduler did: look into their output"
            ) from error
        return [results[number] for number in range(len(jobs))]


def _checked(result: Any) -> Any:
    if isinstance(result, _Failed):
        raise SpreadError(result.text)
    return result
