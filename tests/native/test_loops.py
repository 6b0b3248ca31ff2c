"""Compiled loops agree with plain Python."""

import copy
import ctypes
import threading
import time
import warnings
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pytest
from beamdae.native.loop_functions import combine
from beamdae.native.loops import CompiledLoop
from numpy.testing import assert_array_equal

from beamdae.core.return_codes import DONE, FULL
from beamdae.errors import KernelWarning
from beamdae.native import loops
from beamdae.native.llvm import MachineCodeError

FACTOR, OFFSETS = 3, (0.25, -2.0)
TABLE = np.array([[1.0, 2.0], [3.0, 4.0]])


@pytest.fixture(autouse=True)
def new_process(cache, monkeypatch):
    """A new cache for each test, and a process that has not loaded loops yet."""
    monkeypatch.setattr(loops, "_loaded_objects", {})


class Pair(NamedTuple):
    unsigned: np.ndarray
    plane: np.ndarray


@dataclass(slots=True)
class Inner:
    count: int
    numbers: np.ndarray


@dataclass(slots=True)
class Work:
    count: int
    rate: float
    numbers: np.ndarray
    whole: np.ndarray
    complexes: np.ndarray
    rows: np.ndarray
    whole_rows: np.ndarray
    inner: Inner
    pair: Pair
    code_owners: tuple = ()
    last: float = 0.0


def work(size=7):
    random = np.random.default_rng(size)
    return Work(
        3,
        0.1,
        random.normal(size=size),
        np.arange(size),
        random.normal(size=size) + 1j * random.normal(size=size),
        random.normal(size=(size, 4)),
        np.arange(3 * size).reshape(size, 3),
        Inner(5, random.normal(size=size)),
        Pair(np.arange(size, dtype=np.uint32)[::-1].copy(), random.normal(size=(2, size))),
        (object(),),
    )


def use_all_fields(work):
    """Read and set fields of every type."""
    inner, pair = work.inner, work.pair
    for i in range(work.numbers.size):
        place = pair.unsigned[i]
        work.numbers[i] += work.rate * inner.numbers[place] - pair.plane[1, i]
        work.complexes[i] *= 1j * work.complexes[place].real + OFFSETS[0]
        work.whole[i] = 2**40 + work.whole[i] // FACTOR - work.whole_rows[i, 2]
        pair.plane[0, i] = evaluate_polynomial(work.rows[i], work.whole_rows.shape[1])
        pair.unsigned[i] = (place + FACTOR) % work.numbers.size
    combine(inner.numbers, (2.0, OFFSETS[1]), (inner.numbers, work.numbers))
    work.rows[0] = TABLE[1, 0]
    work.rate *= -1.5
    work.count += inner.count
    inner.count -= work.whole.size
    work.last = np.inf if inner.count < 0 else np.nan
    return work.count


def evaluate_polynomial(row, count):
    total = 0.0
    for number in row:
        total = total * count + number
    return total


def leaves(work):
    names = getattr(work, "_fields", None) or [field.name for field in fields(work)]
    for value in (getattr(work, name) for name in names if name != "code_owners"):
        yield from [value] if isinstance(value, (int, float, np.ndarray)) else leaves(value)


def assert_same(one, other):
    for x, y in zip(leaves(one), leaves(other), strict=True):
        assert type(x) is type(y)
        assert np.asarray(x).dtype == np.asarray(y).dtype
        assert_array_equal(x, y)


def compile_without_warnings(function, work, **callbacks):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return CompiledLoop(function, work, **callbacks)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("size", [1, 4, 7])
def test_compiled_loop_agrees_with_plain_python(size):
    plain, compiled = work(size), work(size)
    loop = compile_without_warnings(use_all_fields, compiled)
    for _ in range(3):
        assert loop() == use_all_fields(plain)
        assert_same(compiled, plain)
        compiled.rate = plain.rate = 0.75
        compiled.numbers[:] = plain.numbers[:] = 1.0


@pytest.mark.slow(reason="a quarter of a second")
def test_bind_replaces_the_arrays_of_one_nested_object():
    plain, compiled = work(), work()
    loop = compile_without_warnings(use_all_fields, compiled)
    for one in (plain, compiled):
        one.inner.numbers, one.inner.count, one.rate = np.linspace(-1.0, 1.0, 7), 2, 0.5
    loop.bind(compiled.inner)
    assert loop() == use_all_fields(plain)
    assert_same(compiled, plain)


@pytest.mark.slow(reason="a fifth of a second")
def test_loops_of_one_function_have_separate_objects(cache):
    works = [work(size) for size in (2, 5)]
    plain = copy.deepcopy(works)
    loops = [compile_without_warnings(use_all_fields, one) for one in works]
    assert [loop() for loop in loops] == [use_all_fields(one) for one in plain]
    for one, other in zip(works, plain, strict=True):
        assert_same(one, other)
    assert len(list(cache.iterdir())) == 1


def multiply(work, factor, table):
    work.rate = factor * table
    return DONE


@pytest.mark.slow(reason="a fifth of a second")
def test_callbacks_have_the_stated_arguments():
    instance = work()
    loop = compile_without_warnings(use_all_fields, instance, multiply=(multiply, "d@p"))
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
    loop.load()
    assert kind(loop.addresses["multiply"])(2.5, loop.table.ctypes.data, 40) == DONE
    loop.unload()
    assert instance.rate == 100.0


# Release of the interpreter lock.


@dataclass(slots=True)
class Waiting:
    flag: np.ndarray
    count: np.ndarray
    max_count: int


def wait(work):
    """Wait until another thread sets the flag."""
    for _ in range(work.max_count):
        work.count[0] += 1.0
        if work.flag[0] != 0:
            return DONE
    return FULL


@pytest.mark.slow(reason="a second")
def test_other_threads_run_during_a_loop():
    # If other threads were blocked, the loop would take seconds and return FULL.
    waiting = Waiting(np.zeros(1, np.int64), np.zeros(1), 5_000_000_000)
    loop = compile_without_warnings(wait, waiting)

    def set_flag():
        time.sleep(0.02)
        waiting.flag[0] = 1

    thread = threading.Thread(target=set_flag)
    thread.start()
    assert loop() == DONE
    thread.join()
    assert waiting.count[0] > 1.0


# Unavailable machine code.


@pytest.mark.slow(reason="a fifth of a second")
def test_native_off_applies_only_while_it_is_set(monkeypatch):
    instance = work()
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    with pytest.raises(MachineCodeError, match="switched off"):
        CompiledLoop(use_all_fields, instance)
    monkeypatch.delenv("BEAMDAE_NATIVE")
    assert compile_without_warnings(use_all_fields, instance)() == 8


def read_missing_field(work):
    return work.nothing


def test_loop_that_numba_cannot_compile_warns_once(cache):
    instance = work()
    with (
        pytest.warns(
            KernelWarning, match=r"numba cannot compile loops \(.+\); runs take"
        ) as warned,
        pytest.raises(MachineCodeError, match="read_missing_field: the loop cannot be compiled"),
    ):
        CompiledLoop(read_missing_field, instance)
    assert len(warned) == 1
    assert "\n" not in str(warned[0].message)
    with pytest.raises(MachineCodeError):
        compile_without_warnings(read_missing_field, instance)
    assert list(cache.iterdir()) == []
