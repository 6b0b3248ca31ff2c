"""IDA: vectors, memory and output of its solvers, pivots and the step report."""

import _thread
import gc
import io
import operator
import sys
import threading
import weakref

import numpy as np
import pytest
from benchmarks.cases import PENDULUM
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from sksundae.ida import IDA
from spin_up import spin_up
from support import use_scikit_sundae

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.integrators import compiled_run
from beamdae.integrators.ida import compiled_solver, ida, python_solver, stepper
from beamdae.integrators.ida.python_solver import SksundaeCallbacks, suppress_stdout
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.pivots import propose_plans
from beamdae.native.object_code import is_native_enabled
from beamdae.results.run_checks import skip_error_estimates

compiled = pytest.mark.skipif(not is_native_enabled(), reason="without machine code")


class Copying(IDA):
    """scikit-sundae's class with copies of IDA's vectors, copied back after each call."""

    def __init__(self, residual, **options):
        def copied(t, y, yp, out):
            mine = np.array(out)
            residual(t, np.array(y), np.array(yp), mine)
            out[:] = mine

        super().__init__(copied, **options)


def test_regression_sksundae_with_copied_vectors_is_rejected(monkeypatch):
    """Runs were off by 600 rtol, without any warning."""
    use_scikit_sundae(monkeypatch)
    monkeypatch.setattr(python_solver, "IDA", Copying)
    with pytest.raises(bd.BeamdaeError, match=r"^Ida: scikit-sundae .* copies the vectors of IDA"):
        bd.simulate(PENDULUM.equations, bd.Ida(rtol=1e-6), 1.0)


@pytest.fixture
def callbacks(monkeypatch):
    """Callbacks of the runs, in order."""
    callbacks = []

    class Watched(SksundaeCallbacks):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            callbacks.append(self)

    use_scikit_sundae(monkeypatch)
    monkeypatch.setattr(python_solver, "SksundaeCallbacks", Watched)
    return callbacks


@pytest.mark.parametrize("formulation", ida.FIRST_ORDER)
def test_installed_sksundae_shares_its_vectors(formulation, callbacks):
    settings = bd.Ida(rtol=1e-6, formulation=formulation, error_control="positions")
    assert bd.simulate(PENDULUM.equations, settings, 0.5).status.success
    assert callbacks[0]._vectors_are_shared


@pytest.mark.slow(reason="half a second")
def test_regression_solver_memory_does_not_grow_with_the_run(callbacks):
    """The time of every residual was stored, gigabytes in a long run."""
    for t_end in (0.1, 2.0):
        solution = bd.simulate(PENDULUM.equations, bd.Ida(rtol=1e-6), t_end)
    assert solution.statistics.residual_calls > 200
    # The first is the pilot run of the short run, the last is the long run.
    short, long = ({k: np.size(v) for k, v in vars(callbacks[k]).items()} for k in (0, -1))
    assert short == long


