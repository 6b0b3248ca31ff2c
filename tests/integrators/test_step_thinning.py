"""Long runs store output rows, rows between them and the energies of all steps."""

import warnings

import numpy as np
import pytest
from mechanisms import EARTH, free_ball
from numpy.testing import assert_allclose, assert_array_equal
from test_sampling import crank

import beamdae as bd
from beamdae.integrators import step_history, step_thinning

LIMIT = 2e4


@pytest.fixture
def small_memory(monkeypatch):
    """Small limit of the stored rows, and small blocks, from which rows are dropped."""
    monkeypatch.setattr(step_thinning, "MAX_STORED_BYTES", LIMIT)
    monkeypatch.setattr(step_history, "_MAX_BLOCK_ROWS", 40)


def pendulum(redundant=None):
    mech = bd.Mechanism(gravity=EARTH, redundant=redundant or "refuse")
    bar = mech.add(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=(0.5, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    if redundant:
        mech.add(bd.Revolute("second", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    mech.observe("center", bar.at(0.5, 0.0))
    return mech


def bouncing():
    """Ball in a moving field that bounces off the ground, with a breakpoint at 0.5 s."""
    mech, ball = free_ball((0.0, 0.3), gravity=9.81)
    push = bd.piecewise((0.5, lambda t: 0.2 * t), 0.3)
    mech.add(bd.Force("push", ball.point, (push, 0.0)))
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(ball.point)
    mech.when(gap, 0.0, "down", bd.impact(gap, 0.8), name="bounce")
    return mech


def peg():
    """Ball thrown at a small peg, which steps pass over."""
    mech, ball = free_ball((-1.0, 3e-4), velocity=(2.0, 0.0), mass=0.1)
    surface = bd.CircleSurface(mech.ground.at(0.0, 0.0), 1e-3, "outside")
    mech.add(bd.Contact("peg", ball.point, surface, 1e5))
    return mech


CASES = {
    "Ida": (pendulum, bd.Ida(1e-6)),
    "Radau": (pendulum, bd.Radau(max_step=2e-3)),
    "fixed steps": (pendulum, bd.GeneralizedAlpha(5e-4)),
    "adaptive steps": (pendulum, bd.GeneralizedAlpha(rtol=1e-5)),
    "redundant": (lambda: pendulum("minimum norm"), bd.GeneralizedAlpha(1e-3)),
    "contact": (peg, bd.GeneralizedAlpha(1e-3)),
    "samples": (crank, bd.GeneralizedAlpha(5e-4)),
}


@pytest.mark.parametrize("output_step", [0.01, 0.0037, 0.25])
@pytest.mark.parametrize("case", CASES)
def test_output_and_energies_do_not_change(case, output_step, small_memory):
    model, integrator = CASES[case]
    whole = bd.simulate(model(), integrator, 1.0, output_step=output_step, keep_steps=True)
    run = bd.simulate(model(), integrator, 1.0, output_step=output_step)
    assert any(interval.record is not None for interval in run.trajectory.intervals)
    assert run.trajectory.steps == whole.trajectory.steps
    for name in ("q", "v", "a"):
        assert_array_equal(getattr(run, name), getattr(whole, name))
    if case == "redundant":
        # The reactions of redundant joints are restored after the interpolation.
        assert_allclose(run.lam, whole.lam, rtol=1e-10, atol=1e-10)
        assert_allclose(run.table(), whole.table(), rtol=1e-10, atol=1e-10)
    else:
        assert_array_equal(run.lam, whole.lam)
        assert_array_equal(run.table(), whole.table())
        assert run.quality == whole.quality


def test_stored_rows_are_limited(small_memory):
    run = bd.simulate(pendulum(), bd.GeneralizedAlpha(5e-4), 1.0, output_step=0.1)
    (interval,) = run.trajectory.intervals
    row_bytes = 8 * (1 + sum(x.shape[1] for x in interval.rows))
    assert run.trajectory.steps == 2000
    assert 0.2 * LIMIT < len(interval.nodes) * row_bytes < LIMIT
    assert np.isin(run.t, interval.nodes).all()
    parts = round(0.1 / np.median(np.diff(interval.nodes)))
    assert run.integrator["stored_steps"] == f"output rows and {parts - 1} rows between each two"
    # Between the rows, the error is that of polynomials of degree 4 through them.
    whole = bd.simulate(pendulum(), bd.GeneralizedAlpha(5e-4), 1.0, keep_steps=True)
    times = np.linspace(0.0, 1.0, 777)
    with pytest.warns(bd.BeamdaeWarning, match="at_times: this long run stores only some"):
        between = run.at_times(times)
    assert_allclose(between.q, whole.at_times(times).q, atol=1e-6)
    with pytest.warns(bd.BeamdaeWarning, match=r"Solution\.at: this long run stores only some"):
        run.at(0.1234)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run.at_times(run.t[::2])
        whole.at_times(times)


@pytest.mark.parametrize(
    "integrator", [bd.GeneralizedAlpha(5e-4), bd.Radau(max_step=4e-3)], ids=lambda i: i.method
)
@pytest.mark.slow(reason="half a second and more")
def test_runs_with_events_and_breakpoints_are_thinned(integrator, small_memory):
    run = bd.simulate(bouncing(), integrator, 1.5, output_step=0.03)
    whole = bd.simulate(bouncing(), integrator, 1.5, output_step=0.03, keep_steps=True)
    assert len(run.trajectory.intervals) > 4
    assert_array_equal(run.events, whole.events)
    assert_array_equal(run.table(), whole.table())
    assert run.quality == whole.quality
    assert run.trajectory.steps == whole.trajectory.steps


@pytest.mark.slow(reason="half a second and more")
def test_saved_run_has_the_energies_of_all_steps(small_memory, tmp_path):
    run = bd.simulate(bouncing(), bd.GeneralizedAlpha(5e-4), 1.5, output_step=0.03)
    loaded = bd.load(run.save(tmp_path / "ball.run"), bouncing())
    assert loaded.quality == run.quality
    assert_array_equal(loaded.table(), run.table())
    assert loaded.trajectory.steps == run.trajectory.steps
    resumed = bd.simulate(bouncing(), bd.Radau(), 2.0, start=loaded)
    assert loaded.followed_by(resumed).t[-1] == 2.0


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_peaks_between_stored_rows_are_reported_as_unknown(small_memory):
    """The peak of a contact that is in no stored row was lost without a warning."""
    mech, ball = free_ball((0.0, 0.05), gravity=9.81)
    stop = bd.Contact("stop", ball.point, bd.LineSurface(mech.ground.at(0.0, 0.0)), 1e7)
    mech.observe("stop", mech.add(stop).force)
    settings = {"integrator": bd.GeneralizedAlpha(5e-4), "t_end": 2.0, "output_step": 0.1}
    run = bd.simulate(mech, **settings)
    sentence = (
        "this long run stores only some of its steps, so larger peaks between the output rows are "
        "unknown; reduce output_step= or the end time, or use bd.simulate(..., keep_steps=True)."
    )
    # Peaks that are known were to be read from `step_extremes`, and unknown in the next sentence.
    (peaks,) = run.row_warnings
    assert peaks.startswith("stop.N: the output rows miss its largest value")
    assert peaks.endswith(sentence)
    few = bd.simulate(mech, **settings | {"output_step": 0.01})
    assert few.row_warnings == (f"stop.N, stop.T: {sentence}",)
    whole = bd.simulate(mech, **settings, keep_steps=True)
    assert not any(sentence in x for x in whole.warnings)
    assert any(x.startswith("stop.N: the output rows miss") for x in whole.warnings)
    (energy,), (expected,) = (
        [x for x in r.warnings if x.startswith("energy: ")] for r in (run, whole)
    )
    assert energy == expected


def test_derivatives_need_all_steps(small_memory):
    run = bd.simulate(pendulum(), bd.GeneralizedAlpha(5e-4), 1.0, output_step=0.1)
    with pytest.raises(bd.BeamdaeError, match=r"this long run stores \d+ rows of its 2000 steps"):
        run.trajectory.derivative_at(run.t)


def test_failed_runs_keep_their_rows(small_memory):
    def stop(t):
        return "enough" if t > 0.6 else None

    run = bd.simulate(pendulum(), bd.GeneralizedAlpha(5e-4), 1.0, 0.1, progress=stop)
    assert run.status.kind == "limited"
    assert run.trajectory.intervals[0].record is not None
    assert run.trajectory.end > 0.6
    assert_allclose(run.t, [*np.arange(7) * 0.1, run.trajectory.end])
