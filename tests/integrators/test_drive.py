"""The driver of all methods: limits, breakpoints, step history, progress and interrupts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pytest
import threadpoolctl
from benchmarks.cases import PENDULUM
from hub_beam import hub_beam
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.equations.equations_of_motion import State
from beamdae.integrators import drive as drive_module
from beamdae.integrators import step_history
from beamdae.integrators.integrator import Accuracy
from beamdae.integrators.method import clip_step
from beamdae.integrators.run_plan import plan_run
from beamdae.linear import blas_threads
from beamdae.results.outcome import Statistics
from beamdae.simulation import skip_result_checks


class Rolling:
    """Steps of a particle at constant speed; `slip` changes the result of a step."""

    steps_per_check = 64
    resolved_options = {}  # noqa: RUF012 as the protocol has it
    counts = Statistics()

    def __init__(self, settings):
        self.settings = settings

    def begin(self, start, end, branch, state):
        self.t, self.end, self.state, self.step_count = start, end, state, 0

    def step(self):
        self.step_count += 1
        h = clip_step(self.settings.step, self.end - self.t)
        self.t = self.end if h == self.end - self.t else self.t + h
        q = self.state.q + h * self.state.v
        self.state = self.state._replace(q=q)
        return self.settings.slip(self.t, self.state, self.step_count)


@dataclass(frozen=True)
class Roll(bd.Integrator):
    step: float = 0.01
    slip: object = field(default=lambda t, state, k: (t, state))
    max_steps: object = None
    time_limit: object = None
    order = 1

    def method_on(self, plan):
        return Rolling(self)


def rolling():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.parametrize("steps", [1, 1023, 1024, 1025, 2048, 3000])
def test_history_keeps_any_number_of_rows(steps):
    solution = bd.simulate(rolling(), Roll(step=1.0 / steps), 1.0)
    (interval,) = solution.trajectory.intervals
    assert len(interval.t) == steps + 1
    assert_allclose(interval.state.q[:, 0], interval.t, rtol=1e-12)


@pytest.mark.parametrize(
    ("slip", "words"),
    [
        (lambda t, s, k: (t if k < 5 else 0.04, s), "the step became too small to advance time"),
        (lambda t, s, k: (t if k < 5 else 2.0, s), "a step ended at t = 2 s, past the end"),
        (lambda t, s, k: (t if k < 5 else np.inf, s), "a step ended at t = inf s, past the end"),
        (lambda t, s, k: (t if k < 5 else np.nan, s), "a step ended at t = nan s, past the end"),
    ],
    ids=["stuck", "past the end", "infinite", "no number"],
)
def test_regression_method_with_invalid_times_fails(slip, words):
    """One such run never ended, the others reached the end with meaningless tables."""
    solution = bd.simulate(rolling(), Roll(slip=slip), 1.0)
    assert solution.status.kind == "failed"
    assert f"stopped at t = 0.04 s: {words}" in solution.status.sentence
    assert_allclose(solution.trajectory.end, 0.04)


def test_regression_nonfinite_states_fail_the_run():
    def slip(t, state, k):
        return t, state if k < 5 else State(*(np.nan * x for x in state))

    solution = bd.simulate(rolling(), Roll(slip=slip), 1.0)
    assert solution.status.kind == "failed"
    assert "the state is not finite" in solution.status.sentence
    # The valid steps are kept.
    assert_allclose(solution.trajectory.end, 0.04)
    assert np.isfinite(solution.table().to_numpy()).all()


def with_stages(t, state, k, count=2):
    """Return a step to `t` with inner stages at these fractions of it."""
    return t, state, [(t - 0.01 * (1.0 - x), state) for x in (0.2, 0.6, 0.8)[:count]]


def test_inner_stages_are_not_counted_as_steps():
    solution = bd.simulate(rolling(), Roll(slip=with_stages), 1.0)
    (interval,) = solution.trajectory.intervals
    assert solution.statistics.steps == solution.trajectory.steps == 100
    assert_allclose(interval.t, np.linspace(0.0, 1.0, 101), rtol=1e-12)
    assert_allclose(interval.state.q[:, 0], interval.t, rtol=1e-12)
    assert_allclose(interval.nodes[:4], [0.0, 0.002, 0.006, 0.01], rtol=1e-12)


@pytest.mark.parametrize(
    "slip",
    [
        lambda t, s, k: with_stages(t, s, k, 2 if k < 5 else 1),
        lambda t, s, k: (t, s, [(t - 0.01, s)]) if k == 5 else (t, s, [(t - 0.005, s)]),
        lambda t, s, k: (t, s, [(t, s)]) if k == 5 else (t, s, [(t - 0.005, s)]),
    ],
    ids=["fewer", "at the start", "at the end"],
)
def test_unordered_stages_end_the_run(slip):
    solution = bd.simulate(rolling(), Roll(slip=slip), 1.0)
    assert solution.status.kind == "failed"
    assert "stopped at t = 0.04 s: the stages of a step must ascend" in solution.status.sentence
    assert_allclose(solution.trajectory.end, 0.04)


@pytest.mark.parametrize(("bad", "end"), [(1, 0.0), (5, 0.04)])
def test_step_with_a_nonfinite_stage_is_dropped_entirely(bad, end):
    def slip(t, state, k):
        t, state, stages = with_stages(t, state, k)
        stages[1] = stages[1] if k < bad else (stages[1][0], State(*(np.nan * x for x in state)))
        return t, state, stages

    solution = bd.simulate(rolling(), Roll(slip=slip), 1.0)
    assert solution.status.kind == "failed"
    assert_allclose(solution.trajectory.end, end)
    assert np.isfinite(solution.table().to_numpy()).all()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"max_steps": 0}, "Roll: max_steps must be a whole number of at least 1, got 0"),
        ({"time_limit": "10"}, "Roll: time_limit must be a number, got '10'"),
    ],
)
def test_limits_of_any_integrator_are_checked(limits, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(rolling(), Roll(**limits), 1.0)


def test_time_limit_applies_after_every_step():
    solution = bd.simulate(rolling(), Roll(step=0.1, time_limit=1e-9), 1.0)
    assert solution.status.kind == "limited"
    assert solution.statistics.steps == 1


@pytest.mark.parametrize("answer", [True, 1, 0.5, [1], None])
def test_regression_only_a_string_from_progress_ends_a_run(answer):
    """Progress bars sometimes return True, which ended the run."""
    run = bd.simulate(rolling(), Roll(step=1e-3), 1.0, progress=lambda t: answer)
    assert run.status.success


def test_string_from_progress_ends_the_run():
    run = bd.simulate(rolling(), Roll(step=1e-3), 1.0, progress=lambda t: "enough")
    assert run.status.kind == "limited"
    assert run.status.sentence == "stopped at t = 0.064 s: enough"


def test_regression_interrupt_while_history_grows_leaves_only_complete_rows(monkeypatch):
    rows = step_history.StepHistory(0.0, State(*(np.ones(2) for _ in range(4))))
    for k in range(1, 1024):
        rows.append(float(k), State(*(np.ones(2) for _ in range(4))))

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(step_history.np, "concatenate", interrupt)
        with pytest.raises(KeyboardInterrupt):
            rows.append(1024.0, State(*(np.ones(2) for _ in range(4))))
    interval = rows.interval(0.5)
    assert_allclose(interval.t, np.arange(1024.0))
    assert_allclose(interval.state.q, 1.0)


@pytest.mark.parametrize("breakpoints", [(0.3, np.nextafter(0.3, 1.0)), (0.1 + 0.2, 0.3)])
@pytest.mark.parametrize("t_end", [1.0, 0.3, 0.1 + 0.2])
def test_regression_times_that_differ_by_rounding_are_merged(breakpoints, t_end):
    """Ida raised a KeyError, generalized-alpha returned reactions of 1e18."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    for k, b in enumerate(breakpoints):
        law = bd.piecewise((b, 1.0), 0.0)
        mech.add(bd.Force(f"push {k}", ball.point, (law, 0.0)))
    plan = plan_run(bd.equations_of_motion(mech), np.array([0.0, t_end]))
    assert len(plan.intervals) == (2 if t_end == 1.0 else 1)
    for integrator in (bd.Ida(1e-6), bd.Radau(1e-6), bd.GeneralizedAlpha(1e-2)):
        solution = bd.simulate(mech, integrator, t_end)
        assert solution.status.success
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


