"""Runs without end are stopped with a reason, and interrupts keep the steps of a run."""

import functools
import itertools
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanisms import ALLOY, beam_pendulum, clamped_beam, driven, hinged_body, rectangle, swing
from numpy.testing import assert_allclose
from own_method import OwnMethod

import beamdae as bd
from beamdae.cli import progress
from beamdae.integrators import step_history
from beamdae.results.solution import Solution


def strip_on_a_hinge(force=None, law=None, damping=1e-4, material=ALLOY, elements=1, **motion):
    """A thin strip, with a force on its end or a moment on its start."""
    section = rectangle(0.0025, 0.03, material=material, damping=damping)
    mech = beam_pendulum(elements, (0.8, 0.0), section, **motion)
    beam = mech.part("beam")
    if force is not None:
        mech.add(bd.Force("force", beam.end, (0.0, force)))
    if law is not None:
        mech.add(bd.Moment("moment", beam.start, law))
    return mech


SWITCHED = bd.piecewise((0.1, 0.1), 0.0)


def ball():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_stalled_run_is_stopped():
    """Such runs never ended, and their memory grew."""
    stalled = OwnMethod(rtol=1e-5, lengths=lambda k: 1e-10)
    solution = bd.simulate(ball(), stalled, 1.0)
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
    longer = bd.simulate(ball(), replace(stalled, max_steps=11_000), 1.0)
    assert longer.status.sentence.endswith("reached max_steps = 11000")


@pytest.mark.slow(reason="a hundred thousand steps")
@pytest.mark.parametrize(
    ("lengths", "ends"),
    [
        # 9000 steps of 1 ns, as in an impact, followed by steps of 1 ms.
        (lambda k: 1e-9 if 200 < k < 9200 else 1e-3, True),
        (lambda k: 1e-5, True),
        # Steps that grow while vibrations decay: 1.4e7 steps seemed to remain at first.
        (lambda k: 1e-7 * (1.0 + k / 300.0), True),
        (lambda k: 1e-8 * 0.9995**k, False),
        (lambda k: 3e-8, False),
    ],
    ids=["impact", "many steps", "growing", "shrinking", "steady"],
)
def test_only_runs_that_make_no_progress_are_stopped(lengths, ends):
    solution = bd.simulate(ball(), OwnMethod(rtol=1e-5, lengths=lengths), 1.0, output_step=0.1)
    assert solution.status.success == ends
    assert ends or solution.statistics.steps < 90_000


@pytest.mark.slow(reason="a quarter of a second")
def test_runs_of_many_periods_name_the_steps_that_they_need():
    with pytest.warns(bd.BeamdaeWarning, match=r"need \d.*e\+06 more steps.*increase rtol"):
        run = bd.simulate(swing(), bd.Auto(), t_end=1e4, output_step=100.0)
    assert run.status.kind == "limited"


def _cantilever_with_loop(gain):
    """Return a steel leaf of 80 mm with a PID loop at its tip, whose target is 1 mm away."""
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.01, 4e-4, damping=1e-5)
    mech, leaf = clamped_beam(section, 2, 0.08, name="leaf", formulation="exact")
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
        "leaf: the largest strain is",
        "set max_steps to continue anyway",
    ):
        assert words in run.status.sentence
    longer = replace(integrator, max_steps=run.statistics.steps + 100)
    assert "max_steps" in bd.simulate(_cantilever_with_loop(-1.0), longer, 0.5).status.sentence
    assert bd.simulate(_cantilever_with_loop(1.0), integrator, t_end=0.5).status.success


ADAPTIVE = [bd.Auto(), bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(rtol=1e-4)]
every_integrator = pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda x: x.label)


@pytest.mark.slow(reason="default stall detection, up to a hundred thousand steps")
@every_integrator
@pytest.mark.parametrize(
    "extreme",
    [
        {"force": 1e9, "damping": 0.0},
        {"angular_velocity": 1e10},
        {"velocity": (0.0, 1e10)},
        {"law": lambda t: np.exp(1e3 * t) / 1e3},
    ],
    ids=["1 GN", "1e10 rad/s", "1e10 m/s", "exp"],
)
def test_regression_extreme_inputs_end_with_a_reason(integrator, extreme):
    """Such runs took minutes and gigabytes."""
    begin = time.process_time()
    solution = bd.simulate(strip_on_a_hinge(elements=4, **extreme), integrator, 0.7)
    assert time.process_time() - begin < 120.0
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


