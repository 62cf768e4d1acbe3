"""Where work units run, and that it changes nothing but time."""

from __future__ import annotations

import sys
import threading
from concurrent.futures import Executor, ThreadPoolExecutor
from types import SimpleNamespace

import numba
import pytest

from ibrpipe.engine.executor import InlineExecutor, cores, current_executor, executor
from ibrpipe.errors import ResourceError


def square(number: int) -> tuple[int, int, str]:
    return number * number, numba.get_num_threads(), threading.current_thread().name


def test_without_choice_units_run_in_place() -> None:
    futures = [current_executor().submit(square, number) for number in range(4)]
    assert [future.result()[0] for future in futures] == [0, 1, 4, 9]
    assert {future.result()[2] for future in futures} == {threading.current_thread().name}


def test_inline_errors_come_with_the_result_and_interrupts_at_once() -> None:
    future = InlineExecutor().submit(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        future.result()

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        InlineExecutor().submit(interrupt)


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_threads_keep_the_order_and_use_one_kernel_thread_each(workers: int) -> None:
    before = numba.get_num_threads()
    with executor(workers) as chosen:
        assert current_executor() is chosen
        assert numba.get_num_threads() == min(workers or cores(), numba.config.NUMBA_NUM_THREADS)
        results = list(chosen.map(square, range(20)))
    assert [result[0] for result in results] == [number * number for number in range(20)]
    assert {result[1] for result in results} == {1}
    assert all(result[2].startswith("ibrpipe") for result in results)
    assert numba.get_num_threads() == before
    assert isinstance(current_executor(), InlineExecutor)


def test_the_choice_ends_with_the_block_even_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), executor(2) as chosen:
        chosen.submit(lambda: 1 // 0).result()
    assert isinstance(current_executor(), InlineExecutor)


def test_dask_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ResourceError, match=r"pip install 'ibrpipe\[dask\]'"), executor(dask="tcp://host:1"):
        pass


def test_dask_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def client(address: str, timeout: float) -> None:
        raise OSError(f"Timed out trying to connect to {address}")

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=client))
    with pytest.raises(ResourceError, match="no Dask scheduler answers at tcp://host:1"), executor(dask="tcp://host:1"):
        pass


def test_dask_client_gives_its_executor_and_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    closed, scattered = [], []
    pool = ThreadPoolExecutor(1)

    class Client:
        def __init__(self, address: str, timeout: float) -> None:
            self.address = address

        def get_executor(self) -> Executor:
            return pool

        def scatter(self, value: object, broadcast: bool, hash: bool) -> object:
            scattered.append(value)
            return value

        def close(self) -> None:
            closed.append(self.address)

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Client))
    with executor(dask="tcp://host:1") as chosen:
        assert chosen is current_executor()
        assert chosen.submit(square, 3).result()[0] == 9
        common, own = [1, 2], [[3], [4], [5]]
        sums = [chosen.submit(lambda one, two: sum(one) + sum(two), common, each).result() for each in own]
        assert sums == [6, 7, 8]
    assert closed == ["tcp://host:1"]
    assert scattered == [common]
    pool.shutdown()
