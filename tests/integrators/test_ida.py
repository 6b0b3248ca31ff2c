"""IDA: vectors, memory and output of its solvers, pivots and the step report."""

import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import sksundae
from benchmarks.cases import PENDULUM
from hub_beam import hub_beam
from mechanisms import free_ball
from numpy.testing import assert_allclose
from pendulum import pendulum
from spin_up import spin_up
from support import compiled, use_scikit_sundae

import beamdae as bd
from beamdae.sundials import UnavailableError, load_library

FORMULATIONS = ("stabilized-index1", "ggl", "index2", "index1", "index3")


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


def test_sundials_prints_nothing(capfd):
    mech, body = free_ball(name="body")
    mech.add(bd.Force("push", body.point, (lambda t: np.sqrt(0.5 - t), 0.0)))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), 1.0)
    assert solution.status.kind == "failed"
    assert capfd.readouterr() == ("", "")


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
@pytest.mark.parametrize("formulation", FORMULATIONS)
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
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_step_report_lists_orders_and_limiting_unknowns(formulation):
    settings = bd.Ida(1e-4, formulation=formulation, error_control="velocities", max_order=3)
    solution = bd.simulate(PENDULUM.equations, settings, 2.0)
    report, counts = solution.integrator, solution.statistics
    assert sum(report["orders"].values()) == counts.steps
    assert {"1", "2"} <= set(report["orders"]) <= {"1", "2", "3"}
    assert 0 < report["error_test_failures"] <= counts.rejected_steps
    # Iterations that fail with old factors mostly converge with new ones, without another step.
    assert counts.newton_failures > counts.rejected_steps - report["error_test_failures"]
    assert counts.factorizations == counts.jacobian_calls > 1
    assert 1 <= len(report["limited_by"]) <= 3
    assert set(report["limited_by"]) <= {"x", "y", "velocity of x", "velocity of y"}
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


@compiled
def test_velocities_of_frames_that_follow_a_section_do_not_limit_steps():
    report = bd.simulate(pendulum(elements=2), bd.Ida(1e-4), t_end=0.2).integrator
    assert report["error_control"] == "rigid velocities"
    assert not any(name.startswith("velocity") for name in report["limited_by"])


@compiled
def test_failures_before_a_restart_are_counted():
    mech, ball = free_ball()
    violent = bd.piecewise((0.5, lambda t: 1e3 * np.sin(60.0 * t) ** 9), 0.0)
    mech.add(bd.Force("push", ball.point, (violent, 0.0)))
    equations = bd.equations_of_motion(mech)
    first, both = (bd.simulate(equations, bd.Ida(1e-3), t_end) for t_end in (0.5, 1.0))
    assert len(both.trajectory.intervals) == 2
    failures = both.integrator["error_test_failures"]
    # The second interval is at rest.
    assert failures > 0.5 * first.integrator["error_test_failures"] > 10


@pytest.mark.slow(reason="half a second")
@compiled
def test_regression_old_factors_do_not_reduce_the_steps():
    """Newton errors from factors of 500 earlier steps excited vibrations: 26 395 steps."""
    equations = spin_up(elements=4, formulation="exact")
    run = bd.simulate(equations, bd.Ida(rtol=1e-4), 10.0)
    assert run.statistics.steps < 18_000  # 15 230 with 20 to 100 steps per factorization
    assert run.statistics.factorizations > run.statistics.steps / 50


# SUNDIALS functions come from the libraries that scikit-sundae loads.


def test_version_is_that_of_scikit_sundae():
    assert ".".join(map(str, load_library().version)) == sksundae.SUNDIALS_VERSION


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_functions_belong_to_the_one_loaded_copy():
    addresses = load_library().addresses
    lines = [line.split() for line in Path("/proc/self/maps").read_text().splitlines()]
    mapped = [line for line in lines if "libsundials_ida" in line[-1]]
    assert len({line[-1] for line in mapped}) == 1
    ranges = [[int(end, 16) for end in line[0].split("-")] for line in mapped]
    assert any(low <= addresses["IDASolve"] < high for low, high in ranges)


def catch_rejection():
    with pytest.raises(UnavailableError) as problem:
        load_library.__wrapped__()
    return str(problem.value)


@pytest.mark.skipif(sys.platform == "win32", reason="there it is imported")
def test_missing_compiled_module_is_reported(monkeypatch, tmp_path):
    (tmp_path / "sksundae").mkdir()
    (tmp_path / "sksundae" / "__init__.py").touch()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"
    monkeypatch.setattr(sys, "path", [])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"
