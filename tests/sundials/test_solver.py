"""IDA has the same steps through its C interface and through scikit-sundae, bit by bit."""

import sys
import threading

import numpy as np
import pytest
from sundials.robertson import DirectIda, Robertson, create_sksundae_ida, steps_are_equal

from beamdae.sundials.solver import IdaSolver, describe_status


@pytest.mark.parametrize(
    "options",
    [{}, {"max_order": 2}, {"max_order": 1, "rtol": 1e-3}, {"max_step": 1e4}, {"first_step": 10.0}],
    ids=str,
)
def test_robertson_has_the_same_steps(options):
    one, other = Robertson(), Robertson()
    expected, result = one.run(create_sksundae_ida, **options), other.run(DirectIda, **options)
    assert expected[-1][:2] == (1, 4e6)
    assert len(expected) > 100
    assert steps_are_equal(result, expected)
    assert other.calls == one.calls
    # Concentrations add up to one: both runs are right.
    assert result[-1][2].sum() == pytest.approx(1.0, abs=1e-9)


def test_restarted_solver_equals_a_new_one():
    problem = Robertson()
    direct = problem.create(DirectIda)
    direct.init_step(0.0, problem.y0, problem.yp0)
    for _ in range(50):
        direct.step(1e3, "onestep", 1e3)
    problem.inverse = np.eye(3)
    again = problem.run(lambda *_, **__: direct)
    assert steps_are_equal(again, Robertson().run(DirectIda))
    assert direct.solver.statistics.steps == len(again)


def test_four_threads_get_the_same_results():
    expected = Robertson().run(DirectIda)
    results, together = [None] * 4, threading.Barrier(4)

    def run(number):
        together.wait(10.0)
        results[number] = Robertson().run(DirectIda)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(steps_are_equal(one, expected) for one in results)


class Failing(Robertson):
    """Returns NaN from the 50th call on."""

    def _raw(self, y, yp):
        return super()._raw(y, yp) if self.calls < 50 else np.full(3, np.nan)


def test_nan_residual_ends_as_with_scikit_sundae(capfd):
    expected = Failing().run(create_sksundae_ida)
    assert "IDA" in capfd.readouterr().out
    result = Failing().run(DirectIda)
    assert capfd.readouterr() == ("", "")
    assert describe_status(result[-1][0]).startswith("Newton's iteration failed")
    assert len(result) > 5
    assert steps_are_equal(result, expected)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_proportional_to_size():
    size = 100_000
    before = read_resident_memory()
    solver = IdaSolver(1, 1, rtol=1e-6, atol=np.ones(size), max_order=5, max_step=1.0)
    solver.start(0.0, np.ones(size), np.zeros(size), 1e-3)
    assert read_resident_memory() - before < 100 * 8 * size


def read_resident_memory():
    """Memory in use [bytes]."""
    with open("/proc/self/statm") as pages:
        return int(pages.read().split()[1]) * 4096
