"""Output rows against steps: mechanisms whose rows miss values, and siblings that stay silent."""

import re
from functools import partial

import casadi as ca
import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, driven, free_ball, rectangle
from mechanisms import dropped_ball as ball

import beamdae as bd

PERIOD = 2.0 * np.pi / 20.0  # of the mass of `vibration` [s]
ALPHA = bd.GeneralizedAlpha(PERIOD / 60.0)

pytestmark = pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")


def stop_law(form, **settings) -> bd.results.Solution:
    """Return a run onto a stop whose force is a formula or a table."""
    mech, body = free_ball(gravity=9.81, velocity=(0.0, -4.43))
    depths = np.linspace(0.0, 4e-4, 41)
    table = bd.table(depths, 1e10 * depths**1.5)
    laws = {
        "formula": lambda p, t: (0.0, 1e10 * np.maximum(-p.position[1], 0.0) ** 1.5),
        "table": lambda p, t: (0.0, table(-p.position[1])),
    }
    mech.observe("stop", mech.add(bd.ForceLaw("stop", body.point, laws[form])).force)
    return bd.simulate(mech, t_end=1e-3, output_step=5e-4, **settings)


def vibration(rows_per_period, method=None, periods=60) -> bd.results.Solution:
    """Return a run of a mass on a spring."""
    mech, mass = free_ball((0.1, 0.0), name="mass")
    spring = bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 400.0, 0.0, 1.0)
    mech.observe("spring", mech.add(spring).load_on("b"))
    end = periods * PERIOD
    return bd.simulate(mech, method, t_end=end, output_step=PERIOD / rows_per_period)


def leaf(output_step) -> bd.results.Solution:
    """Return a run of a steel leaf with a mass under a sudden load, with a period of 64 ms."""
    section = rectangle(0.012, 0.06, damping=2e-4)
    mech, beam = clamped_beam(section, 2, 0.5, name="leaf")
    mech.add(bd.PointMass("payload", 10.0, on=beam.end))
    mech.add(bd.Force("load", beam.end, (0.0, -1000.0)))
    mech.observe("tip", beam.end)
    mech.observe("root", beam.stress(0.0, "top"))
    return bd.simulate(mech, t_end=0.5, output_step=output_step)


def chirp(rows) -> bd.results.Solution:
    """Return a run of a mass on a spring that a sweep drives through the resonance."""
    mech, mass = free_ball(name="mass")
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 4e3, 3.0, 1.0))
    law = lambda t: 10.0 * ca.sin(4.0 * ca.pi * (t + t**2))  # noqa: E731
    mech.add(bd.Force("sweep", mass.point, (law, 0.0)))
    return bd.simulate(mech, t_end=6.0, output_step=6.0 / rows)


def double_pendulum(rows, size=1.0, method=None) -> bd.results.Solution:
    """Return a run of two rods of this size, relative to 0.4 m."""
    mech, length = bd.Mechanism(gravity=EARTH), 0.4 * size
    ends = (0.0, 0.0), (length, 0.0), (2.0 * length, 0.0)
    upper, lower = (
        mech.add(bd.RigidBody.rod(name, *pair, mass=1.0))
        for name, pair in (("upper", ends[:2]), ("lower", ends[1:]))
    )
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(*ends[0]), upper.at(*ends[0])))
    mech.add(bd.Revolute("knee", upper.at(*ends[1]), lower.at(*ends[1])))
    mech.observe("hinge", hinge.reaction)
    mech.observe("tip", lower.at(*ends[2]))
    mech.observe("pivot", upper.at(*ends[0]))
    end = 5.0 * np.sqrt(size)
    return bd.simulate(mech, method, t_end=end, output_step=end / rows)


