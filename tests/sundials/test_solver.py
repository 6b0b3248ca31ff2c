"""IDA has the same steps through its C interface and through scikit-sundae, bit by bit."""

import gc
import sys
import threading
from types import SimpleNamespace

import hub_beam
import numpy as np
import pendulum
import pytest
from sundials.robertson import DirectIda, Robertson, create_sksundae_ida, steps_are_equal
from support import use_scikit_sundae

import beamdae as bd
from beamdae.integrators.ida import python_solver
from beamdae.sundials import solver as solver_module
from beamdae.sundials.library import load_library
from beamdae.sundials.solver import IdaError, IdaSolver, IdaStatistics, describe_status


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


@pytest.mark.slow(reason="runs of a beam twice")
@pytest.mark.parametrize(
    ("equations", "settings"),
    [
        (hub_beam.hub_beam(elements=2), bd.Ida(rtol=1e-4)),
        (hub_beam.hub_beam(elements=2, damping=0.01), bd.Ida(rtol=1e-5, linear_solver="sparse")),
        (pendulum.pendulum(), bd.Ida(rtol=1e-4, formulation="ggl", max_order=5)),
    ],
    ids=["undamped", "damped", "ggl"],
)
def test_beam_has_the_same_steps(monkeypatch, equations, settings):
    """`SksundaeCallbacks` solves the linear systems of Newton's method in IDA's vectors."""
    steps_by_kind = {}

    def record_steps(kind):
        steps = steps_by_kind[kind] = []

        def create(callbacks, size, **options):
            solver = kind(callbacks.residual, jacfn=callbacks.jacobian, **options)

            def step(*arguments):
                result = solver.step(*arguments)
                steps.append((result.status, result.t, result.y, result.yp))
                return result

            return SimpleNamespace(init_step=solver.init_step, step=step)

        return create

    use_scikit_sundae(monkeypatch)
    model = bd.equations_of_motion(equations)
    for kind in (create_sksundae_ida, DirectIda):
        monkeypatch.setattr(python_solver, "_make_ida", record_steps(kind))
        solution = bd.simulate(model, settings, 0.3)
        assert solution.status.success
    assert len(steps_by_kind[create_sksundae_ida]) > 50
    assert steps_are_equal(steps_by_kind[DirectIda], steps_by_kind[create_sksundae_ida])


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


def test_statistics():
    problem = Robertson()
    direct = problem.create(DirectIda)
    direct.init_step(0.0, problem.y0, problem.yp0)
    assert direct.solver.statistics == IdaStatistics(*[0] * 9, 0.0, direct.solver.statistics[-1])
    orders, times = set(), [0.0]
    while direct.step(40.0, "onestep", 40.0).status == 0:
        statistics = direct.solver.statistics
        orders.add(statistics.last_order)
        times.append(direct.solver.t)
        assert statistics.last_step == pytest.approx(times[-1] - times[-2], rel=1e-9)
        assert statistics.next_step > 0.0
    statistics = direct.solver.statistics
    assert statistics.steps == len(times)
    assert statistics.residuals == problem.calls
    assert statistics.jacobians == statistics.setups > 1
    assert statistics.newton_iterations >= statistics.steps
    assert orders >= {1, 2, 3, 4}


def test_failures_are_counted():
    long = Robertson().create(DirectIda, first_step=10.0)
    long.init_step(0.0, Robertson.y0, Robertson.yp0)
    assert long.step(40.0, "onestep", 40.0).status == 0
    statistics = long.solver.statistics
    assert statistics.error_test_failures + statistics.failed_solves > 0
    assert statistics.last_step < 10.0


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


def test_status_codes_are_described(monkeypatch):
    assert describe_status(-3) == "the error test failed too often, or at the smallest step"
    assert describe_status(-77) == "error -77 of SUNDIALS"
    direct = Robertson().create(DirectIda)
    with pytest.raises(IdaError, match=r"^IDASetMaxStep: an argument is out of"):
        Robertson().create(DirectIda, max_step=-1.0)
    direct.init_step(0.0, Robertson.y0, Robertson.yp0)
    direct.step(1.0, "onestep", 1.0)
    with pytest.raises(IdaError, match=r"^IDASetStopTime: an argument is out of"):
        direct.solver.step(-1.0)
    # In linear solvers -3 means an argument out of range, not a failed error test.
    monkeypatch.setattr(load_library().call, "IDASetJacFn", lambda *_: -3)
    with pytest.raises(IdaError, match=r"^IDASetJacFn: error -3 of SUNDIALS$"):
        Robertson().create(DirectIda)


CLEANUP_CALLS = [
    "IDAFree",
    "SUNLinSolFree",
    "SUNMatDestroy",
    *["N_VDestroy"] * 3,
    "SUNContext_Free",
]


@pytest.fixture
def cleanup_calls(monkeypatch):
    """Names of the functions that free memory, in the order of calls."""
    names, sundials = [], load_library()

    def record_calls(name):
        function = getattr(sundials.call, name)

        def call(*arguments):
            names.append(name)
            return function(*arguments)

        return call

    call = SimpleNamespace(
        **{**vars(sundials.call), **{name: record_calls(name) for name in set(CLEANUP_CALLS)}}
    )
    monkeypatch.setattr(solver_module, "load_library", lambda: SimpleNamespace(call=call))
    return names


@pytest.mark.slow(reason="a quarter of a second")
def test_memory_is_freed_once_in_reverse_order(cleanup_calls):
    direct = Robertson().create(DirectIda)
    assert cleanup_calls == []
    del direct
    gc.collect()
    # Memory is freed when the next solver is created, where interrupts are handled.
    assert cleanup_calls == []
    another = Robertson().create(DirectIda)
    assert cleanup_calls == CLEANUP_CALLS
    del another


def test_memory_is_freed_after_an_error(cleanup_calls, monkeypatch):
    with pytest.raises(IdaError):
        Robertson().create(DirectIda, max_order=0)
    assert cleanup_calls == CLEANUP_CALLS
    cleanup_calls.clear()
    monkeypatch.setattr(solver_module.load_library().call, "SUNBandMatrix", lambda *_: None)
    with pytest.raises(MemoryError, match="SUNBandMatrix"):
        Robertson().create(DirectIda)
    assert cleanup_calls == CLEANUP_CALLS[3:]


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
