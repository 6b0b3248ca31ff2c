"""Caches are bounded by the total size of their results."""

import threading

import numpy as np
import pytest

from beamdae.bounded_cache import array_bytes, bounded_cache


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