def stage(output_step) -> bd.results.Solution:
    """Return a run of a stage between two flexures, whose angle is parasitic."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("stage", mass=0.3, inertia=1e-4, center=(0.0, 0.0)))
    aluminum = bd.Material(E=70e9, nu=0.3, rho=2700.0)
    section = rectangle(5e-4, damping=1e-4, material=aluminum)
    for name, side in (("right", 1.0), ("left", -0.999)):
        line = bd.Line((0.12 * side, 0.0), (0.02 * side, 0.0))
        flexure = mech.add(bd.Beam(name, line, section, elements=2))
        mech.add(bd.Weld(f"base {name}", mech.ground.at(0.12 * side, 0.0), flexure.start))
        mech.add(bd.Weld(f"stage {name}", flexure.end, body.at(0.02 * side, 0.0)))
    mech.add(bd.Force("push", body.at(0.0, 0.0), (0.0, bd.sine(1.0, 8.0))))
    mech.observe("stage", body.at(0.0, 0.0))
    return bd.simulate(mech, t_end=0.5, output_step=output_step)


def blade(rows) -> bd.results.Solution:
    """Return a run of a blade at constant speed, whose stress varies by 3e-8."""
    speed = 314.0
    mech, hub = driven(bd.RigidBody("hub", mass=4.0, inertia=0.02), lambda t: speed * t)
    section = rectangle(0.006, 0.04, damping=2e-5)
    line = bd.Line((0.12, 0.0), (0.47, 0.0))
    beam = mech.add(bd.Beam("blade", line, section, strain="exact", elements=2))
    mech.add(bd.Weld("clamp", hub.at(0.12, 0.0), beam.start))
    mech.observe("root", beam.stress(0.0, "top"))
    mech.observe("tip", beam.deflection(0.35))
    settings = {"t_end": 0.05, "output_step": 0.05 / rows, "start": bd.rotation(speed)}
    return bd.simulate(mech, bd.Auto(1e-5), **settings)


def bounce(rows) -> bd.results.Solution:
    """Return a run of a ball whose velocity jumps."""
    mech, body = free_ball((0.0, 1.0), gravity=9.81)
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(body.point)
    mech.when(gap, direction="down", do=bd.impact(gap, restitution=0.8), name="hit")
    return bd.simulate(mech, t_end=2.0, output_step=2.0 / rows)


def magnitude(output_step) -> bd.results.Solution:
    """Return a run of a vibrating strip, whose largest stress has valleys at zero."""
    section = rectangle(0.004, damping=1e-3)
    mech, strip = clamped_beam(section, 1, 0.5, name="strip")
    mech.add(bd.Force("push", strip.end, (0.0, bd.sine(1.0, 5.0, 0.5 * np.pi))))
    mech.observe("stress", strip.largest_stress())
    settings = {"t_end": 0.4, "output_step": output_step, "start": "equilibrium"}
    return bd.simulate(mech, bd.Radau(1e-5), **settings)


def weld(method) -> bd.results.Solution:
    """Return a run of a body at rest, with the reactions that hold it."""
    mech = bd.Mechanism(gravity=EARTH)
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, center=(0.3, 0.4)))
    joint = mech.add(bd.Weld("weld", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    mech.observe("weld", joint.reaction)
    return bd.simulate(mech, method, t_end=1.0)


MISSED = {
    # Columns are named first if they are missed by the most.
    "contact": ("stop.N", lambda: bd.simulate(ball)),
    "contact, Radau": ("stop.N", lambda: bd.simulate(ball, bd.Radau(1e-6))),
    "contact, alpha": ("stop.N", lambda: bd.simulate(ball, bd.GeneralizedAlpha(rtol=1e-5))),
    "formula": ("stop.Fy", partial(stop_law, "formula")),
    "table, alpha": ("stop.Fy", partial(stop_law, "table", integrator=bd.GeneralizedAlpha(1e-6))),
    "0.9 rows a period, alpha": ("mass.x_dot", partial(vibration, 0.9, ALPHA)),
    "1.9 rows a period": ("mass.x", partial(vibration, 1.9, bd.Radau(1e-6))),
    "3 rows a period": ("mass.x", partial(vibration, 3.0, bd.Radau(1e-6))),
    "4.2 rows a period": ("mass.x", partial(vibration, 4.2, bd.Radau(1e-6))),
    "5.1 rows a period": ("mass.x", partial(vibration, 5.1, bd.Radau(1e-6))),
    "5.1 rows a period, alpha": ("mass.x_dot", partial(vibration, 5.1, ALPHA)),
    "leaf": ("tip.y", partial(leaf, 0.1)),
    "chirp": ("mass.x", partial(chirp, 300)),
    "double pendulum": ("hinge.Fy", partial(double_pendulum, 25)),
    "large double pendulum": ("hinge.Fy", partial(double_pendulum, 25, 100.0)),
    "small double pendulum": ("hinge.Fy", partial(double_pendulum, 25, 0.01)),
    "stage": ("stage.y_dot", partial(stage, 0.03)),
    "bounce": ("ball.y", partial(bounce, 20)),
}
SHOWN = {
    "soft contact": lambda: bd.simulate(ball(stiffness=1e4)),
    "10.3 rows a period": partial(vibration, 10.3, bd.Radau(1e-6)),
    "10.3 rows a period, alpha": partial(vibration, 10.3, ALPHA),
    "40 rows a period": partial(vibration, 40.0),
    "two rows": partial(vibration, 0.1, periods=10),
    "leaf": partial(leaf, 1e-3),
    "chirp": partial(chirp, 1500),
    "double pendulum": partial(double_pendulum, 1000),
    "large double pendulum": partial(double_pendulum, 1000, 100.0),
    "small double pendulum, Ida": partial(double_pendulum, 1000, 0.01, bd.Ida(1e-4)),
    "double pendulum, alpha": partial(double_pendulum, 1000, 1.0, bd.GeneralizedAlpha(rtol=1e-4)),
    "stage": partial(stage, 2e-3),
    "blade, few rows": partial(blade, 5),
    "blade": partial(blade, 1000),
    "bounce": partial(bounce, 1000),
    "valleys of magnitudes": partial(magnitude, 0.01),
    "rest": partial(weld, None),
    "rest, alpha": partial(weld, bd.GeneralizedAlpha(step=0.005)),
}


@pytest.mark.slow(reason="seconds for all mechanisms")
@pytest.mark.parametrize(("column", "compute"), MISSED.values(), ids=MISSED)
def test_rows_that_miss_values_have_one_sentence(column, compute):
    run = compute()
    (sentence,) = run.row_warnings
    assert sentence.startswith(f"{column}: the output rows miss ")
    assert sentence in run.model_warnings
    missed = run.missed_peaks[column]
    assert missed.error > 0.04
    # The value is that of the run, and the rows do not reach it.
    value = run.at_times([0.0, missed.time])[column].iloc[-1]
    assert value == pytest.approx(missed.value, abs=0.01 * missed.half_range)
    rows = run[column].to_numpy()
    k = np.searchsorted(run.t, missed.time)
    near = rows if missed.is_extreme else rows[k - 1 : k + 1]
    sign = 1.0 if missed.side == "largest" else -1.0
    assert max(sign * near) == pytest.approx(sign * missed.row_value)
    assert sign * missed.value > sign * missed.row_value


@pytest.mark.slow(reason="seconds for all mechanisms")
@pytest.mark.parametrize("compute", SHOWN.values(), ids=SHOWN)
def test_rows_that_show_the_motion_have_no_sentence(compute):
    run = compute()
    assert run.row_warnings == ()
    assert len(run.t) == 2 or not run.missed_peaks


def test_the_sentence_names_value_rows_and_remedy(tmp_path):
    with pytest.warns(bd.BeamdaeWarning, match="the output rows miss") as caught:
        run = bd.simulate(ball)
    (sentence,) = [str(x.message) for x in caught]
    assert re.fullmatch(
        r"stop\.N: the output rows miss its largest value, 6\d{4} N at t = 0\.4516\d+ s, and reach "
        r"only 0 N; tables of extremes and step_extremes include these values; curves show them "
        r"with a smaller output_step\.",
        sentence,
    )
    assert sentence in run.page(tmp_path / "ball.html").read_text(encoding="utf-8")
    (sentence,) = vibration(1.9).row_warnings
    assert "the output rows miss values between them, " in sentence
    assert re.search(r", where they reach only \S+ m, also in \S+, \S+; ", sentence)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_missed_extremes_come_before_notes_on_the_model():
    """The head of a page showed notes, and extremes that the rows miss were below them."""
    mech = ball()
    cart = mech.add(bd.RigidBody("cart", mass=1.0, inertia=0.1))
    law = bd.piecewise((0.2, 0.0), lambda t: t - 0.2)
    mech.add(bd.Driver("turn", mech.ground.at(5.0, 0.0), cart.at(0.0, 0.0), law=law))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), cart.at(0.0, 0.0)))
    first, second = bd.simulate(mech, t_end=0.6).warnings
    assert "the output rows miss" in first
    assert second.startswith("turn: the slope of its law jumps at t = 0.2 s")


@pytest.mark.slow(reason="half a second")
def test_stresses_of_damping_at_an_impact_have_an_error_by_the_elements():
    """Strain rates at a jump of velocities depend on the length of the element."""
    section = rectangle(0.0012, 0.012, damping=3e-5)
    mech, beam = clamped_beam(section, 4, 0.12, name="leaf", gravity=9.81)
    mech.add(bd.PointMass("hammer", 0.03, on=beam.end))
    mech.add(bd.Force("magnet", beam.end, (0.0, -20.0)))
    gap = bd.LineSurface(mech.ground.at(0.0, -0.002), (1.0, 0.0)).gap(beam.end)
    mech.when(gap, direction="down", do=bd.impact(gap, restitution=0.6), name="hit")
    mech.observe("stress", beam.largest_stress())
    run = bd.simulate(mech, t_end=4e-3, output_step=1e-4)
    assert run.missed_peaks["stress.largest"].error > 0.5
    (error,) = run.errors.table().loc[["stress.largest [Pa]"], "mesh"]
    assert error > 0.5


@pytest.mark.parametrize("rows", [60, 450])
def test_names_without_units_are_accepted(rows):
    run = bd.simulate(ball, output_step=0.6 / rows)
    assert "stop.N" in run.missed_peaks
    assert run.missed_peaks.get("stop.N") is run.missed_peaks["stop.N [N]"]
    assert run.missed_peaks.get("stop.Q") is None
    with pytest.raises(bd.BeamdaeError, match="did you mean"):
        run.missed_peaks["stop.n"]


def test_steps_outside_the_rows_are_no_misses():
    assert not bd.simulate(ball).at_times(np.linspace(0.0, 0.4, 50)).missed_peaks
