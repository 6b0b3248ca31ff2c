"""IDA by its C interface takes the steps it takes through scikit-sundae, to the last bit."""

import gc
import sys
import threading
from types import SimpleNamespace

import hub_beam
import numpy as np
import pendulum
import pytest
from sundials.both_ways import Direct, Robertson, same, wrapped
from support import use_scikit_sundae

import beamdae as bd
from beamdae.integrators.ida import python_solver as preconditioned
from beamdae.sundials import solver as solver_module
from beamdae.sundials.library import load_library
from beamdae.sundials.solver import IdaError, IdaSolver, IdaStatistics, describe_status


@pytest.mark.parametrize(
    "options",
    [{}, {"max_order": 2}, {"max_order": 1, "rtol": 1e-3}, {"max_step": 1e4}, {"first_step": 10.0}],
    ids=str,
)
def test_robertson_takes_the_same_steps(options):
    one, other = Robertson(), Robertson()
    expected, found = one.run(wrapped, **options), other.run(Direct, **options)
    assert expected[-1][:2] == (1, 4e6)
    assert len(expected) > 100
    assert same(found, expected)
    assert other.calls == one.calls
    # Concentrations add up to one at the end, so it was not the same nonsense twice.
    assert found[-1][2].sum() == pytest.approx(1.0, abs=1e-9)


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
def test_a_beam_takes_the_same_steps(monkeypatch, equations, settings):
    """Newton's linear algebra is done by `PreconditionedResidual`, in IDA's own vectors."""
    taken = {}

    def recording(kind):
        steps = taken[kind] = []

        def made(newton, size, **options):
            solver = kind(newton.residual, jacfn=newton.jacobian, **options)

            def step(*arguments):
                result = solver.step(*arguments)
                steps.append((result.status, result.t, result.y, result.yp))
                return result

            return SimpleNamespace(init_step=solver.init_step, step=step)

        return made

    use_scikit_sundae(monkeypatch)
    made = bd.equations_of_motion(equations)
    for kind in (wrapped, Direct):
        monkeypatch.setattr(preconditioned, "_solver", recording(kind))
        solution = bd.simulate(made, settings, 0.3)
        assert solution.status.success
    assert len(taken[wrapped]) > 50
    assert same(taken[Direct], taken[wrapped])


def test_a_solver_that_starts_again_is_as_good_as_new():
    problem = Robertson()
    direct = problem.made(Direct)
    direct.init_step(0.0, problem.y0, problem.yp0)
    for _ in range(50):
        direct.step(1e3, "onestep", 1e3)
    problem.inverse = np.eye(3)
    again = problem.run(lambda *_, **__: direct)
    assert same(again, Robertson().run(Direct))
    assert direct.solver.statistics.steps == len(again)


def test_four_threads_at_once_get_the_same_answers():
    expected = Robertson().run(Direct)
    found, together = [None] * 4, threading.Barrier(4)

    def run(number):
        together.wait(10.0)
        found[number] = Robertson().run(Direct)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(same(one, expected) for one in found)


def test_what_ida_counts():
    problem = Robertson()
    direct = problem.made(Direct)
    direct.init_step(0.0, problem.y0, problem.yp0)
    assert direct.solver.statistics == IdaStatistics(*[0] * 10, 0.0, direct.solver.statistics[-1])
    orders, times = set(), [0.0]
    while direct.step(40.0, "onestep", 40.0).status == 0:
        counted = direct.solver.statistics
        orders.add(counted.last_order)
        times.append(direct.solver.t)
        assert counted.last_step == pytest.approx(times[-1] - times[-2], rel=1e-9)
        assert counted.next_step > 0.0
    counted = direct.solver.statistics
    assert counted.steps == len(times)
    assert counted.residuals == problem.calls
    assert counted.jacobians == counted.setups > 1
    assert counted.newton_iterations >= counted.steps
    assert orders >= {1, 2, 3, 4}


def test_failed_error_tests_and_failed_iterations_are_counted():
    long = Robertson().made(Direct, first_step=10.0)
    long.init_step(0.0, Robertson.y0, Robertson.yp0)
    assert long.step(40.0, "onestep", 40.0).status == 0
    counted = long.solver.statistics
    assert counted.error_test_failures + counted.failed_solves > 0
    assert counted.last_step < 10.0


