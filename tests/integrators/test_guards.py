"""Stall detection, rejected inputs, and interrupts that keep the steps of a run."""

import functools
import itertools
import os
import signal
import threading
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from support import use_scikit_sundae

import beamdae as bd
from beamdae.cli import progress
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators import limits
from beamdae.integrators.alpha.stepper import AdaptiveAlphaStepper, FixedAlphaStepper
from beamdae.integrators.drive import drive
from beamdae.integrators.ida.python_solver import SksundaeCallbacks
from beamdae.integrators.ida.stepper import IdaStepper
from beamdae.integrators.integrator import Accuracy
from beamdae.integrators.limits import PaceCheck
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.results.outcome import Statistics
from beamdae.results.run_checks import skip_error_estimates
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)


def strip(force=None, law=None, damping=1e-4, material=ALLOY, elements=1, **motion):
    """A thin strip on a hinge, with a force on its end or a moment on its start."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(material, width=0.03, height=0.0025, damping=damping)
    line = bd.Line((0.0, 0.0), (0.8, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=elements, **motion))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    if force is not None:
        mech.add(bd.Force("force", beam.end, (0.0, force)))
    if law is not None:
        mech.add(bd.Moment("moment", beam.start, law))
    mech.observe("tip", beam.end)
    return mech


@functools.cache
def equations(force=None, damping=1e-4, law=None, angular_velocity=0.0):
    """Return the equations of a strip, built once."""
    motion = {"angular_velocity": angular_velocity}
    return bd.equations_of_motion(strip(force, law, damping, **motion))


GROWING, SWITCHED = lambda t: 1e12 * t, bd.piecewise((0.1, 0.1), 0.0)
FAST = bd.sine(1.0, 1e9)


class Stepping:
    """Takes steps of prescribed lengths [s] at constant state."""

    steps_per_check = 64
    resolved_options = {}  # noqa: RUF012 as the protocol has it
    counts = Statistics()

    def __init__(self, lengths):
        self.lengths, self.step_count = lengths, 0

    def begin(self, start, end, branch, state):
        self.t, self.end, self.state = start, end, state

    def step(self):
        self.t = min(self.t + self.lengths(self.step_count), self.end)
        self.step_count += 1
        return self.t, self.state


@dataclass(frozen=True)
class PrescribedSteps(bd.Integrator):
    lengths: object = None
    rtol: float = 1e-5
    max_steps: int | None = None
    order = 1

    @property
    def accuracy(self):
        return Accuracy("rtol", self.rtol)

    def method_on(self, plan):
        return Stepping(self.lengths)


def ball():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_stalled_run_is_stopped():
    """Such runs never ended, and their memory grew."""
    solution = bd.simulate(ball(), PrescribedSteps(lambda k: 1e-10), 1.0)
    assert solution.status.kind == "limited"
    for words in (
        "steps have shrunk to 1e-10 s",
        "1e+10 more",
        "check values and units",
        "max_steps",
        "stopped at t = 1e-06 s",
    ):
        assert words in solution.status.sentence
    assert solution.statistics.steps == 10_000


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_runs_of_many_periods_name_them():
    """Extreme loads or stiffnesses were the only causes named for a pendulum."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arm = mech.add(bd.RigidBody("arm", mass=1.0, inertia=0.01, center=(0.5, -0.8)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)))
    with pytest.warns(bd.BeamdaeWarning, match=r"5\.\de\+03 periods of motion.*increase rtol"):
        run = bd.simulate(mech, bd.Auto(), t_end=1e4, output_step=100.0)
    assert run.status.kind == "limited"


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        (
            "the steps shrink, possibly because of loads; check values, or set max_steps to "
            "continue anyway",
            "the steps shrink; set max_steps to continue anyway",
        ),
        ("reached max_steps = 3", "reached max_steps = 3"),
    ],
)
def test_regression_known_causes_replace_guesses(reason, expected):
    """A vibration that the steps follow was followed by "or extreme loads, speeds, ..."."""
    assert limits.omit_guesses(reason) == expected


def stalled_at(t, steps, relative_limit=1.0, end=1.0):
    """Return the first of these numbers of steps, with the times t, at which the run stalls."""
    check = PaceCheck(0.0, end, relative_limit=relative_limit)
    for time_reached, count in zip(t, steps, strict=True):
        if check.is_due(time_reached, count) and check.is_stalled:
            return count
    return None


