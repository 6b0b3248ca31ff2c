"""Errors of runs are those beside much more accurate runs."""

import numpy as np
import pytest
from hub_beam import hub_beam
from mechanisms import beam_pendulum, cantilever, clamped_beam, free_ball, rectangle
from quick_return import quick_return

import beamdae as bd

# The sizes that are stated are right within a factor of two.
FACTOR = 2.0


def simulate(model, method=None, t_end=None, rows=400):
    mechanism = model if isinstance(model, bd.Mechanism) else model()
    t_end = t_end or model.t_end
    return bd.simulate(mechanism, method, t_end=t_end, output_step=t_end / rows)


def true_errors(solution, reference):
    """Return root mean squares of the deviations, relative to those from the mean."""
    exact = reference.observed
    deviation = exact.std(ddof=0)
    units = deviation.groupby(deviation.index.str.extract(r"\[(.*)\]", expand=False).to_numpy())
    # Columns that joints hold fixed are rounding errors.
    moving = exact.columns[deviation > 1e-6 * units.transform("max")]
    difference = solution.observed[moving] - exact[moving]
    return np.sqrt((difference**2).mean()) / exact[moving].std(ddof=0)


def assert_is_measured(solution, reference, limit=0.04):
    """Require that errors above the limit are stated, and that columns without errors have none."""
    true, stated = true_errors(solution, reference), solution.errors.table()["total"]
    wrong = true[true > limit]
    assert len(wrong)
    ratio = stated[wrong.index] / wrong
    # Errors of the extremes may be larger than those of the rows.
    assert ratio.min() > 1.0 / FACTOR
    assert (stated[true[true < 0.25 * limit].index] < limit).all()
    return solution.errors


@pytest.mark.slow(reason="references")
@pytest.mark.parametrize(
    ("settings", "method", "cause"),
    [
        ({"elements": 1}, None, "mesh"),
        ({"torque": 60.0}, None, "theory"),
        ({}, bd.Ida(0.05), "time"),
        ({}, bd.GeneralizedAlpha(0.02), "time"),
    ],
)
def test_errors_of_a_turning_beam_are_stated_with_their_cause(settings, method, cause):
    solution = simulate(hub_beam(**settings), method, hub_beam.t_end)
    fine = settings | {"elements": 8, "formulation": "exact"}
    reference = simulate(hub_beam(**fine), bd.Radau(1e-7), hub_beam.t_end)
    table = assert_is_measured(solution, reference).table()
    worst = table["total"].idxmax()
    assert table.loc[worst, ["time", "mesh", "theory"]].astype(float).idxmax() == cause
    (sentence,) = solution.errors.sentences()
    assert sentence.startswith(worst.partition(" [")[0] + ": the error is about")
    assert sentence in solution.warnings


@pytest.mark.parametrize("moment", [0.1, 0.13])
@pytest.mark.parametrize("method", [bd.Radau(1e-6), bd.GeneralizedAlpha(step=1e-3)])
def test_errors_of_columns_at_rest_are_those_of_their_values(method, moment):
    # A strip bent into an arc of the radius EI / M by an end moment, from its equilibrium on.
    length, steel = 0.3, bd.Material(E=2e11, nu=0.3, rho=7850.0)
    strip = rectangle(0.0005, 0.01, material=steel)
    mech, beam = clamped_beam(strip, 1, length, name="strip", start="equilibrium")
    mech.add(bd.Moment("bend", beam.end, moment))
    mech.observe("tip", beam.end)
    solution = simulate(mech, method, 0.1)
    radius = strip.EI / moment
    exact = radius * np.array([np.sin(length / radius), 1.0 - np.cos(length / radius)])
    names = ["tip.x [m]", "tip.y [m]"]
    displacement = exact - [length, 0.0]
    true = np.abs([solution.columns[x][-1] for x in names] - exact) / np.abs(displacement)
    stated = solution.errors.table().loc[names, "total"]
    ratios = stated / true
    assert (ratios > 1.0 / FACTOR).all()
    assert (ratios < FACTOR).all()


@pytest.mark.slow(reason="references")
def test_regularized_friction_is_an_error_like_others():
    solution = simulate(quick_return, bd.Radau(1e-5))
    sharp = quick_return(friction_speed=1e-4)
    reference = simulate(sharp, bd.Radau(1e-8), quick_return.t_end)
    errors = assert_is_measured(solution, reference)
    assert "friction_speed of rubbing" in errors.recommend()


