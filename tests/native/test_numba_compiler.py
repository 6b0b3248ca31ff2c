"""Numba is restored: functions that other code compiles afterwards work."""

import math
from contextlib import contextmanager

import numba
import numpy as np
import pytest

from beamdae.native import numba_compiler


def loop(work):
    largest = 0.0
    for number in work.numbers:
        largest = max(largest, abs(number))
    return 1 if math.isfinite(largest) and np.sign(largest) >= 0 else 0


def is_positive(work):
    return 1 if work.numbers[0] > 0.0 else 0


def add_number(work, number):
    return is_positive(work) + int(number)


@pytest.mark.slow(reason="half a second and more")
def test_numba_compiles_other_functions_as_before():
    kind = ("Work", (("numbers", 0, ("float64", 1)),))
    text = numba_compiler.compile_loops({"loop": (loop, "@")}, (loop,), kind)
    assert "define i32 @loop" in text

    @numba.njit
    def other_function(numbers):
        if not np.isfinite(numbers).all():
            raise ValueError("not finite")
        largest = 0.0
        for number in numbers:
            largest = max(largest, abs(number))
        return largest + np.sign(numbers[0]) if math.isfinite(largest) else 0.0

    assert other_function(np.array([1.0, -3.0])) == 4.0
    with pytest.raises(ValueError, match="not finite"):
        other_function(np.array([1.0, np.inf]))


@pytest.mark.slow(reason="half a second")
def test_unknown_numba_compiles_without_replaced_parts(monkeypatch):
    @contextmanager
    def fail():
        raise AttributeError("_library_class")
        yield

    monkeypatch.setattr(numba_compiler, "_emit_ir_only", fail)
    kind = ("Other", (("numbers", 0, ("float64", 1)),))
    entries = {"loop": (is_positive, "@"), "add_number": (add_number, "d@")}
    text = numba_compiler.compile_loops(entries, (is_positive, add_number), kind)
    assert "define i32 @loop" in text
    assert "define i32 @add_number" in text