@every_integrator
def test_regression_limits_of_time_end_runs_that_overflow_or_stall(integrator):
    """A step that is not a number was retried forever."""
    dense = bd.Material(E=68.95e9, nu=0.3, rho=1e70)
    limited = type(integrator)(rtol=1e-4, time_limit=0.05)
    for model in (strip_on_a_hinge(material=dense), strip_on_a_hinge(force=1e9)):
        begin = time.process_time()
        solution = bd.simulate(model, limited, 0.1)
        assert time.process_time() - begin < 10.0
        assert np.isfinite(solution.q).all()


def test_max_step_may_exceed_the_law_time_scale():
    integrator = bd.Radau(max_step=0.01, time_limit=0.05)
    fast = strip_on_a_hinge(law=bd.sine(1.0, 1e9))
    assert bd.simulate(fast, integrator, 1.0).trajectory.end > 0.0


@every_integrator
def test_very_short_runs_end(integrator):
    assert bd.simulate(strip_on_a_hinge(), integrator, 1e-70).status.success


# Interrupts: after the first step, the steps are kept.


# A signal between `open` and `with` leaves the file to the garbage collector, which closes it.
# Python drops signals in callbacks of weak references and of the collector; hypothesis and
# `tempfile` have some.
@pytest.mark.filterwarnings(
    "ignore:.*(unclosed file|callback|WeakValueDict|finalize object)"
    ":pytest.PytestUnraisableExceptionWarning"
)
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.slow(reason="signals at many moments of runs")
@pytest.mark.parametrize(
    "integrator", [*ADAPTIVE, bd.GeneralizedAlpha(step=2e-3)], ids=lambda i: i.label
)
def test_signal_at_any_moment_keeps_the_steps_or_is_raised(integrator):
    def run():
        return bd.simulate(strip_on_a_hinge(law=SWITCHED, elements=2), integrator, 0.5)

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
        except KeyboardInterrupt as problem:
            solution = getattr(problem, "solution", None)
        finally:
            # The signal would end pytest if the test failed.
            timer.cancel()
        if solution is not None:
            assert solution.status.kind in ("ok", "interrupted")
            assert np.isfinite(solution.table().to_numpy()).all()


# Vibrations of undamped beams ---------------------------------------------------------------------


def slow_slider_crank(damping=0.0):
    """A slider-crank at 12 rpm whose weight begins to act at the start."""
    crank = bd.RigidBody("crank", mass=0.5, inertia=1e-4)
    mech, crank = driven(crank, bd.run_up(0.4 * np.pi, 1.0), 9.81)
    section = rectangle(0.01, damping=damping)
    rod = mech.add(bd.Beam("rod", bd.Line((0.04, 0.0), (0.19, 0.0)), section, elements=4))
    mech.add(bd.PointMass("slider", 1.0, on=rod.end))
    mech.add(bd.Revolute("crank pin", crank.at(0.04, 0.0), rod.start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.19, 0.0), rod.end, direction=(1.0, 0.0)))
    return mech


@pytest.mark.slow(reason="ten thousand steps")
@pytest.mark.parametrize(
    ("integrator", "t_end", "words", "remedy"),
    [
        (bd.Radau(1e-7), 10.0, ["with a period"], (bd.Radau(1e-7), "equilibrium")),
        (
            bd.Ida(1e-6),
            0.6,
            ["rtol=0.0001, which keeps", "choose Radau", "more steps"],
            (bd.Radau(1e-4), "as drawn"),
        ),
    ],
    ids=["Radau", "Ida"],
)
def test_regression_runs_that_follow_vibrations_name_them(integrator, t_end, words, remedy):
    """Extreme loads, units and np.arctan2 were the causes named, after 102 464 steps."""
    run = bd.simulate(slow_slider_crank(), integrator, t_end)
    assert run.status.kind == "limited"
    for x in ("vibrations of rod", *words):
        assert x in run.status.sentence
    assert run.statistics.steps < 12_000
    method, start = remedy
    assert bd.simulate(slow_slider_crank(), method, t_end, start=start).status.success


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
        run = bd.simulate(strip_on_a_hinge(), bd.Radau(1e-9, max_steps=5000), t_end=1e3)
    assert "follow" not in run.status.sentence


