"""Warnings of runs: energy imbalance, residual, columns that are not finite, early ends."""

import json
import warnings
from dataclasses import replace

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from mechanisms import clamped_beam, free_ball, rectangle, symbols
from numpy.testing import assert_allclose
from tolerances.mechanisms import parallelogram

import beamdae as bd
from beamdae.model_checks import run_checks
from beamdae.results.columns import observed_columns


def bar(law=None, gravity=(0.0, -9.81), angle=0.0):
    """Return a hinged bar that hangs, lies or stands, with a moment on it."""
    mech = bd.Mechanism(gravity=gravity)
    center = (float(np.sin(angle)), -float(np.cos(angle)))
    body = mech.add(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=center))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    if law is not None:
        mech.add(bd.Moment("push", body.at(0.0, 0.0), law))
    mech.observe("tip", body.at(*center))
    return mech


def particle(force, start=0.0, **settings):
    """Return a mass of 1 kg under a force of t and q that is not known as a law."""
    t, q, v = symbols()
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0], force=[force(t, q)], q0=[start], v0=[0.0], **settings
    )


@pytest.mark.parametrize(
    "law",
    [
        lambda t: 1.0 / (t - 0.0103),
        lambda t: 1.0 / (t - 0.98765) ** 2,
        lambda t: np.tan(3.0 * t),
        lambda t: np.exp(1e5 * t),
        bd.piecewise((0.4, lambda t: 1.0 / (t - 0.6)), lambda t: 1.0 / (t - 0.7)),
    ],
)
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha()])
def test_regression_a_law_with_a_pole_is_rejected(law, integrator):
    """Fixed steps skipped the pole, and the run reached its end."""
    with pytest.raises(bd.BeamdaeError, match=r"^push: the law becomes infinite near t = 0\.\d+ s"):
        bd.simulate(bar(law), integrator, 1.0)


@pytest.mark.parametrize(
    "law",
    [
        bd.piecewise((0.4, lambda t: 1.0 / (t - 0.6)), lambda t: 1.0 / (t - 0.3)),
        lambda t: 1.0 / (t - 1.1),
        lambda t: np.exp(-(((t - 0.3217) / 1e-5) ** 2)),
        lambda t: np.tanh((t - 0.3) / 1e-7),
        lambda t: 10.0 * np.sin(300.0 * t),
        bd.run_up(3.0, 0.5),
    ],
)
def test_laws_with_peaks_or_poles_outside_the_run_are_accepted(law):
    assert bd.simulate(bar(law), bd.GeneralizedAlpha(step=0.01), 1.0).status.success