def test_regression_bode_diagrams_use_one_blas_thread(two_threads_of_blas, monkeypatch):
    """On two cores, diagrams of models with 240 states took 11 s instead of 2 s."""
    counts = []
    evaluate = LinearModel._evaluate_response

    def count_threads(model, values):
        counts.append(set(threads_of_blas().values()))
        return evaluate(model, values)

    monkeypatch.setattr(LinearModel, "_evaluate_response", count_threads)
    mech = bd.Mechanism()
    mech.state("level", mech.input("valve"))
    bd.bode(bd.linearize(mech), frequencies=[1.0])
    assert counts
    assert all(x == {1} for x in counts)


def test_regression_checks_that_are_read_later_use_one_blas_thread(
    two_threads_of_blas, monkeypatch
):
    """On busy cores, checks of a run of 0.1 s took 30 s."""
    counts = []

    def check(run):
        counts.append(set(threads_of_blas().values()))
        return ()

    with skip_result_checks():
        run = bd.simulate(PENDULUM.build(), t_end=0.01)
    monkeypatch.setattr("beamdae.results.solution.RUN_CHECKS", (check,))
    assert not run.warnings
    assert counts == [{1}]
    assert two_threads_of_blas.items() <= threads_of_blas().items()


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


def test_regression_thread_that_outlives_a_run_restores_blas_threads(two_threads_of_blas):
    """Threadpoolctl accepts changes only from the thread that made the first one."""
    has_entered, has_left = threading.Event(), threading.Event()

    def stay():
        with blas_threads.single_threaded:
            has_entered.set()
            has_left.wait(10.0)

    with blas_threads.single_threaded:
        assert {threads_of_blas()[path] for path in two_threads_of_blas} == {1}
        thread = threading.Thread(target=stay)
        thread.start()
        has_entered.wait(10.0)
    has_left.set()
    thread.join()
    assert two_threads_of_blas.items() <= threads_of_blas().items()