def test_causes_of_errors_are_named_and_add_up_to_the_total():
    """Without beams, the elements were named; the parts of other errors exceeded the total."""
    mech, mass = free_ball(velocity=(0.5, 0.0), name="mass", gravity=9.81)
    guide = mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 40.0, free_length=1.0))
    mech.add(bd.Friction("rubbing", guide, coefficient=0.1, friction_speed=0.2))
    errors = simulate(mech, bd.GeneralizedAlpha(0.05), 2.0).errors
    (sentence,) = errors.sentences()
    assert "steps " in sentence
    assert "friction speed " in sentence
    assert "elements" not in sentence
    parts = np.array(list(errors.causes.values()))
    np.testing.assert_allclose(parts.sum(axis=0), errors.total, rtol=1e-12, atol=1e-12)
    assert np.abs(errors.causes["friction"]).max() > 0.04
    assert not errors.causes["mesh"].any()


def test_runs_that_step_over_a_pulse_have_warnings():
    """The nodes of all steps are zeros of the pulse: at rest, errors of 120 % had no warning."""
    mech = beam_pendulum(elements=2)
    mech.gravity = np.zeros(2)
    pulse = bd.half_sine(100.0, duration=1e-3)
    mech.add(bd.Force("hit", mech.parts["beam"].end, (0.0, pulse)))
    with pytest.warns(bd.BeamdaeWarning, match="the error is more than 100 % of half its range"):
        bd.simulate(mech, bd.GeneralizedAlpha(1e-3), t_end=0.02)


def test_the_recommended_settings_remove_the_error():
    solution = simulate(beam_pendulum(elements=1), bd.Radau(1e-4), 1.0)
    before = solution.errors
    if before.largest < 0.04:
        pytest.fail("the pendulum with one element is expected to be wrong")
    after = simulate(beam_pendulum(elements=4), bd.Radau(1e-5), 1.0).errors
    assert after.largest < 0.04
    assert not list(after.sentences())
    assert (after.table()["status"] == "measured").all()


def test_runs_that_cannot_be_checked_say_why(tmp_path):
    mech = beam_pendulum(elements=1)
    solution = simulate(mech, bd.Radau(1e-4), 0.2)
    path = solution.save(tmp_path / "run.beamdae")
    later = bd.simulate(mech, bd.Radau(1e-4), t_end=0.4, start=solution)
    stopped = simulate(mech, bd.Radau(1e-4, max_steps=3), 0.2)
    for run, reason in (
        (bd.load(path, mech), "the run was loaded from a file"),
        (later, "the run was resumed"),
        (stopped, "the run stopped early"),
    ):
        assert set(run.errors.table()["status"]) == {f"not checked: {reason}"}
        assert np.isnan(run.errors.largest)
        assert not list(run.errors.sentences())


def test_nothing_is_measured_where_warnings_are_ignored(monkeypatch):
    counts = []
    integrate = bd.Radau.integrate

    def count(self, *arguments, **options):
        counts.append(self.rtol)
        return integrate(self, *arguments, **options)

    monkeypatch.setattr(bd.Radau, "integrate", count)
    solution = simulate(beam_pendulum(elements=1), bd.Radau(1e-4), 0.1)
    assert counts == [1e-4]
    assert solution.errors.largest >= 0.0
    assert len(counts) > 1


def test_another_method_shows_errors_of_steps_only():
    solution = simulate(beam_pendulum(elements=1), bd.Radau(1e-5), 0.5)
    compared = bd.verify(solution, bd.Ida(1e-5))
    assert compared.largest < 0.01
    with pytest.raises(bd.BeamdaeError, match="solution must be a Solution of a run, got 1"):
        bd.verify(1)


def test_beams_that_keep_their_mesh_are_named_in_the_table():
    floating_frame = type(cantilever(2).parts["beam"].kinematics)
    mech = cantilever(2, load=(0.0, -1.0), kinematics=floating_frame)
    run = bd.simulate(mech, bd.Radau(), 0.01)
    (status,) = set(run.errors.table()["status"])
    assert status == "measured; beam is not refined: its kinematics are custom ones"