def test_regression_overlapping_runs_restore_stdout():
    before = sys.stdout
    inside, turns = threading.Barrier(3), [threading.Event() for _ in range(4)]
    turns[0].set()

    def run(number):
        arrivals = []

        def meet(t):
            # All start before any of them ends, and they end in the order of their starts.
            if not arrivals:
                arrivals.append(inside.wait(10.0))
                turns[number].wait(10.0)

        bd.simulate(PENDULUM.build().equations, bd.Ida(rtol=1e-7), 1.0, progress=meet)
        turns[number + 1].set()

    threads = [threading.Thread(target=run, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not inside.broken
    assert sys.stdout is before


def test_stdout_is_suppressed_for_one_thread_only(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    entered, spoken = threading.Event(), threading.Event()

    def quiet():
        with suppress_stdout:
            entered.set()
            spoken.wait(5.0)
            sys.stdout.write("unheard")

    thread = threading.Thread(target=quiet)
    thread.start()
    entered.wait(5.0)
    sys.stdout.write("heard")
    spoken.set()
    thread.join()
    assert sys.stdout is stream
    assert stream.getvalue() == "heard"


def test_sundials_prints_nothing(capfd):
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("body", 1.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", body.point, (lambda t: np.sqrt(0.5 - t), 0.0)))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), 1.0)
    assert solution.status.kind == "failed"
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow(reason="half a second and more")
def test_regression_memory_of_large_systems_does_not_grow_with_their_square(monkeypatch):
    """At 1024 elements a full matrix for the identity took 6 GB and most of the time."""
    sizes = {}

    def make_watched(residual, **options):
        def jacobian(t, y, yp, res, c, out):
            sizes[y.size] = out.size
            options["jacfn"](t, y, yp, res, c, out)

        return IDA(residual, **{**options, "jacfn": jacobian})

    use_scikit_sundae(monkeypatch)
    monkeypatch.setattr(python_solver, "IDA", make_watched)
    for bodies in (2, 30):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        before = mech.ground.at(0.0, 0.0)
        for k in range(bodies):
            rod = mech.add(bd.RigidBody(f"rod {k}", mass=1.0, inertia=0.1, center=(k + 0.5, 0.0)))
            mech.add(bd.Revolute(f"pin {k}", before, rod.at(float(k), 0.0)))
            before = rod.at(k + 1.0, 0.0)
        solution = bd.simulate(mech, bd.Ida(rtol=1e-3), 0.01)
        assert solution.status.success
    (small, few), (large, many) = sorted(sizes.items())
    assert few == small**2
    assert many == large


def test_unstable_max_order_does_not_affect_the_pilot_run():
    # BDF of order 5 amplifies undamped modes: a pilot run of that order saw 7 times the motion.
    solutions = [
        bd.simulate(hub_beam(elements=4), bd.Ida(1e-4, max_order=k, max_steps=5), t_end=2.0)
        for k in ("auto", 5)
    ]
    assert solutions[0].integrator["amplitudes"] == solutions[1].integrator["amplitudes"]
    assert solutions[1].integrator["max_order"] == 5


UNDAMPED, DAMPED = (bd.equations_of_motion(hub_beam(elements=2, damping=d)) for d in (0.0, 0.01))


@pytest.mark.slow(reason="half a second")
@compiled
@pytest.mark.parametrize("formulation", ida.FIRST_ORDER)
@pytest.mark.parametrize("equations", [UNDAMPED, DAMPED], ids=["undamped", "damped"])
def test_compiled_steps_equal_sksundae_steps(equations, formulation, monkeypatch):
    settings = bd.Ida(1e-5, formulation=formulation)
    one = bd.simulate(equations, settings, 0.1)
    use_scikit_sundae(monkeypatch)
    other = bd.simulate(equations, settings, 0.1)
    assert one.integrator["ida"] == "shared libraries"
    assert other.integrator["ida"] == "scikit-sundae"
    # Factors differ by rounding, and eventually steps do, too.
    assert_allclose(one.statistics.steps, other.statistics.steps, rtol=0.1)
    (a,), (b,) = (solution.trajectory.intervals for solution in (one, other))
    assert_allclose(a.t[:20], b.t[:20], rtol=1e-6)
    assert_allclose(a.state.q[:20], b.state.q[:20], rtol=0.0, atol=1e-10)
    assert_allclose(one.q, other.q, rtol=0.0, atol=10.0 * settings.rtol)


@compiled
@pytest.mark.parametrize("formulation", ida.FIRST_ORDER)
def test_step_report_lists_orders_and_limiting_unknowns(formulation):
    settings = bd.Ida(1e-4, formulation=formulation, error_control="velocities", max_order=3)
    solution = bd.simulate(PENDULUM.equations, settings, 2.0)
    report, counts = solution.integrator, solution.statistics
    assert sum(report["orders"].values()) == counts.steps
    assert {"1", "2"} <= set(report["orders"]) <= {"1", "2", "3"}
    assert 0 < report["error_test_failures"] <= counts.rejected_steps
    assert counts.factorizations == counts.jacobian_calls > 1
    names = set(
        formulate_first_order(PENDULUM.equations, formulation).names[: 2 * PENDULUM.equations.n]
    )
    assert 1 <= len(report["limited_by"]) <= 3
    assert set(report["limited_by"]) <= names
    assert 1.0 / 3.0 < sum(report["limited_by"].values()) <= 1.0 + 1e-9


@compiled
def test_limiting_unknown_is_the_moving_coordinate():
    mech = bd.Mechanism()
    for name, rate in (("slow", 0.1), ("fast", 30.0)):
        ball = mech.add(bd.PointMass(name, 1.0, at=(0.0, 0.0)))
        mech.add(bd.Force(f"push {name}", ball.point, (bd.sine(rate**2, rate), 0.0)))
    equations = bd.equations_of_motion(mech)
    solution = bd.simulate(equations, bd.Ida(1e-5, error_control="positions"), 2.0)
    assert solution.integrator["limited_by"]["fast.x"] > 0.8


@pytest.mark.parametrize("formulation", ida.FIRST_ORDER)
def test_all_unknowns_have_names(formulation):
    form = formulate_first_order(UNDAMPED, formulation)
    assert len(set(form.names)) == form.size


@compiled
def test_failures_before_a_restart_are_counted():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    violent = bd.piecewise((0.5, lambda t: 1e3 * np.sin(60.0 * t) ** 9), 0.0)
    mech.add(bd.Force("push", ball.point, (violent, 0.0)))
    equations = bd.equations_of_motion(mech)
    first, both = (bd.simulate(equations, bd.Ida(1e-3), t_end) for t_end in (0.5, 1.0))
    assert len(both.trajectory.intervals) == 2
    failures = both.integrator["error_test_failures"]
    # The second interval is at rest.
    assert failures > 0.5 * first.integrator["error_test_failures"] > 10


class CountedProposals:
    """Pivot proposals whose first ones are unusable; counts the requests."""

    def __init__(self, spoiled=0):
        self.calls, self._spoiled = 0, spoiled

    def __call__(self, pattern, nonzeros, in_blocks):
        self.calls += 1
        for plan in propose_plans(pattern, nonzeros, in_blocks):
            if self._spoiled:
                self._spoiled -= 1
                yield plan._replace(scale=np.zeros_like(plan.scale))
            yield plan


@compiled
def test_pivots_of_the_pilot_run_are_reused(monkeypatch):
    proposals = CountedProposals()
    monkeypatch.setattr(compiled_run, "propose_plans", proposals)
    with skip_error_estimates():
        solution = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.2)
    assert solution.statistics.jacobian_calls > 2
    assert proposals.calls == 1


@pytest.mark.slow(reason="a quarter of a second")
@compiled
def test_failing_pivots_do_not_change_the_steps(monkeypatch):
    expected = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.2)
    proposals = CountedProposals(spoiled=1)
    monkeypatch.setattr(compiled_run, "propose_plans", proposals)
    with skip_error_estimates():
        solution = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.2)
    assert proposals.calls == 1
    assert proposals._spoiled == 0
    assert_allclose(solution.q, expected.q, rtol=0.0, atol=0.0)
    assert solution.statistics.steps == expected.statistics.steps


@pytest.mark.slow(reason="a quarter of a second")
@compiled
def test_pivots_are_replaced_during_a_run(monkeypatch):
    settings = bd.Ida(1e-4, formulation="ggl")
    expected = bd.simulate(DAMPED, settings, 0.2)
    proposals, calls = CountedProposals(), []
    monkeypatch.setattr(compiled_run, "propose_plans", proposals)
    advance = compiled_solver.CompiledIda.advance

    def spoiling(self, most):
        calls.append(None)
        if len(calls) == 5:
            # An empty matrix cannot be eliminated; solutions with the current factors still work.
            self._newton.linear.plan.starts[:] = 0
        return advance(self, 8)

    monkeypatch.setattr(compiled_solver.CompiledIda, "advance", spoiling)
    with skip_error_estimates():
        solution = bd.simulate(DAMPED, settings, 0.2)
    assert solution.status.success
    assert proposals.calls == 2
    assert_allclose(solution.q, expected.q, rtol=0.0, atol=10.0 * settings.rtol)
    assert_allclose(solution.statistics.steps, expected.statistics.steps, rtol=0.1)


@compiled
def test_singular_jacobian_shortens_the_step(monkeypatch):
    failures = []

    def singular_once(pattern, nonzeros, in_blocks):
        if not failures:
            failures.append(None)
            raise SingularMatrixError("the matrix is singular")
        return propose_plans(pattern, nonzeros, in_blocks)

    monkeypatch.setattr(compiled_run, "propose_plans", singular_once)
    solution = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.1)
    assert failures
    assert solution.status.success