def test_regression_linear_models_use_one_blas_thread(monkeypatch, two_threads_of_blas):
    """On busy cores, responses of a blade of 16 elements took 20 s instead of .1 s."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 2.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", ball.point, (mech.input("force", unit="N"), 0.0)))
    mech.observe("ball", ball.point)
    model = bd.linearize(mech, inputs=["force"], outputs=["ball.x"])
    solve, counts = np.linalg.solve, []

    def solve_and_count(*arguments):
        counts.append({threads_of_blas()[path] for path in two_threads_of_blas})
        return solve(*arguments)

    monkeypatch.setattr(np.linalg, "solve", solve_and_count)
    model.frequency_response([10.0])
    assert counts == [{1}]


@pytest.mark.parametrize("number", [1, 2])
def test_regression_runs_start_no_threads_to_limit_blas(monkeypatch, two_threads_of_blas, number):
    """Each run started two to four threads, which took up to 8 ms each on busy machines."""
    set_threads_of_blas(number)
    with blas_threads.single_threaded:
        pass
    with monkeypatch.context() as context:
        context.setattr(threading.Thread, "start", lambda _: pytest.fail("a thread"))
        with blas_threads.single_threaded:
            assert {threads_of_blas()[path] for path in two_threads_of_blas} == {1}
    assert {threads_of_blas()[path] for path in two_threads_of_blas} == {number}


@pytest.mark.slow(reason="one second")
def test_regression_blas_of_sundials_has_one_thread():
    """SUNDIALS is opened without an import, which alone made the libraries be searched again."""
    program = (
        "import threadpoolctl, scipy.linalg\n"
        "from beamdae.linear.blas_threads import single_threaded\n"
        "from beamdae.sundials.library import load_library\n"
        "with single_threaded: pass\n"
        "load_library()\n"
        "with single_threaded: pools = threadpoolctl.threadpool_info()\n"
        "print({x['num_threads'] for x in pools if x['user_api'] == 'blas'})"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    run = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "{1}"


def test_regression_interrupted_blas_search_closes_its_files(monkeypatch, two_threads_of_blas):
    search_threads, searched = [], []

    def interrupted_search():
        search_threads.append(threading.current_thread())
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        searched.append(True)
        return threadpoolctl.ThreadpoolController()

    monkeypatch.setattr(blas_threads, "ThreadpoolController", interrupted_search)
    blas_threads.find_new_libraries()
    with pytest.raises(KeyboardInterrupt), blas_threads.single_threaded:
        pass
    search_threads[0].join()
    assert searched
    with blas_threads.single_threaded:
        pass
    assert two_threads_of_blas.items() <= threads_of_blas().items()


@pytest.mark.parametrize("call", range(4))
def test_regression_blas_is_restored_after_interrupts(monkeypatch, two_threads_of_blas, call):
    """Each library is limited and restored, before or after which an interrupt arrives."""
    set_threads, calls = blas_threads._set_threads, []

    def interrupted_set_threads(library, number):
        calls.append(number)
        if len(calls) - 1 == call // 2 + 1:
            if call % 2:
                set_threads(library, number)
            raise KeyboardInterrupt
        set_threads(library, number)

    monkeypatch.setattr(blas_threads, "_set_threads", interrupted_set_threads)
    with pytest.raises(KeyboardInterrupt), blas_threads.single_threaded:
        pass
    assert two_threads_of_blas.items() <= threads_of_blas().items()
    with blas_threads.single_threaded:
        assert {threads_of_blas()[path] for path in two_threads_of_blas} == {1}
    assert two_threads_of_blas.items() <= threads_of_blas().items()


def test_threads_that_run_on_do_not_keep_control_of_blas(two_threads_of_blas):
    """Threadpoolctl accepts changes only from the thread that made the first one."""
    with blas_threads.single_threaded:
        pass
    set_threads_of_blas(1)
    assert {threads_of_blas()[path] for path in two_threads_of_blas} == {1}


@pytest.mark.parametrize("law", [lambda t: np.sqrt(1e-7 - t), lambda t: np.sqrt(0.2 - t)])
def test_regression_nonfinite_forces_are_not_attributed_to_scikit_sundae(law):
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", ball.point, (law, 0.0)))
    solution = bd.simulate(mech, bd.Ida(), 1.0)
    assert solution.status.kind == "failed"
    assert "not finite" in solution.status.sentence


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        ([[1.0, 0.5], [0.0, 1.0]], "q.: the mass matrix is not symmetric .entries of this row"),
        ([-1.0, 1.0], "q0: the mass matrix has a negative eigenvalue of"),
        ([[1.0, 2.0], [2.0, 1.0]], r"q.: the mass matrix has a negative eigenvalue of"),
    ],
)
def test_regression_invalid_mass_matrix_is_rejected(mass, message):
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    force = ca.vertcat(0.0, -1.0)
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=mass, force=force, q0=[1.0, 0.0], v0=[0, 0])
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(system, bd.Ida(), 1.0)


class Loose(Roll):
    @property
    def accuracy(self):
        return Accuracy("h", 0.1)


class Plain(bd.Integrator):
    step, order = 0.1, 1


@dataclass(frozen=True)
class Stepless(bd.Integrator):
    order = 1


@pytest.mark.parametrize(
    ("integrator", "message"),
    [
        (Loose(), "the accuracy of Loose must be named 'rtol' or 'step'"),
        (Plain(), "Plain must be a dataclass whose fields"),
        (Stepless(), "Stepless: the settings have no step; add a field `step`"),
        (bd.Ida, "integrator must be Ida"),
        ("ida", "integrator must be Ida"),
    ],
)
def test_invalid_integrator_is_rejected(integrator, message):
    with pytest.raises(bd.BeamdaeError, match=f"^(simulate: )?{message}"):
        bd.simulate(rolling(), integrator, 1.0)


def test_integrators_without_a_method_are_rejected():
    @dataclass(frozen=True)
    class Motionless(bd.Integrator):
        step: float = 0.1
        order = 1

    with pytest.raises(bd.BeamdaeError, match=r"^Motionless: this integrator takes no steps"):
        bd.simulate(rolling(), Motionless(), 1.0)


@pytest.mark.slow(reason="half a second")
def test_progress_during_the_pilot_run_gets_the_start_time():
    times = []
    mech = hub_beam(elements=2)
    bd.simulate(mech, bd.Ida(1e-4), t_end=0.2, progress=times.append)
    assert times[0] == 0.0
    assert times == sorted(times)
    assert times[-1] > 0.0


def test_regression_compilation_for_the_pilot_run_is_setup_time(monkeypatch):
    """The first run of a process seemed to take seven times as long as the next one."""
    added_time = 0.0

    def slow_down(method_on):
        def make_slowly(plan):
            nonlocal added_time
            added_time += 1000.0
            return method_on(plan)

        return make_slowly

    real = time.perf_counter
    monkeypatch.setattr(drive_module.clock, "perf_counter", lambda: real() + added_time)
    init = drive_module._RunInProgress.__init__
    monkeypatch.setattr(
        drive_module._RunInProgress,
        "__init__",
        lambda self, whole, plan, on, *more: init(self, whole, plan, slow_down(on), *more),
    )
    statistics = bd.simulate(hub_beam(elements=2), bd.Ida(1e-4), t_end=0.2).statistics
    assert added_time >= 2000.0, "a pilot run and the run"
    assert statistics.setup_time > added_time
    assert statistics.wall_time < 1000.0


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