def test_regression_a_cause_of_stalled_steps_replaces_guesses():
    check = PaceCheck(0.0, 1.0)
    assert check.is_due(0.0, 5000)
    pace = "steps have shrunk to 0 s, so the run makes no progress"
    assert (
        check.describe_stall("the cause") == f"{pace}; the cause; set max_steps to continue anyway"
    )


def test_checks_of_the_motion_are_due_while_most_steps_remain():
    check = PaceCheck(0.0, 1.0)
    first = limits._STEPS_OF_FIRST_MOTION_CHECK
    assert not check.is_due(0.01, first - 1)
    assert check.is_due(0.1, first)
    assert not check.is_due(0.12, first + 1)
    assert not check.has_slowed
    assert check.is_due(0.12, 2 * first)
    assert check.has_slowed  # 0.02 s after 0.1 s
    assert check.describe_motion("reason").startswith(
        "reason; the rest of the run would take about 2.2e"
    )
    assert not check.is_due(0.9, 4 * first)  # 600 steps remain


def _cantilever_with_loop(gain):
    """Return a steel leaf of 80 mm with a PID loop at its tip, whose target is 1 mm away."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.01, 4e-4, damping=1e-5)
    line = bd.Line((0.0, 0.0), (0.08, 0.0))
    leaf = mech.add(bd.Beam("leaf", line, section, elements=2, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    mech.add(bd.PointMass("stage", 0.1, on=leaf.end))
    y, v = (mech.sensor(name, leaf.end, name) for name in ("y", "y_dot"))
    force = bd.pid(
        mech, "servo", 1e-3 - y, gain * 1e3, gain * 2e4, gain * 20.0, rate=-v, scale=1e-5
    )
    mech.add(bd.Force("motor", leaf.end, (0.0, force)))
    return mech


@pytest.mark.slow(reason="five thousand steps of two unstable runs")
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Radau(rtol=1e-3)])
def test_regression_runs_with_meaningless_strains_are_stopped(integrator):
    """A wrong sign of the gains took hundreds of thousands of steps at strains of 2."""
    run = bd.simulate(_cantilever_with_loop(-1.0), integrator, t_end=0.5)
    assert run.status.kind == "limited"
    assert run.statistics.steps < 25_000
    for words in (
        "servo: the command",
        "its loop seems to be unstable",
        "leaf: the largest strain is",
        "set max_steps to continue anyway",
    ):
        assert words in run.status.sentence
    longer = replace(integrator, max_steps=run.statistics.steps + 100)
    assert "max_steps" in bd.simulate(_cantilever_with_loop(-1.0), longer, 0.5).status.sentence
    assert bd.simulate(_cantilever_with_loop(1.0), integrator, t_end=0.5).status.success


def test_endlessly_shrinking_steps_are_detected():
    steps = np.arange(0, 100_000, 64)
    assert 20_000 < stalled_at(20.0 * (1.0 - 0.9995**steps), steps, end=21.0) < 85_000


@pytest.mark.slow(reason="a quarter of a second")
def test_max_steps_disables_stall_detection():
    solution = bd.simulate(ball(), PrescribedSteps(lambda k: 1e-10, max_steps=11_000), 1.0)
    assert solution.status.sentence.endswith("reached max_steps = 11000")


def test_short_stiff_phase_does_not_stall():
    """9000 steps of 1 ns, as in an impact, followed by steps of 1 ms."""
    solution = bd.simulate(ball(), PrescribedSteps(lambda k: 1e-9 if 200 < k < 9200 else 1e-3), 1.0)
    assert solution.status.success
    assert solution.statistics.steps > 9500


@pytest.mark.parametrize(("total", "relative_limit"), [(9e6, 1.0), (1.1e6, 0.125)])
def test_run_of_a_million_steps_does_not_stall(total, relative_limit):
    steps = np.arange(0, 400_000, 8)
    assert stalled_at(steps / total, steps, relative_limit) is None


@pytest.mark.parametrize(("total", "count"), [(1e9, 10_000), (3e7, 40_000)])
def test_run_of_many_million_steps_stalls(total, count):
    steps = np.arange(0, 400_000, 8)
    assert stalled_at(steps / total, steps) == count


@pytest.mark.parametrize(("growth", "stops"), [(0.0, True), (1.0, False)])
def test_only_a_steady_pace_foretells_the_end(growth, stops):
    """Steps that grow while vibrations decay completed a run that needed 1.4e7 at first."""
    check = PaceCheck(0.0, 1.0)
    for steps in (5000, 10_000):
        assert check.is_due(2e-8 * steps * (steps / 5000) ** growth, steps)
        assert not check.is_stalled
    assert check.exceeds_limit == stops


ADAPTIVE = [bd.Auto(), bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(rtol=1e-4)]


@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda integrator: integrator.label)
@pytest.mark.parametrize(
    "what",
    [{"force": 1e9, "damping": 0.0}, {"angular_velocity": 1e10}, {"law": GROWING}],
    ids=["1 GN", "1e10 rad/s", "a moment that grows"],
)
def test_regression_extreme_inputs_end_with_a_reason(integrator, what, monkeypatch):
    """Such runs took minutes and gigabytes. An earlier check detects the stall at once."""
    monkeypatch.setattr(limits.PaceCheck.__init__, "__defaults__", (1.0, 1.0, 256))
    solution = bd.simulate(equations(**what), integrator, 1.0)
    assert solution.status.kind in ("limited", "failed")
    reasons = (
        "steps have shrunk to",
        "the largest strain is",
        "events acted",
        "the step is too small",
        "at the smallest step",
        "at a step of",
        "did not converge",
    )
    assert any(words in solution.status.sentence for words in reasons)
    assert solution.statistics.steps < 5000


@pytest.mark.slow(reason="default stall detection, up to a hundred thousand steps")
@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda integrator: integrator.label)
@pytest.mark.parametrize(
    "model",
    [
        strip(force=1e9, damping=0.0, elements=4),
        strip(angular_velocity=1e10, elements=4),
        strip(velocity=(0.0, 1e10), elements=4),
        strip(law=lambda t: np.exp(1e3 * t) / 1e3, elements=4),
    ],
    ids=["1 GN", "1e10 rad/s", "1e10 m/s", "exp"],
)
def test_extreme_inputs_end_with_default_limits(integrator, model):
    begin = time.perf_counter()
    solution = bd.simulate(model, integrator, 0.7)
    assert not solution.status.success
    assert time.perf_counter() - begin < 120.0


@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda integrator: integrator.label)
def test_regression_overflow_ends_a_run(integrator):
    """A step that is not a number was retried forever."""
    dense = bd.Material(E=68.95e9, nu=0.3, rho=1e70)
    limited = type(integrator)(rtol=1e-4, time_limit=0.1)
    begin = time.perf_counter()
    solution = bd.simulate(strip(material=dense), limited, 0.1)
    assert time.perf_counter() - begin < 10.0
    assert np.isfinite(solution.q).all()


@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda integrator: integrator.label)
def test_time_limit_ends_a_stalled_run(integrator):
    limited = type(integrator)(rtol=1e-5, time_limit=0.05)
    begin = time.perf_counter()
    solution = bd.simulate(equations(force=1e9), limited, 1.0)
    assert not solution.status.success
    assert time.perf_counter() - begin < 3.0


@pytest.mark.parametrize(
    ("integrator", "law", "message"),
    [
        (bd.GeneralizedAlpha(step=1e-60), None, "GeneralizedAlpha: step of 1e-60 s requires 1e"),
        (bd.GeneralizedAlpha(step=9e-9), None, "GeneralizedAlpha: step of 9e-09 s requires 1.1e"),
        (bd.Ida(max_step=1e-60), None, "Ida: max_step of 1e-60 s requires 1e"),
        (bd.Radau(max_step=1e-60), None, "Radau: max_step of 1e-60 s requires 1e"),
        (bd.Auto(max_step=1e-60), None, "Radau: max_step of 1e-60 s requires 1e"),
        (bd.Ida(), FAST, "Ida: the longest step "),
        (bd.Radau(), FAST, "Radau: the longest step "),
        (bd.GeneralizedAlpha(rtol=1e-4), FAST, "GeneralizedAlpha: the longest step"),
    ],
)
def test_regression_runs_of_too_many_steps_are_rejected(integrator, law, message):
    with pytest.raises(
        bd.BeamdaeError, match=rf"^{message}.* more than the maximum of 1e\+08; use"
    ):
        bd.simulate(equations(law=law), integrator, 1.0)


def test_max_step_may_exceed_the_law_time_scale():
    integrator = bd.Radau(max_step=0.01, time_limit=0.05)
    assert bd.simulate(equations(law=FAST), integrator, 1.0).trajectory.end > 0.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"t_end": 1e-300}, "simulate: t_end must be at least 1e-75, got 1e-300"),
        (
            {"t_end": 1e101},
            "simulate: t_end must not exceed 1e.75",
        ),
        ({"output_step": 1e-20}, "simulate: output_step .* gives more than"),
        ({"output_step": True}, "simulate: output_step must be a number, got True"),
    ],
)
def test_invalid_times_are_rejected(settings, message):
    with pytest.raises(bd.BeamdaeError, match=f"^{message}"):
        bd.simulate(ball(), bd.Ida(), **{"t_end": 1.0, **settings})


@pytest.mark.parametrize("kind", [bd.Auto, bd.Ida, bd.Radau, bd.GeneralizedAlpha])
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rtol": 1e-20}, "rtol must lie between 1e-14 and 0.1, got 1e-20"),
        ({"rtol": float("nan")}, "rtol must be finite"),
        ({"max_steps": 0}, "max_steps must be a whole number of at least 1, got 0"),
        ({"max_steps": 1.5}, "max_steps must be a whole number of at least 1, got 1.5"),
        ({"max_steps": True}, "max_steps must be a number, got True"),
    ],
)
def test_invalid_settings_are_rejected(kind, settings, message):
    with pytest.raises(bd.BeamdaeError, match=f"^{kind.__name__}: {message}"):
        kind(**{"rtol": 1e-5, **settings})


def test_nonfinite_radius_is_rejected():
    with pytest.raises(bd.BeamdaeError, match="rho_inf must be finite, got nan"):
        bd.GeneralizedAlpha(rho_inf=float("nan"))


@pytest.mark.parametrize("t_end", [1e-70])
@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda integrator: integrator.label)
def test_very_short_runs_end(t_end, integrator):
    assert bd.simulate(equations(), integrator, t_end).status.success


# Interrupts: after the first step, the steps are kept.


class Once:
    """A function or method that raises KeyboardInterrupt on its nth call."""

    def __init__(self, function, n):
        self.function, self.calls_before_interrupt = function, n

    def __get__(self, instance, owner):
        method = self.function.__get__(instance)

        # scikit-sundae checks the signature.
        @functools.wraps(method)
        def call(*args, **kwargs):
            self.calls_before_interrupt -= 1
            if self.calls_before_interrupt == 0:
                raise KeyboardInterrupt
            return method(*args, **kwargs)

        return call


@pytest.mark.parametrize(
    ("integrator", "owner", "name"),
    [
        (bd.Ida(), IdaStepper, "advance"),
        (bd.Radau(), RadauStepper, "advance"),
        (bd.GeneralizedAlpha(2e-4), FixedAlphaStepper, "advance"),
        (bd.GeneralizedAlpha(rtol=1e-4), AdaptiveAlphaStepper, "advance"),
    ],
)
@pytest.mark.parametrize("n", [1, 10])
def test_interrupt_in_a_method_keeps_the_steps(integrator, owner, name, n, monkeypatch):
    monkeypatch.setattr(owner, name, Once(getattr(owner, name), n))
    solution = bd.simulate(equations(law=SWITCHED), integrator, 1.0, partial="return")
    assert solution.status.kind == "interrupted"
    assert np.isfinite(solution.table().to_numpy()).all()


@pytest.mark.parametrize("name", ["residual", "jacobian"])
@pytest.mark.parametrize("n", [1, 10])
def test_interrupt_in_a_sksundae_callback_keeps_the_steps(name, n, monkeypatch):
    use_scikit_sundae(monkeypatch)
    method = getattr(SksundaeCallbacks, name)
    monkeypatch.setattr(SksundaeCallbacks, name, Once(method, n))
    solution = bd.simulate(equations(law=SWITCHED), bd.Ida(), 1.0, partial="return")
    assert solution.status.kind == "interrupted"
    assert np.isfinite(solution.table().to_numpy()).all()


def run_interrupted_while_prepared(equations, times, pilot=None, method=None):
    """Interrupt a run while its pilot method or its method is prepared."""
    integrator = PrescribedSteps()

    def make_method(interrupt):
        def method_on(plan):
            if interrupt:
                raise KeyboardInterrupt
            return Stepping(lambda k: 0.01)

        return method_on

    return drive(integrator, equations, times, make_method(method), None, make_method(pilot))


def test_interrupt_before_the_first_step_is_raised():
    times = np.linspace(0.0, 1.0, 11)
    with pytest.raises(KeyboardInterrupt):
        run_interrupted_while_prepared(ball(), times, pilot=True)


def test_interrupt_during_compilation_keeps_the_pilot_run():
    with pytest.raises(bd.Interrupted) as caught:
        run_interrupted_while_prepared(ball(), np.linspace(0.0, 1.0, 11), method=True)
    solution = caught.value.solution
    assert solution.status.kind == "interrupted"
    assert "at t = 1 s of the pilot run" in solution.status.sentence
    assert len(solution.t) == 11


def test_interrupt_between_intervals_keeps_the_first_one(monkeypatch):
    whole = ConsistencySolver.require_continuous
    monkeypatch.setattr(ConsistencySolver, "require_continuous", Once(whole, 1))
    with pytest.raises(bd.Interrupted) as caught:
        bd.simulate(equations(law=SWITCHED), bd.GeneralizedAlpha(step=0.01), 1.0)
    solution = caught.value.solution
    assert solution.status.sentence == "interrupted at t = 0.1 s"


def test_interrupt_while_the_trajectory_is_built_keeps_the_rows(monkeypatch):
    monkeypatch.setattr(Trajectory, "__init__", Once(Trajectory.__init__, 1))
    with pytest.raises(bd.Interrupted) as caught:
        bd.simulate(ball(), PrescribedSteps(lambda k: 0.01), 1.0)
    solution = caught.value.solution
    assert solution.status.sentence == "interrupted at t = 1 s"
    assert len(solution.t) == 1001


def test_interrupt_while_a_run_is_checked_keeps_it(monkeypatch):
    def interrupt(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(Solution, "warnings", property(interrupt))
    with pytest.warns(bd.BeamdaeWarning, match="not finished"):
        solution = bd.simulate(ball(), PrescribedSteps(lambda k: 0.01), 1.0, partial="return")
    assert solution.status.kind == "interrupted"
    assert solution.status.sentence == "interrupted at t = 1 s, while the run was checked"


@pytest.mark.parametrize("ask", [bd.error_estimate, bd.verify])
def test_regression_interrupt_of_an_error_estimate_is_raised(ask, monkeypatch):
    """The estimate was NaN."""
    with skip_error_estimates():
        solution = bd.simulate(equations(), bd.GeneralizedAlpha(step=0.01), 0.1)
    monkeypatch.setattr(FixedAlphaStepper, "advance", Once(FixedAlphaStepper.advance, 2))
    monkeypatch.setattr(RadauStepper, "advance", Once(RadauStepper.advance, 2))
    with pytest.raises(KeyboardInterrupt):
        ask(solution)


# A signal between `open` and `with` leaves the file to the garbage collector, which closes it.
# Python drops signals in callbacks of weak references and of the collector; hypothesis has one.
@pytest.mark.filterwarnings("ignore:.*unclosed file:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:.*callback:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:.*WeakValueDict:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.slow(reason="signals at many moments of runs")
@pytest.mark.parametrize(
    "integrator", [*ADAPTIVE, bd.GeneralizedAlpha(step=2e-3)], ids=lambda i: i.label
)
def test_signal_at_any_moment_keeps_the_steps_or_is_raised(integrator):
    def run():
        return bd.simulate(strip(law=bd.piecewise((0.1, 0.1), 0.0), elements=2), integrator, 0.5)

    run()  # Compiles the loops; the interrupts are spread over the time of a later run.
    begin = time.perf_counter()
    run()
    whole = time.perf_counter() - begin
    for delay in np.random.default_rng(0).uniform(0.0, whole, 40):
        timer = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
        solution = None
        try:
            timer.start()
            solution = run()
            timer.join()
            time.sleep(0.01)
        except KeyboardInterrupt:
            pass
        finally:
            # The signal would end pytest if the test failed.
            timer.cancel()
        if solution is not None:
            assert solution.status.kind in ("ok", "interrupted")
            assert np.isfinite(solution.table().to_numpy()).all()


def test_regression_runs_without_progress_do_not_need_inf_steps():
    """Steps that had shrunk to zero led to "the run would need inf more steps"."""
    check = PaceCheck(0.0, 1.0)
    assert check.is_due(0.0, 5000)
    assert check.is_due(0.0, 10_000)
    assert check.is_stalled
    sentence = check.describe_stall()
    assert sentence.startswith("steps have shrunk to 0 s, so the run makes no progress, possibly")
    assert "inf" not in sentence


def slow_slider_crank(damping=0.0):
    """A slider-crank at 12 rpm whose weight begins to act at the start."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    section = bd.Section.rectangle(steel, width=0.02, height=0.01, damping=damping)
    pin = mech.ground.at(0.0, 0.0)
    crank = mech.add(bd.RigidBody("crank", mass=0.5, inertia=1e-4, center=(0.0, 0.0)))
    rod = mech.add(bd.Beam("rod", bd.Line((0.04, 0.0), (0.19, 0.0)), section, elements=4))
    mech.add(bd.PointMass("slider", 1.0, on=rod.end))
    mech.add(bd.Revolute("bearing", pin, crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", pin, crank.at(0.0, 0.0), law=bd.run_up(0.4 * np.pi, 1.0)))
    mech.add(bd.Revolute("crank pin", crank.at(0.04, 0.0), rod.start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.19, 0.0), rod.end, direction=(1.0, 0.0)))
    return mech


@pytest.mark.slow(reason="half a second")
def test_regression_runs_that_follow_undamped_vibrations_name_them():
    """Extreme loads, units and np.arctan2 were the causes named for a slider-crank at 12 rpm."""
    with pytest.warns(bd.BeamdaeWarning, match="the steps follow vibrations of rod with a period"):
        run = bd.simulate(slow_slider_crank(), bd.Radau(1e-7), t_end=10.0)
    assert run.status.kind == "limited"
    # The remedies.
    assert bd.simulate(
        slow_slider_crank(), bd.Radau(1e-7), t_end=10.0, start="equilibrium"
    ).status.success


@pytest.mark.slow(reason="ten thousand steps")
def test_regression_runs_that_follow_vibrations_stop_early_and_name_a_sufficient_tolerance():
    """The run was given up after 102 464 steps, without these remedies."""
    run = bd.simulate(slow_slider_crank(), bd.Ida(1e-6), t_end=0.6)
    assert run.status.kind == "limited"
    assert run.statistics.steps < 12_000
    for words in ("vibrations of rod", "rtol=0.0001, which keeps", "choose Radau", "more steps"):
        assert words in run.status.sentence
    assert bd.simulate(slow_slider_crank(), bd.Radau(1e-4), t_end=0.6).status.success


@pytest.mark.slow(reason="ten thousand steps")
@pytest.mark.parametrize(("damping", "advises"), [(0.0, True), (1e-6, False)])
def test_progress_of_long_runs_that_follow_vibrations_suggests_damping(
    damping, advises, capsys, monkeypatch
):
    """The line showed hours, without the remedy."""
    clock = itertools.count(0.0, 20.0)
    monkeypatch.setattr(progress, "monotonic", lambda: next(clock))
    monkeypatch.setattr(progress, "create_progress_console", lambda: None)
    with progress.show_run_progress(0.1) as update:

        def show(t):
            update("Ida(rtol=1e-06)", t)
            return "enough" if t > 4.2e-4 else None

        bd.simulate(slow_slider_crank(damping), bd.Ida(1e-6), t_end=0.1, progress=show)
    lines = capsys.readouterr().err.splitlines()
    advised = [line.startswith("vibrations hardly decay: set damping=, Ida") for line in lines]
    assert any(advised) == advises
    assert not all(advised)


@pytest.mark.slow(reason="half a second")
def test_runs_that_stop_within_few_periods_do_not_blame_them():
    """A limit of the user ends a run whose oscillation is the motion of interest."""
    with pytest.warns(bd.BeamdaeWarning, match="reached max_steps = 5000"):
        run = bd.simulate(strip(), bd.Radau(1e-9, max_steps=5000), t_end=1e3)
    assert "follow" not in run.status.sentence