# Runs that exceed the available memory.

GIGABYTE = 1e9


@functools.cache
def pendulum():
    mech, bar = hinged_body(2.0, 0.3, (0.5, 0.0), name="bar", gravity=9.81)
    mech.observe("center", bar.at(0.5, 0.0))
    return bd.equations_of_motion(mech)


INTEGRATORS = [
    bd.Ida(1e-5, max_step=5e-4),
    pytest.param(bd.Radau(1e-5, max_step=5e-4), marks=pytest.mark.slow(reason="several runs")),
    bd.GeneralizedAlpha(step=5e-4),
]


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.method)
def test_full_memory_ends_a_run_and_keeps_its_steps(integrator, monkeypatch):
    whole = bd.simulate(pendulum(), integrator, 1.0)
    assert whole.statistics.steps > 1900
    monkeypatch.setattr(step_history, "available_memory", lambda: 1e5)
    monkeypatch.setattr(step_history, "_UNCHECKED_BYTES", 0.0)
    monkeypatch.setattr(step_history, "_MAX_BLOCK_ROWS", 1024)
    solution = bd.simulate(pendulum(), integrator, 1.0)
    assert solution.status.kind == "limited"
    assert "stored states take 9.8e-05 GB" in solution.status.sentence
    assert "use longer steps, fewer elements" in solution.status.sentence
    assert 300 < solution.statistics.steps < 1100
    # Equal to the run with enough memory, except for the shorter pilot run.
    # The last row is the state at which it stopped.
    row_count = len(solution.t) - 1
    assert row_count > 100
    assert_allclose(solution.q[:row_count], whole.q[:row_count], atol=1e-6)


@pytest.mark.parametrize("problem", [MemoryError(), RuntimeError("std::bad_alloc")])
def test_memory_error_after_a_run_keeps_it(problem, monkeypatch):
    def short(self):
        raise problem

    monkeypatch.setattr(Solution, "warnings", property(short))
    with pytest.warns(bd.BeamdaeWarning, match="simulate: the run could not be checked"):
        solution = bd.simulate(pendulum(), bd.Ida(), 1.0)
    assert solution.status.success


def test_output_rows_that_exceed_memory_are_rejected(monkeypatch):
    monkeypatch.setattr("beamdae.memory._free_physical_memory", lambda: 1e6)
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^simulate: output of 100001 rows needs about 0\.0088 GB of memory, but only 0\.001",
    ):
        bd.simulate(pendulum(), bd.Ida(), 1.0, output_step=1e-5)


@pytest.mark.slow(reason="a process with a memory limit for each integrator")
@pytest.mark.parametrize("remaining", [0.05, 0.3, 0.6])
@pytest.mark.parametrize("integrator", ["Ida()", "Radau()", "GeneralizedAlpha()"])
def test_process_with_little_memory_ends_with_a_message(integrator, remaining):
    if not Path("/proc/self/statm").exists():
        pytest.skip("the system does not tell how much memory a process has")
    program = f"""
        import resource, warnings
        import beamdae as bd
        warnings.simplefilter("ignore")
        import beamdae.simulation
        pages = int(open("/proc/self/statm").read().split()[0])
        most = pages * resource.getpagesize() + {int(remaining * GIGABYTE)}
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        try:
            mech = bd.Mechanism(gravity=(0.0, -9.81))
            alloy = bd.Material(E=7e10, nu=0.3, rho=2700.0)
            strip = bd.Section.rectangle(alloy, width=0.03, height=0.003)
            line = bd.Line((0.0, 0.0), (1.0, 0.0))
            beam = mech.add(bd.Beam("beam", line, strip, elements=1000))
            mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
            stop = lambda t: "enough" if t > 0.0 else None
            print("kind:", bd.simulate(mech, bd.{integrator}, 1.0, progress=stop).status.kind)
        except bd.BeamdaeError as problem:
            print("error:", problem)
    """
    command = [sys.executable, "-c", textwrap.dedent(program)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout.strip().splitlines()[-1].startswith(("kind: limited", "error: "))