@pytest.mark.slow(reason="half a second and more")
@compiled
def test_permanently_singular_jacobian_fails_the_run(monkeypatch):
    def singular(*_):
        raise SingularMatrixError("the matrix is singular")

    monkeypatch.setattr(compiled_run, "propose_plans", singular)
    solution = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.1)
    assert solution.status.kind == "failed"
    assert solution.status.sentence.startswith("stopped at t = 0 s: ")


@compiled
@pytest.mark.parametrize("problem", [KeyboardInterrupt, MemoryError])
def test_exception_in_the_jacobian_is_raised_by_the_run(problem, monkeypatch, capfd):
    def raising(*_):
        raise problem

    monkeypatch.setattr(compiled_run, "propose_plans", raising)
    solution = bd.simulate(UNDAMPED, bd.Ida(1e-4), 0.1, partial="return")
    kinds = {KeyboardInterrupt: "interrupted", MemoryError: "limited"}
    assert solution.status.kind == kinds[problem]
    assert capfd.readouterr() == ("", "")


def test_pending_interrupt_is_caught_in_the_callback():
    """Python raises it as soon as the interpreter is entered, before the first line."""
    problems = []
    renewing = compiled_solver._pivot_renewal(None, None, None, problems)
    next(renewing)
    renew = compiled_solver._RENEW_CALLBACK(renewing.__next__)
    # No bytecode is executed between the two calls.
    (_, renewal_code) = map(operator.call, [_thread.interrupt_main, renew])
    assert renewal_code == 0
    assert [type(problem) for problem in problems] == [KeyboardInterrupt]
    renewing.close()


@pytest.mark.slow(reason="half a second")
@compiled
def test_regression_solver_is_freed_with_its_last_reference():
    """Memory of SUNDIALS is freed at once, not by the garbage collector."""
    references = []
    make_solver = stepper._make_solver

    def make_watched(*arguments):
        solver = make_solver(*arguments)
        references.append(weakref.ref(solver._solver))
        return solver

    gc.disable()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stepper, "_make_solver", make_watched)
            bd.simulate(UNDAMPED, bd.Ida(1e-3), 0.02)
        assert references
        assert all(reference() is None for reference in references)
    finally:
        gc.enable()


@pytest.mark.slow(reason="half a second")
@compiled
def test_regression_old_factors_do_not_reduce_the_steps():
    """Newton errors from factors of 500 earlier steps excited vibrations: 26 395 steps."""
    equations = spin_up(elements=4, formulation="exact")
    run = bd.simulate(equations, bd.Ida(rtol=1e-4), 10.0)
    assert run.statistics.steps < 18_000  # 15 230 with 20 to 100 steps per factorization
    assert run.statistics.factorizations > run.statistics.steps / 50
