"""Whoever waits for kernels hears so; the collector of garbage rests meanwhile."""

from __future__ import annotations

import gc
from types import SimpleNamespace

import numba
import pytest

from ibrpipe.compile_progress import FIRST, LABEL, NEXT, Watch, compiling_told
from ibrpipe.progress import listening


@pytest.fixture
def told():
    return []


def watch_with(told, times):
    return Watch(lambda *each: told.append(each), clock=iter(times).__next__)


ANY = SimpleNamespace()


def test_first_word_after_a_while_and_then_now_and_then(told):
    watch = watch_with(told, [0.0, 0.5 * FIRST, FIRST, FIRST + 0.5 * NEXT, FIRST + NEXT])
    watch.on_start(ANY)  # outermost
    watch.on_start(ANY)  # what it calls
    watch.on_end(ANY)
    watch.on_end(ANY)
    watch.on_start(ANY)
    watch.close()
    assert told == [(LABEL, 0, None), (LABEL, 1, None), (LABEL, 1, 1)]


def test_what_is_compiled_at_once_is_not_told(told):
    watch = watch_with(told, [0.0, 0.5 * FIRST])
    watch.on_start(ANY)
    watch.on_end(ANY)
    watch.close()
    assert told == []


@pytest.mark.parametrize("collects", [True, False])
def test_collector_rests_while_anything_is_compiled_and_is_left_as_it_was(told, collects):
    before = gc.isenabled()
    try:
        (gc.enable if collects else gc.disable)()
        watch = watch_with(told, [0.0] * 4)
        watch.on_start(ANY)
        watch.on_start(ANY)
        watch.on_end(ANY)
        assert not gc.isenabled()
        watch.on_end(ANY)
        assert gc.isenabled() == collects
    finally:
        (gc.enable if before else gc.disable)()


def test_blocks_may_begin_and_end_while_another_thread_compiles(told):
    before = gc.isenabled()
    try:
        gc.enable()
        watch = watch_with(told, [0.0] * 4)
        watch.on_end(ANY)  # begun before the block
        watch.on_start(ANY)
        assert not gc.isenabled()
        watch.close()  # its end is after the block
        assert gc.isenabled()
    finally:
        (gc.enable if before else gc.disable)()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_blocks_hear_of_numba_once_and_only_while_they_last(told, monkeypatch):
    monkeypatch.setattr("ibrpipe.compile_progress.FIRST", 0.0)
    monkeypatch.setattr("ibrpipe.compile_progress.NEXT", 0.0)

    def compile_one():
        assert numba.njit(lambda x: x + 1)(1) == 2

    with listening(lambda *each: told.append(each)), compiling_told(), compiling_told():
        compile_one()
    assert told == [(LABEL, 0, None), (LABEL, 1, None), (LABEL, 1, 1)]
    compile_one()
    assert len(told) == 3


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_where_nobody_listens_lines_go_to_stderr(monkeypatch, capsys):
    monkeypatch.setattr("ibrpipe.compile_progress.FIRST", 0.0)
    with compiling_told():
        numba.njit(lambda x: x + 2)(1)
    assert capsys.readouterr().err == f"ibrpipe: {LABEL}: 0 so far\nibrpipe: {LABEL}: 1, all done\n"
