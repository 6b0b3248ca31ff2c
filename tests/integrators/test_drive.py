"""The driver of all methods: limits, breakpoints, step history, progress and interrupts."""

import threading
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
import threadpoolctl
from benchmarks.cases import PENDULUM
from hub_beam import hub_beam
from mechanisms import free_ball, symbols
from numpy.testing import assert_allclose
from own_method import OwnMethod

import beamdae as bd


def rolling():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    return bd.equations_of_motion(mech)


def rolling_state():
    return bd.simulate(rolling(), OwnMethod(), 0.01).trajectory.intervals[0].state


@pytest.mark.parametrize("steps", [1, 1023, 1024, 1025, 2048, 3000])
def test_history_keeps_any_number_of_rows(steps):
    solution = bd.simulate(rolling(), OwnMethod(step=1.0 / steps), 1.0)
    (interval,) = solution.trajectory.intervals
    assert len(interval.t) == steps + 1
    assert_allclose(interval.state.q[:, 0], interval.t, rtol=1e-12)


def with_stages(t, state, k, count=2):
    """Return a step to `t` with inner stages at these fractions of it."""
    return t, state, [(t - 0.01 * (1.0 - x), state) for x in (0.2, 0.6, 0.8)[:count]]


def test_inner_stages_are_not_counted_as_steps():
    solution = bd.simulate(rolling(), OwnMethod(change=with_stages), 1.0)
    (interval,) = solution.trajectory.intervals
    assert solution.statistics.steps == solution.trajectory.steps == 100
    assert_allclose(interval.t, np.linspace(0.0, 1.0, 101), rtol=1e-12)
    assert_allclose(interval.state.q[:, 0], interval.t, rtol=1e-12)
    assert_allclose(interval.nodes[:4], [0.0, 0.002, 0.006, 0.01], rtol=1e-12)


def infinite(state):
    return state._replace(q=np.nan * state.q)


ASCEND = "the stages of a step must ascend"
WRONG_STEPS = {
    "stuck": (lambda t, s: (0.04, s), "the step became too small to advance time"),
    "past the end": (lambda t, s: (2.0, s), "a step ended at t = 2 s, past the end"),
    "infinite": (lambda t, s: (np.inf, s), "a step ended at t = inf s, past the end"),
    "no number": (lambda t, s: (np.nan, s), "a step ended at t = nan s, past the end"),
    "not finite": (lambda t, s: (t, infinite(s)), "the state is not finite"),
    "stage not finite": (lambda t, s: (t, s, [(t - 0.005, infinite(s))]), "not finite"),
    "fewer stages": (lambda t, s: with_stages(t, s, 5, 2), ASCEND),
    "stage at the start": (lambda t, s: (t, s, [(t - 0.01, s)]), ASCEND),
    "stage at the end": (lambda t, s: (t, s, [(t, s)]), ASCEND),
}


@pytest.mark.parametrize(("step", "words"), WRONG_STEPS.values(), ids=WRONG_STEPS)
def test_regression_wrong_steps_end_the_run_and_are_dropped(step, words):
    """One such run never ended, others reached the end with meaningless tables."""
    has_stages = len(step(1.0, rolling_state())) == 3

    def change(t, state, k):
        usual = with_stages(t, state, k, 1) if has_stages else (t, state)
        return usual if k < 5 else step(t, state)

    solution = bd.simulate(rolling(), OwnMethod(change=change), 1.0)
    assert solution.status.kind == "failed"
    assert words in solution.status.sentence
    assert_allclose(solution.trajectory.end, 0.04)
    assert np.isfinite(solution.table().to_numpy()).all()


def test_time_limit_applies_after_every_step():
    solution = bd.simulate(rolling(), OwnMethod(step=0.1, time_limit=1e-9), 1.0)
    assert solution.status.kind == "limited"
    assert solution.statistics.steps == 1


@pytest.mark.parametrize("answer", [True, 1, None, "enough"])
def test_regression_only_a_string_from_progress_ends_a_run(answer):
    """Progress bars sometimes return True, which ended the run."""
    run = bd.simulate(rolling(), OwnMethod(step=1e-3), 1.0, progress=lambda t: answer)
    if answer == "enough":
        assert run.status.kind == "limited"
        assert run.status.sentence == "stopped at t = 0.064 s: enough"
    else:
        assert run.status.success


@pytest.mark.parametrize("breakpoints", [(0.3, np.nextafter(0.3, 1.0)), (0.1 + 0.2, 0.3)])
@pytest.mark.parametrize("t_end", [1.0, 0.3, 0.1 + 0.2])
def test_regression_times_that_differ_by_rounding_are_merged(breakpoints, t_end):
    """Ida raised a KeyError, generalized-alpha returned reactions of 1e18."""
    mech, ball = free_ball()
    for k, b in enumerate(breakpoints):
        law = bd.piecewise((b, 1.0), 0.0)
        mech.add(bd.Force(f"push {k}", ball.point, (law, 0.0)))
    for integrator in (bd.Ida(1e-6), bd.Radau(1e-6), bd.GeneralizedAlpha(1e-2)):
        solution = bd.simulate(mech, integrator, t_end)
        assert solution.status.success
        assert len(solution.trajectory.intervals) == (2 if t_end == 1.0 else 1)
        pushed = 0.3**2 + 0.6 * (t_end - 0.3)
        assert_allclose(solution.q[-1, 0], pushed, rtol=1e-5)