def slider():
    """Return a mass on a rail in the slot of an arm that rotates past the direction of the rail."""
    mech = bd.Mechanism()
    origin = mech.ground.at(0.0, 0.0)
    arm = mech.add(bd.RigidBody("arm", mass=1.0, inertia=0.1, center=(0.0, 0.0)))
    mech.add(bd.Revolute("hinge", origin, arm.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", origin, arm.at(0.0, 0.0), law=lambda t: t))
    mass = mech.add(bd.PointMass("slider", 1.0, at=(0.0, 1.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 1.0), mass.point))
    mech.add(bd.PointOnLine("slot", arm.at(0.0, 0.0), mass.point, direction=(0.0, 1.0)))
    return mech


@pytest.mark.parametrize(
    ("model", "step", "t_end"),
    [
        (slider(), 1e-2, 3.0),
        (parallelogram(rocker=0.2001), 1e-3, 2.0),
        (particle(lambda t, q: 1.0 / (t - 0.0103)), 1e-3, 1.0),
    ],
    ids=["through infinity", "nearly singular", "a force with a pole"],
)
def test_regression_an_energy_imbalance_is_reported(model, step, t_end):
    """The runs reached the end with an imbalance of a third or more, without a warning."""
    integrator = bd.GeneralizedAlpha(step=step)
    with pytest.warns(
        bd.BeamdaeWarning,
        match=r"^energy: the energy imbalance is [\d.]+ % of the energy exchanged",
    ):
        solution = bd.simulate(model, integrator, t_end)
    assert solution.status.success
    assert solution.quality.energy_imbalance > 0.1


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("flywheel", [0.0, 300.0])
@pytest.mark.parametrize(("step", "is_stated"), [(2e-3, True), (1e-3, True), (2e-4, False)])
def test_errors_of_impacts_of_few_steps_are_measured(flywheel, step, is_stated):
    """With steps of 1 ms, the peak was percents off; the impact takes 9 ms.

    A wheel with thirty times the energy hides the imbalance of the impact.
    """
    mech, ball = free_ball((0.0, 1.0), gravity=9.81)
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.observe("stop", mech.add(bd.Contact("stop", ball.point, floor, 1e6)).force)
    if flywheel:
        rate = (2.0 * flywheel) ** 0.5
        wheel = mech.add(bd.RigidBody("wheel", 1.0, 1.0, (3.0, 0.0), angular_velocity=rate))
        mech.add(bd.Revolute("bearing", mech.ground.at(3.0, 0.0), wheel.at(3.0, 0.0)))
    run = bd.simulate(mech, bd.GeneralizedAlpha(step=step), t_end=0.6)
    # The largest force of m y'' = -k (-y)^1.5 with the energy m g h.
    depth = (2.5 * 9.81 / 1e6) ** 0.4
    true = abs(float(run["stop.N"].max()) / (1e6 * depth**1.5) - 1.0)
    stated = float(run.errors.table()["total"]["stop.N [N]"])
    assert (stated > 0.02) == is_stated
    assert stated > 0.5 * true


@pytest.mark.parametrize(
    "integrator", [bd.Ida(1e-3), bd.Radau(1e-3), bd.GeneralizedAlpha(step=0.01)]
)
@pytest.mark.parametrize(
    "model",
    [
        bar(),
        bar(angle=1e-9),
        bar(gravity=(0.0, 0.0)),
        bar(lambda t: 0.0 * t),
        particle(lambda t, q: 0.0 * t),
        particle(lambda t, q: -9.81 + 0.0 * q),
    ],
    ids=["at rest", "nearly at rest", "no force", "no moment", "nothing at all", "free fall"],
)
def test_systems_at_rest_have_no_warnings(model, integrator):
    """The reference values of energies and forces are zero or rounding noise there."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not bd.simulate(model, integrator, 1.0).warnings


def magnet(datum):
    """Return a ball that swings through an attracting magnet whose potential is `datum` far away.

    The potential is negative for `datum` = 0, and so is the sum of kinetic and potential energy.
    """
    strength, gap = 2e-3, 0.01
    mech, ball = free_ball((0.05, 0.0), 0.1)

    def pull(ball, t):
        x, y = ball.position
        distance = np.sqrt(x**2 + y**2 + gap**2)
        return (-strength * x / distance**3, -strength * y / distance**3)

    def potential(ball):
        x, y = ball.position
        return datum - strength / np.sqrt(x**2 + y**2 + gap**2)

    mech.add(bd.ForceLaw("magnet", ball.point, pull, energy=potential))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", [bd.Ida(1e-4), bd.Radau(1e-4)])
def test_regression_an_attracting_magnet_has_no_false_alarm(integrator):
    """The energy exchanged was the largest sum of kinetic and negative potential energy, zero."""
    quality = {}
    for datum in (0.0, -10.0, 1e3):  # [J]; the ball exchanges 0.16 J
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            solution = bd.simulate(magnet(datum), integrator, 2.0)
        quality[datum] = solution.quality.energy_imbalance
    assert quality[0.0] < 100.0 * integrator.rtol  # the guaranteed accuracy
    # The datum only adds rounding errors, 1e-16 of it.
    assert_allclose(list(quality.values()), quality[0.0], rtol=0.0, atol=1e-11)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_controllers_without_an_actuator_leave_a_stage_at_rest():
    """The integral of the controller moved, so that rounding errors had a warning."""
    mech = bd.Mechanism()
    section = rectangle(4e-4, 0.01, damping=1e-5)
    stage = mech.add(bd.RigidBody.plate("stage", (0.0, 0.09), 0.06, 0.02, mass=0.25))
    for name, x in (("left", -0.025), ("right", 0.025)):
        ends = bd.Line((x, 0.0), (x, 0.08))
        leaf = mech.add(bd.Beam(name, ends, section, elements=3, formulation="exact"))
        mech.add(bd.Weld(f"{name} clamp", mech.ground.at(x, 0.0), leaf.start))
        mech.add(bd.Weld(f"{name} screw", leaf.end, stage.at(x, 0.08)))
    point = stage.at(0.0, 0.09)
    mech.observe("stage", point)
    error = 1e-3 - mech.sensor("position", point, "x")
    bd.pid(mech, "pid", error, 1e3, 1e5, 0.0, scale=1e-5)
    (sentence,) = bd.simulate(mech, t_end=0.15).warnings
    assert sentence.startswith("pid: its output is used by no part")


@pytest.mark.slow(reason="a fifth of a second")
def test_prestressed_rings_at_rest_have_no_warnings():
    """The strain energy is large and constant; only rounding noise is exchanged."""
    mech = bd.Mechanism()
    strip = rectangle(0.001)
    circle = bd.Arc(radius=0.1, length=0.2 * np.pi)
    straight = bd.Line((0.0, 0.0), (circle.length, 0.0))
    first, *_ = bd.welded_beams(
        mech, "ring", circle, strip, bodies=4, closed=True, elements=2, free_curve=straight
    )
    mech.add(bd.Weld("clamp", mech.ground.at(*first.start.point), first.start))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = bd.simulate(mech, bd.Radau(1e-3), 1.0)
    assert solution.quality.energy_imbalance < 1e-4


def test_columns_that_are_not_finite_are_named():
    t, q, v = symbols()
    observe = {"root": ca.sqrt(0.5 - t), "inverse": 1.0 / (q - q), "fine": q}
    model = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0], force=[1.0], q0=[0.0], v0=[0.0], observe=observe
    )
    solution = bd.simulate(model, bd.Ida(), 1.0)
    messages = [w for w in solution.warnings if "not finite" in w]
    assert len(messages) == 2
    assert messages[0].startswith(
        "root [-]: this column is not finite at 500 of 1001 times, first at t = 0.501 s"
    )
    assert messages[1].startswith("inverse [-]: this column is not finite at 1001 of 1001 times")


def test_warnings_are_those_of_the_checks_in_order(monkeypatch):
    solution = bd.simulate(bar(angle=1.0), bd.Ida(), 0.1)

    def check(word):
        return lambda run: [f"{word} until t = {run.t[-1]:g} s"]

    of_rows = check("peaks")
    monkeypatch.setattr(run_checks, "ROW_CHECKS", (of_rows,))
    monkeypatch.setattr(run_checks, "RUN_CHECKS", (check("balance"), of_rows, lambda run: ()))
    solution = replace(solution)
    assert solution.warnings == ("balance until t = 0.1 s", "peaks until t = 0.1 s")
    assert solution.row_warnings == ("peaks until t = 0.1 s",)


FAILING = (bar(lambda t: np.sqrt(0.5 - t)), bd.GeneralizedAlpha(step=0.02))
LIMITED = (bar(angle=1.0), bd.Ida(max_steps=20))


def interrupt(t):
    if t > 0.0:
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("run", "progress", "kind"),
    [(FAILING, None, "failed"), (LIMITED, None, "limited"), (LIMITED, interrupt, "interrupted")],
)
def test_regression_unfinished_runs_warn_and_mark_their_files(run, progress, kind, tmp_path):
    """The table of an unfinished run looked like any other."""
    model, integrator = run
    if kind == "interrupted":
        integrator = bd.Ida(1e-8)
    with pytest.warns(bd.BeamdaeWarning, match=rf"^simulate: the run was not finished \({kind}\)"):
        solution = bd.simulate(model, integrator, 1.0, progress=progress, partial="return")
    assert solution.status.kind == kind
    path = solution.to_csv(tmp_path / "run.csv")
    assert path == tmp_path / "run.csv"
    table = pd.read_csv(path)
    assert list(table)[-1] == "status"
    assert set(table["status"]) == {kind}
    # Selecting columns by name is not affected.
    assert list(table)[:-1] == list(solution.table())
    sidecar = json.loads(path.with_suffix(".json").read_text())
    assert list(sidecar)[:2] == ["status", "reason"]
    assert (sidecar["status"], sidecar["reason"]) == (kind, solution.status.sentence)


def test_finished_runs_have_no_status_column(tmp_path):
    solution = bd.simulate(bar(angle=1.0), bd.Ida(), 1.0)
    path = solution.to_csv(tmp_path / "run.csv")
    assert list(pd.read_csv(path)) == list(solution.table())
    assert json.loads(path.with_suffix(".json").read_text())["status"] == "ok"


def test_observables_may_have_the_names_of_drift_columns():
    mech = bar(angle=1.0)
    mech.observe("drift", mech.parts["bar"].at(0.0, 0.0))
    mech.observe("drift.position", mech.parts["bar"].at(0.0, 0.0))
    with pytest.raises(bd.BeamdaeError, match=r"the observable name 'energy\.x' is reserved"):
        mech.observe("energy.x", mech.parts["bar"].at(0.0, 0.0))
    solution = bd.simulate(mech, bd.Ida(1e-3), 1.0)
    names = list(solution.observed)
    assert {"drift.x [m]", "drift.position.x [m]"} <= set(names)
    assert observed_columns(solution.table()) == names
    assert list(solution.errors.table().index) == names
    system = particle(
        lambda t, q: -q, start=1.0, names=["energy"], observe={"drift.position": ca.SX(1.0)}
    )
    solution = bd.simulate(system, bd.Ida(1e-3), 1.0)
    assert observed_columns(solution.table()) == ["energy [-]", "drift.position [-]"]


@pytest.mark.parametrize("integrator", [bd.Radau(1e-4), bd.GeneralizedAlpha(step=1e-3)])
def test_regression_formulas_whose_terms_cancel_leave_a_run_at_rest(integrator):
    """A force of 1e-10 N by rounding exceeded half the largest force during 27 % of the run."""
    mech, ball = free_ball((0.3, 0.1))

    def springs(ball, t):
        x, y = ball.position
        return 1e6 * (0.1 + 0.2) - 1e6 * x, 1e6 * (0.1 - y)

    mech.add(bd.ForceLaw("springs", ball.point, springs))
    assert not bd.simulate(mech, integrator, t_end=1.0).warnings


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_causes_in_the_model_precede_their_consequences():
    """The overshoot of a table was the last warning, after peaks of a meaningless deformation."""
    section = rectangle(0.004, damping=1e-3)
    mech, beam = clamped_beam(section, 2, 0.3, name="arm", formulation="exact")
    with pytest.warns(bd.BeamdaeWarning, match="press: the spline reaches") as issued:
        law = bd.table([0.0, 0.0199, 0.0201, 0.1], [0.0, 0.0, 60.0, 60.0], name="press")
    mech.add(bd.Force("push", beam.end, (0.0, law)))
    mech.build_warnings = tuple(str(x.message) for x in issued)
    mech.observe("clamp", beam.section_forces(0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = bd.simulate(mech, t_end=0.1, output_step=5e-3)
    assert len(run.missed_peaks) > 0
    first, second, *others = run.warnings
    assert first.startswith("press: the spline reaches")
    assert "the deformation is meaningless" in second
    assert not any("output rows" in x for x in others), others


@pytest.mark.parametrize(
    "analyze",
    [
        pytest.param(bd.equilibrium, id="failed path"),
        pytest.param(lambda x: bd.equilibrium(x, to=0.1), id="path"),
        pytest.param(
            lambda x: bd.simulate(x, t_end=20.0),
            id="stopped run",
            marks=pytest.mark.slow(reason="a second and more"),
        ),
        pytest.param(lambda x: bd.simulate(x, t_end=0.5), id="run"),
    ],
)
def test_strains_beyond_linear_elasticity_are_named_once(analyze):
    """A path that failed and a run that was stopped named them in their reason and beside it."""
    soft = bd.Material(E=211e3, nu=0.31, rho=7800.0)
    section = rectangle(0.006, 0.05, material=soft)
    mech, beam = clamped_beam(section, 4, 0.4, name="leaf", formulation="exact")
    mech.add(bd.Force("load", beam.end, (0.0, -300.0)))
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        analyze(mech)
    text = " ".join(str(x.message) for x in issued)
    assert text.count("far beyond linear elasticity") == 1, text