def test_local_errors_and_their_weights():
    problem = Robertson()
    direct = problem.made(Direct)
    direct.init_step(0.0, problem.y0, problem.yp0)
    for _ in range(30):
        before = direct.solver.y.copy()
        direct.step(40.0, "onestep", 40.0)
    errors, weights = direct.solver.local_errors(), direct.solver.error_weights()
    # Weights are those of the state the step began at.
    assert weights == pytest.approx(1.0 / (1e-6 * np.abs(before) + problem.atol), rel=1e-12)
    # The error test was passed.
    assert 0.0 < np.sqrt(np.mean((errors * weights) ** 2)) <= 6.0


class Failing(Robertson):
    """Not finite from some call on."""

    def _raw(self, y, yp):
        return super()._raw(y, yp) if self.calls < 50 else np.full(3, np.nan)


def test_a_residual_that_is_not_finite_ends_as_it_does_through_scikit_sundae(capfd):
    expected = Failing().run(wrapped)
    assert "IDA" in capfd.readouterr().out
    found = Failing().run(Direct)
    assert capfd.readouterr() == ("", "")
    assert describe_status(found[-1][0]).startswith("Newton's iteration failed")
    assert len(found) > 5
    assert same(found, expected)


def test_codes_become_reasons(monkeypatch):
    assert describe_status(-3) == "the error test failed too often, or at the smallest step"
    assert describe_status(-77) == "error -77 of SUNDIALS"
    direct = Robertson().made(Direct)
    with pytest.raises(IdaError, match=r"^IDASetMaxStep: an argument is out of"):
        Robertson().made(Direct, max_step=-1.0)
    direct.init_step(0.0, Robertson.y0, Robertson.yp0)
    direct.step(1.0, "onestep", 1.0)
    with pytest.raises(IdaError, match=r"^IDASetStopTime: an argument is out of"):
        direct.solver.step(-1.0)
    # -3 is an argument out of range there, and no failed error test.
    monkeypatch.setattr(load_library().call, "IDASetJacFn", lambda *_: -3)
    with pytest.raises(IdaError, match=r"^IDASetJacFn: error -3 of SUNDIALS$"):
        Robertson().made(Direct)


FREED = ["IDAFree", "SUNLinSolFree", "SUNMatDestroy", *["N_VDestroy"] * 3, "SUNContext_Free"]


@pytest.fixture
def freed(monkeypatch):
    """Names of what was freed, in order."""
    names, found = [], load_library()

    def watched(name):
        function = getattr(found.call, name)

        def call(*arguments):
            names.append(name)
            return function(*arguments)

        return call

    call = SimpleNamespace(**{**vars(found.call), **{name: watched(name) for name in set(FREED)}})
    monkeypatch.setattr(solver_module, "load_library", lambda: SimpleNamespace(call=call))
    return names


def test_everything_is_freed_once_in_the_reverse_order(freed):
    direct = Robertson().made(Direct)
    assert freed == []
    del direct
    gc.collect()
    # Not before somebody asks for memory again, where an interrupt is heard.
    assert freed == []
    another = Robertson().made(Direct)
    assert freed == FREED
    del another


def test_everything_is_freed_after_an_error(freed, monkeypatch):
    with pytest.raises(IdaError):
        Robertson().made(Direct, max_order=0)
    assert freed == FREED
    freed.clear()
    monkeypatch.setattr(solver_module.load_library().call, "SUNBandMatrix", lambda *_: None)
    with pytest.raises(MemoryError, match="SUNBandMatrix"):
        Robertson().made(Direct)
    assert freed == FREED[3:]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_large_systems_take_memory_in_proportion():
    size = 100_000
    before = resident()
    solver = IdaSolver(1, 1, rtol=1e-6, atol=np.ones(size), max_order=5, max_step=1.0)
    solver.start(0.0, np.ones(size), np.zeros(size), 1e-3)
    assert resident() - before < 100 * 8 * size


def resident():
    """Memory in use [bytes]."""
    with open("/proc/self/statm") as pages:
        return int(pages.read().split()[1]) * 4096
