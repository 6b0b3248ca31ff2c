"""Loops that call C functions and are called back by them."""

import ctypes
import threading
import time
from dataclasses import dataclass

import numpy as np
import pytest
from beamdae.native.loop_functions import (
    array_at,
    call_for_int,
    call_for_pointer,
    fill,
    locate_largest,
)
from beamdae.native.loops import CompiledLoop

from beamdae.native import loops
from beamdae.native.object_code import is_native_enabled

compiled = pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")

_THREE_ARGUMENTS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p, ctypes.c_int)
_POINTER = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
_WITHOUT_ARGUMENTS = ctypes.CFUNCTYPE(ctypes.c_int)


@dataclass(slots=True)
class Work:
    numbers: np.ndarray
    weights: np.ndarray
    three_arguments: int
    pointer: int
    without_arguments: int
    numbers_at: int
    largest: int = 0
    answer: int = 0
    calls: int = 0


def calls(work):
    numbers = array_at(call_for_pointer(work.pointer, (work.numbers_at,)), 2)
    fill(numbers, 7.0)
    work.answer = call_for_int(work.three_arguments, (2.5, work.numbers_at, -3))
    work.largest = locate_largest(work.numbers, work.weights)
    return call_for_int(work.without_arguments, ())


def count_call(work, first, second):
    work.calls += 1
    fill(array_at(second, 1), first)
    return work.calls


def address(function):
    return ctypes.cast(function, ctypes.c_void_p).value


@pytest.mark.parametrize("native", [False, pytest.param(True, marks=compiled)])
def test_c_functions_receive_their_arguments(native):
    received = []
    functions = (
        _THREE_ARGUMENTS(
            lambda number, pointer, integer: received.append((number, pointer, integer)) or -4
        ),
        _POINTER(lambda pointer: pointer + 8),
        _WITHOUT_ARGUMENTS(lambda: 11),
    )
    numbers = np.arange(4.0)
    at = numbers.ctypes.data
    work = Work(numbers, np.array([1.0, 1.0, -2.0, 1.0]), *map(address, functions), at)
    assert (CompiledLoop(calls, work)() if native else calls(work)) == 11
    assert received == [(2.5, at, -3)]
    assert work.answer == -4
    assert work.largest == 2
    assert numbers.tolist() == [0.0, 7.0, 7.0, 3.0]


@compiled
def test_callbacks_share_the_table_of_the_loop():
    numbers, out = np.zeros(4), np.zeros(1)
    work = Work(numbers, np.ones(4), 0, 0, 0, 0)
    loop = CompiledLoop(calls, work, count_call=(count_call, "dp@"))
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
    function = kind(loop.addresses["count_call"])
    loop.load()
    table = loop.table.ctypes.data
    assert [function(x, out.ctypes.data, table) for x in (1.5, 2.5)] == [1, 2]
    loop.unload()
    assert (work.calls, out[0]) == (2, 2.5)


@compiled
def test_bind_replaces_arrays_in_the_same_table():
    work = Work(np.arange(4.0), np.ones(4), 0, 0, 0, 0)
    loop = CompiledLoop(calls, work)
    table, words = loop.table.ctypes.data, loop.table.copy()
    work.numbers, work.calls = np.zeros(9), 5
    loop.bind()
    assert loop.table.ctypes.data == table
    assert not np.array_equal(loop.table, words)
    work.calls = 0
    loop.unload()
    assert work.calls == 5


@compiled
def test_regression_threads_share_one_loaded_object(monkeypatch):
    """Regression: the second object replaced the first, whose code was freed while it ran."""
    loads, real = [], loops.load_object

    def load_slowly(*arguments):
        loads.append(None)
        time.sleep(0.1)
        return real(*arguments)

    monkeypatch.setattr(loops, "load_object", load_slowly)
    monkeypatch.setattr(loops, "_loaded_objects", {})
    addresses_of_threads = []

    def make():
        addresses_of_threads.append(
            CompiledLoop(calls, Work(np.zeros(4), np.ones(4), 0, 0, 0, 0)).addresses["loop"]
        )

    threads = [threading.Thread(target=make) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(loads) == 1
    assert len(set(addresses_of_threads)) == 1