def threads_of_blas():
    pools = threadpoolctl.threadpool_info()
    return {pool["filepath"]: pool["num_threads"] for pool in pools if pool["user_api"] == "blas"}


def set_threads_of_blas(number):
    # Set by a thread that ends: until then no other thread could change them.
    change = threading.Thread(target=threadpoolctl.threadpool_limits, args=(number,))
    change.start()
    change.join()


@pytest.fixture
def two_threads_of_blas():
    """Set two BLAS threads, as on a machine of two cores; tests run with one."""
    set_threads_of_blas(2)
    before = threads_of_blas()
    assert set(before.values()) == {2}
    yield before
    set_threads_of_blas(1)


def test_regression_overlapping_runs_restore_blas_threads(two_threads_of_blas):
    inside, first_left = threading.Barrier(2), threading.Event()
    thread_counts = []

    def run(number):
        arrivals = []

        def meet(t):
            if not arrivals:
                arrivals.append(inside.wait(10.0))
                if number == 1:
                    first_left.wait(10.0)
                    thread_counts.append(threads_of_blas())

        bd.simulate(PENDULUM.build().equations, bd.Ida(rtol=1e-7), 1.0, progress=meet)
        first_left.set()

    runs = [threading.Thread(target=run, args=(number,)) for number in range(2)]
    for thread in runs:
        thread.start()
    for thread in runs:
        thread.join()
    assert not inside.broken
    assert {thread_counts[0][path] for path in two_threads_of_blas} == {1}
    assert two_threads_of_blas.items() <= threads_of_blas().items()


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        ([[1.0, 0.5], [0.0, 1.0]], "q.: the mass matrix is not symmetric .entries of this row"),
        ([-1.0, 1.0], "q0: the mass matrix has a negative eigenvalue of"),
        ([[1.0, 2.0], [2.0, 1.0]], r"q.: the mass matrix has a negative eigenvalue of"),
    ],
)
def test_regression_invalid_mass_matrix_is_rejected(mass, message):
    t, q, v = symbols(2)
    force = ca.vertcat(0.0, -1.0)
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=mass, force=force, q0=[1.0, 0.0], v0=[0, 0])
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(system, bd.Ida(), 1.0)


def test_regression_indefinite_masses_of_large_systems_are_rejected():
    """With more than 300 coordinates, only the signs of the diagonal were checked."""
    size = 310
    mass = np.eye(size)
    mass[[0, 1], [1, 0]] = 2.0
    t, q, v = symbols(size)
    zeros = np.zeros(size)
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=mass, force=-q, q0=zeros, v0=zeros)
    with pytest.raises(bd.BeamdaeError, match=r"q[01]: the mass matrix has a negative eigenvalue"):
        bd.simulate(system, bd.Ida(), 1.0)


@dataclass(frozen=True)
class Stepless(bd.Integrator):
    order = 1


def test_methods_without_a_step_are_rejected():
    with pytest.raises(bd.BeamdaeError, match=r"^Stepless: the settings have no step; add a field"):
        bd.simulate(rolling(), Stepless(), 1.0)


@pytest.mark.slow(reason="half a second")
def test_progress_during_the_pilot_run_gets_the_start_time():
    times = []
    mech = hub_beam(elements=2)
    bd.simulate(mech, bd.Ida(1e-4), t_end=0.2, progress=times.append)
    assert times[0] == 0.0
    assert times == sorted(times)
    assert times[-1] > 0.0


def test_interrupted_pilot_run_is_named_in_the_status():
    def interrupt(t):
        raise KeyboardInterrupt

    with pytest.raises(bd.Interrupted) as caught:
        bd.simulate(hub_beam(elements=2), bd.Ida(1e-4), t_end=0.2, progress=interrupt)
    solution = caught.value.solution
    assert solution.status.kind == "interrupted"
    # The rows have the tolerance of the pilot run.
    assert "of the pilot run with rtol = 0.01" in solution.status.sentence


@pytest.mark.slow(reason="one second")
def test_progress_can_stop_the_pilot_run():
    times = []

    def enough(t):
        times.append(t)
        return "enough"

    solution = bd.simulate(hub_beam(elements=2), bd.Ida(1e-4), t_end=0.2, progress=enough)
    assert solution.status.kind == "limited"
    assert solution.status.sentence.endswith(" s: enough")
    assert len(times) == 2
