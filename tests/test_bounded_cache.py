"""Caches are bounded by the total size of their results."""

import threading

import casadi as ca
import numpy as np
import pytest

from beamdae.beams import sliding
from beamdae.bounded_cache import array_bytes, bounded_cache
from beamdae.linear import pivots
from beamdae.symbolic.functions.compiled import MAX_MAPPED_FUNCTIONS, RowFunction


def counting(limit):
    calls = []

    @bounded_cache(limit, len)
    def letters(count, letter="a"):
        calls.append(count)
        return letter * count

    return letters, calls


def test_latest_results_up_to_the_limit_are_kept():
    letters, calls = counting(6)
    assert letters(3) is letters(3)
    assert letters(2) == "aa"
    letters(3)
    letters(2, letter="b")
    assert calls == [3, 2, 2]
    letters(3)
    letters(2, letter="b")
    assert calls == [3, 2, 2]
    letters(2)
    assert calls == [3, 2, 2, 2]


def test_larger_results_are_not_kept():
    letters, calls = counting(6)
    letters(2)
    letters(7)
    letters(7)
    letters(2)
    assert calls == [2, 7, 7]


def test_a_failure_is_not_kept():
    @bounded_cache(1.0, len)
    def fail():
        raise ZeroDivisionError

    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            fail()


def test_threads_obtain_the_same_result():
    barrier = threading.Barrier(4)

    @bounded_cache(10.0, lambda result: 1.0)
    def create():
        barrier.wait()
        return object()

    results = []
    threads = [threading.Thread(target=lambda: results.append(create())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(map(id, results))) == 1


def test_memory_of_arrays():
    arrays = (np.zeros(2), ("x", np.zeros(3, np.uint8)), 5)
    assert array_bytes(arrays) == 19.0


def held_bytes(cached):
    cells = dict(zip(cached.__code__.co_freevars, cached.__closure__, strict=True))
    return sum(size for _, size in cells["results"].cell_contents.values())


@pytest.mark.parametrize("function", [sliding._extension_matrix, sliding._uneven_coefficients])
def test_weights_of_points_of_many_meshes_are_bounded(function):
    for count in range(200, 206):
        argument = count
        if function is sliding._uneven_coefficients:
            argument = tuple(np.linspace(0.0, 1.0, count).tolist())
        function(argument)
    assert 0 < held_bytes(function) <= sliding._MAX_CACHED_BYTES


def test_plans_are_bounded():
    assert held_bytes(pivots._cached_order_pattern) <= pivots._MAX_CACHED_BYTES


def test_the_latest_mapped_functions_are_kept():
    x = ca.SX.sym("x")
    rows = RowFunction(ca.Function("square", [x], [x**2]))
    for count in range(1, MAX_MAPPED_FUNCTIONS + 5):
        values = np.arange(float(count))[:, None]
        assert (rows(values) == values**2).all()
    assert len(rows._mapped_functions) == MAX_MAPPED_FUNCTIONS
    assert (count,) in rows._mapped_functions


def test_regression_new_results_do_not_read_the_sizes_of_all_others():
    """The sum over all results made each of thousands of models slower than the one before."""
    additions = []

    class Size(float):
        def __radd__(self, other):
            additions.append(other)
            return other + float(self)

        def __rsub__(self, other):
            additions.append(other)
            return other - float(self)

    @bounded_cache(50.0, lambda result: Size(1.0))
    def square(x):
        return x**2

    assert [square(x) for x in range(100)] == [x**2 for x in range(100)]
    assert len(additions) == 150
