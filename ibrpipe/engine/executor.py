"""Where work units run: in place, on threads of this machine, or on a Dask cluster.

Stages ask `current_executor` and submit independent units; they collect results in the order of submission, so the
number of workers never changes a byte.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from ibrpipe.errors import ResourceError


class InlineExecutor(Executor):
    """Runs every unit at once in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run ``fn(*args, **kwargs)`` now and return its finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class SharingExecutor(Executor):
    """Sends units to a Dask cluster, and what several units have in common only once to each worker."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._pool = client.get_executor()
        self._seen: dict[int, tuple[Any, Any]] = {}  # id -> (argument, kept alive; where it is on the cluster)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run ``fn(*args, **kwargs)`` on a worker; arguments are pickled."""
        future: Future[Any] = self._pool.submit(fn, *(self._shared(arg) for arg in args), **kwargs)
        return future

    def _shared(self, arg: Any) -> Any:
        """Return `arg` the first time, and from then on a reference to one copy of it per worker."""
        if arg is None or isinstance(arg, (bool, int, float, str, bytes)):
            return arg
        known = self._seen.get(id(arg))
        if known is None:
            self._seen[id(arg)] = (arg, None)
            return arg
        if known[1] is None:
            known = (arg, self._client.scatter(arg, broadcast=True, hash=False))
            self._seen[id(arg)] = known
        return known[1]


_CURRENT: ContextVar[Executor | None] = ContextVar("executor", default=None)


def current_executor() -> Executor:
    """Return the executor that work units go to: the one set by `executor`, else one that runs them in place."""
    return _CURRENT.get() or InlineExecutor()


def cores() -> int:
    """Return how many processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def executor(workers: int = 0, dask: str | None = None) -> Iterator[Executor]:
    """Make an executor the current one inside the block.

    Parameters
    ----------
    workers : int
        Threads of this machine; 0 = all cores. Kernels outside work units use as many, inside them one.
    dask : str, optional
        Address of a Dask scheduler that takes the work units instead.

    Raises
    ------
    ResourceError
        Dask is not installed, or its scheduler does not answer.
    """
    count = workers or cores()
    with _kernel_threads(count), _open(count, dask) as chosen:
        token = _CURRENT.set(chosen)
        try:
            yield chosen
        finally:
            _CURRENT.reset(token)


@contextmanager
def _open(count: int, dask: str | None) -> Iterator[Executor]:
    if dask is not None:
        with _dask(dask) as remote:
            yield remote
        return
    pool = ThreadPoolExecutor(count, thread_name_prefix="ibrpipe", initializer=_use_threads, initargs=(1,))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ResourceError("--dask needs the package distributed; type: pip install 'ibrpipe[dask]'") from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise ResourceError(
            f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler"
        ) from error
    try:
        yield SharingExecutor(client)
    finally:
        client.close()


@contextmanager
def _kernel_threads(count: int) -> Iterator[None]:
    import numba

    before = numba.get_num_threads()
    _use_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _use_threads(count: int) -> None:
    """Let kernels started from the calling thread use `count` threads."""
    import numba

    numba.set_num_threads(max(1, min(count, numba.config.NUMBA_NUM_THREADS)))
