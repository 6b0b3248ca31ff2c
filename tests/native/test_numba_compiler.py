"""Numba is left as it was: what others compile with it afterwards runs."""

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


def other(work):
    return 1 if work.numbers[0] > 0.0 else 0


def given(work, number):
    return other(work) + int(number)


@pytest.mark.slow(reason="half a second and more")
def test_functions_others_compile_are_whole():
    kind = ("Work", (("numbers", 0, ("float64", 1)),))
    text = numba_compiler.compile_loops({"loop": (loop, "@")}, (loop,), kind)
    assert "define i32 @loop" in text

    @numba.njit
    def theirs(numbers):
        if not np.isfinite(numbers).all():
            raise ValueError("not finite")
        largest = 0.0
        for number in numbers:
            largest = max(largest, abs(number))
        return largest + np.sign(numbers[0]) if math.isfinite(largest) else 0.0

    assert theirs(np.array([1.0, -3.0])) == 4.0
    with pytest.raises(ValueError, match="not finite"):
        theirs(np.array([1.0, np.inf]))


def test_another_numba_compiles_in_its_own_time(monkeypatch):
    @contextmanager
    def unknown():
        raise AttributeError("_library_class")
        yield

    monkeypatch.setattr(numba_compiler, "_emit_ir_only", unknown)
    kind = ("Other", (("numbers", 0, ("float64", 1)),))
    entries = {"loop": (other, "@"), "given": (given, "d@")}
    text = numba_compiler.compile_loops(entries, (other, given), kind)
    assert "define i32 @loop" in text
    assert "define i32 @given" in text
