"""Derivatives of runs against closed forms, an independent recursion and differences of runs."""

import math
import warnings
from functools import partial

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
from differentiable_models import skater, swing, turning
from four_bar import four_bar
from governor import governor
from hub_beam import hub_beam
from leaf_spring_vehicle import leaf_spring_vehicle
from mechanisms import (
    EARTH,
    clamped_beam,
    crank_and_ram,
    free_ball,
    hinged_body,
    mass_on_rail,
    rectangle,
    symbols,
)
from pendulum import pendulum
from quick_return import quick_return
from ring_mount import ring_mount
from shallow_arch import shallow_arch
from slider_crank import slider_crank
from sliding_mass import sliding_mass
from spin_up import spin_up
from support import differences_of_runs

import beamdae as bd
from beamdae import quantities

MASS, SPEED = 2.0, 0.3


@bd.model(t_end=1.0)
def oscillator(stiffness=40.0, damping=0.8, speed=SPEED, elements=1, scale=0.0):
    """Mass on a spring and a damper, moving along the line of the spring."""
    mech, mass = free_ball(
        (1.0, 0.0), velocity=(speed, 0.0), mass=MASS, name="mass", spring=(stiffness, damping)
    )
    mech.add(bd.Force("pull", mass.point, (abs(scale), 0.0)))
    return mech


def exact_position(stiffness, damping, speed, t):
    rate = 0.5 * damping / MASS
    omega = np.sqrt(stiffness / MASS - rate**2 + 0j)
    return np.exp(-rate * t) * speed / omega * np.sin(omega * t)


def complex_step(function, values, name):
    """Return the derivative of an analytic function, accurate to rounding."""
    h = 1e-30
    return function(**{**values, name: values[name] + 1j * h}).imag / h


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", ["stiffness", "damping", "speed"])
def test_oscillator_converges_to_closed_form_with_order_two(name):
    values = {"stiffness": 40.0, "damping": 0.8, "speed": SPEED}
    errors = []
    for step in (4e-3, 2e-3):
        result = bd.sensitivities(oscillator, name, bd.GeneralizedAlpha(step=step))
        exact = complex_step(partial(exact_position, t=result.t), values, name)
        errors.append(np.abs(result.sensitivity("mass.x", name) - exact).max())
    assert errors[0] < 1e-3 * np.abs(exact).max()
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("integrator", [bd.Radau(rtol=1e-9), bd.Auto(rtol=1e-9)])
def test_oscillator_by_radau(integrator):
    values = {"stiffness": 40.0, "damping": 0.8, "speed": SPEED}
    result = bd.sensitivities(oscillator, list(values), integrator)
    for name in values:
        exact = complex_step(partial(exact_position, t=result.t), values, name)
        # The errors decrease from 1e-7 at rtol = 1e-5 to 1e-13 at rtol = 1e-11.
        np.testing.assert_allclose(
            result.sensitivity("mass.x", name), exact, rtol=0.0, atol=1e-10 * np.abs(exact).max()
        )


def recursion(member, steps, stiffness, damping, speed):
    """Return the positions of generalized-alpha for the oscillator, in plain Python numbers."""
    x, v, mass = 0.0, speed, MASS
    ddx = a = -(stiffness * x + damping * v) / mass
    positions = [x]
    m, f, gamma, beta = member.alpha_m, member.alpha_f, member.gamma, member.beta
    last = steps[0]
    for step in steps:
        a, last = ddx + step / last * (a - ddx), step
        # a' = known + factor ddx', x' = x_0 + c a', v' = v_0 + d a'
        factor, known = (1 - f) / (1 - m), (f * ddx - m * a) / (1 - m)
        x_0, c = x + step * v + step**2 * (0.5 - beta) * a, step**2 * beta
        v_0, d = v + step * (1 - gamma) * a, step * gamma
        force = stiffness * (x_0 + c * known) + damping * (v_0 + d * known)
        ddx = -force / (mass + factor * (stiffness * c + damping * d))
        a = known + factor * ddx
        x, v = x_0 + c * a, v_0 + d * a
        positions.append(x)
    return np.array(positions)


@pytest.mark.parametrize("damping", [0.8, 0.0])
@pytest.mark.parametrize(
    ("family", "rho_inf"), [("generalized-alpha", 0.8), ("hht", 0.6), ("newmark", 0.9)]
)
def test_derivative_of_discrete_solution_is_exact(family, rho_inf, damping):
    # A coarse step, with which the discrete and the exact solution differ by per cents. Negative
    # damping is rejected, so that differences of the model at damping = 0 are one-sided.
    method = bd.GeneralizedAlpha(step=0.05, rho_inf=rho_inf, family=family, start="plain")
    assert_discrete_derivatives(method, damping, 1e-11)


@pytest.mark.slow(reason="half a second")
def test_derivative_of_adaptive_steps_is_exact():
    # The Newton errors of the run are larger with tens of steps near the tolerance.
    method = bd.GeneralizedAlpha(step=0.05, rtol=1e-3, start="plain", newton_tolerance=1e-12)
    assert_discrete_derivatives(method, 0.8, 1e-10)


def assert_discrete_derivatives(method, damping, tolerance):
    values = {"stiffness": 40.0, "damping": damping, "speed": SPEED}
    result = bd.sensitivities(oscillator, list(values), method, parameters=values)
    (interval,) = result.solution.trajectory.intervals
    for name in values:
        expected = complex_step(partial(recursion, method, np.diff(interval.t)), values, name)
        actual = result.trajectories[name].intervals[0].rows.q[:, 0]
        # Rounding errors of the run and of the differences of the model.
        size = np.abs(expected).max()
        np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-9 * size)


def run_differences(model, name, values, method, t_end, relative):
    """Return fourth-order differences of runs: q and lam at the steps."""
    value = values.get(name, model.parameters[name])
    delta = relative * value
    derivative = {"q": 0.0, "lam": 0.0}
    for step, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
        run = bd.simulate(model(**{**values, name: value + step * delta}), method, t_end)
        for key in derivative:
            derivative[key] = derivative[key] + weight / delta * at_steps(run.trajectory, key)
    return derivative


def at_steps(trajectory, key):
    return np.concatenate([getattr(x.state, key) for x in trajectory.intervals])


def assert_agree_with_runs(model, names, t_end, values=None, relative=1e-3, step=1e-3, lam=1e-5):
    """Compare with differences of runs, whose Newton errors limit the accuracy of the comparison.

    `lam` is the tolerance of multipliers. The tolerance of positions is 1e-6; differences with
    other steps show that errors above 1e-9 are those of the differences.
    """
    values, method = values or {}, bd.GeneralizedAlpha(step=step, newton_tolerance=1e-12)
    result = bd.sensitivities(model, names, method, t_end, parameters=values, estimate_error=False)
    for name in names:
        expected = run_differences(model, name, values, method, t_end, relative)
        for key, tolerance in (("q", 1e-6), ("lam", lam)):
            actual, size = at_steps(result.trajectories[name], key), np.abs(expected[key]).max()
            assert np.abs(actual - expected[key]).max() <= tolerance * size, (name, key)


@pytest.mark.slow(reason="ten runs of a mechanism with contacts")
def test_contact_and_friction():
    # The contacts close and slip within this time.
    assert_agree_with_runs(governor, ["torque", "coefficient"], 0.1, relative=3e-5)


@pytest.mark.slow(reason="a quarter of a second")
def test_breakpoints_that_do_not_move():
    assert_agree_with_runs(swing, ["torque", "width"], 0.6, step=2e-3, lam=1e-6)


@pytest.mark.slow(reason="five runs of half a second")
def test_pivot_that_vanishes_at_the_last_step():
    # The crank has turned by 90 degrees then, and stands along an axis.
    assert_agree_with_runs(MODELS["four_bar"], ["speed"], 0.5)


@pytest.mark.slow(reason="half a second and more")
def test_driver_that_moves_at_the_start():
    assert_agree_with_runs(turning, ["speed"], 0.05)


@bd.model(t_end=0.05)
def towed(speed=30.0, mass=0.5):
    """Crank that turns at a given speed and moves a flexible rod and a ram."""
    return crank_and_ram(rectangle(0.01, damping=1e-3), 1, mass, angular_velocity=speed)[0]


@pytest.mark.slow(reason="half a second and more")
def test_bodies_that_follow_a_given_velocity():
    assert_agree_with_runs(towed, ["speed", "mass"], 0.05)
    method = bd.GeneralizedAlpha(step=1e-3)
    forward = bd.sensitivities(towed, ["speed", "mass"], method, estimate_error=False)
    table = forward.table()
    gradient = bd.gradient(
        towed, quantities.EndValue("ram.x"), ["speed", "mass"], method, estimate_error=False
    )
    for name in ("speed", "mass"):
        (column,) = [x for x in table.columns if x.startswith(f"d(ram.x)/d({name})")]
        assert gradient.derivatives[name] == pytest.approx(table[column].iloc[-1], rel=1e-9)


@pytest.mark.slow(reason="a fifth of a second")
def test_nonholonomic_constraint():
    assert_agree_with_runs(skater, ["offset", "push"], 0.1)


@pytest.mark.slow(reason="kernels of beams with and without damping")
def test_forces_that_vanish_at_the_value_of_a_parameter():
    # At damping = 0, the kernels of the beam lack the damping forces.
    method = bd.GeneralizedAlpha(step=2e-3)
    at_zero, near_zero = (
        bd.sensitivities(hub_beam, "damping", method, 0.1, parameters={"damping": x, "elements": 2})
        for x in (0.0, 1e-9)
    )
    expected = at_steps(near_zero.trajectories["damping"], "q")
    actual = at_steps(at_zero.trajectories["damping"], "q")
    # The second derivative times 1e-9 s is near 1e-5 of the derivative.
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())
    # Section forces contain the damping forces.
    for column in ("root force.N", "root force.M"):
        expected, actual = (x.sensitivity(column, "damping") for x in (near_zero, at_zero))
        np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.slow(reason="kernels of beams with drag")
@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(step=2e-3), bd.Radau()])
def test_parameters_together_and_alone(method):
    # Without drag, the equations lack its forces; they have other numbers p then.
    names, settings = ["tip_mass", "air_drag", "damping"], {"parameters": {"elements": 2}}
    together = bd.sensitivities(pendulum, names, method, 0.02, estimate_error=False, **settings)
    for name in names:
        alone = bd.sensitivities(pendulum, name, method, 0.02, estimate_error=False, **settings)
        for key in ("q", "lam"):
            expected, actual = (at_steps(x.trajectories[name], key) for x in (alone, together))
            scale = np.abs(expected).max()
            np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-10 * scale)


MODELS = {
    model.name: model
    for model in (
        four_bar,
        governor,
        hub_beam,
        leaf_spring_vehicle,
        pendulum,
        quick_return,
        ring_mount,
        shallow_arch,
        slider_crank,
        sliding_mass,
        spin_up,
    )
}
CASES = [
    (name, formulation)
    for name, model in MODELS.items()
    for formulation in (("floating frame", "exact") if "formulation" in model.parameters else ("",))
]
# Newton errors of runs, relative to the positions and multipliers.
NOISE = {"q": 1e-13, "lam": 1e-7}


@pytest.mark.slow(reason="twenty steps of five runs per parameter")
@pytest.mark.parametrize(("name", "formulation"), CASES)
def test_all_parameters_of_all_models(name, formulation):
    model, step = MODELS[name], 1e-4 if name == "ring_mount" else 5e-4
    values = {"formulation": formulation} if formulation else {}
    if isinstance(model.parameters.get("elements"), int):
        values["elements"] = 2
    names = [x for x, value in model.parameters.items() if isinstance(value, float) and value]
    method = bd.GeneralizedAlpha(step=step, newton_tolerance=1e-12)
    # Shorter differences increase the Newton errors of small multipliers; the shape of the shallow
    # arch is sensitive to its span.
    width = 1e-3 if name == "shallow_arch" else 4e-3
    result = bd.sensitivities(
        model, names, method, 20 * step, parameters=values, estimate_error=False
    )
    for parameter in names:
        expected = run_differences(model, parameter, values, method, 20 * step, width)
        delta = width * model.parameters[parameter]
        for key, tolerance in (("q", 1e-6), ("lam", 1e-3)):
            run = np.abs(at_steps(result.solution.trajectory, key)).max(initial=0.0)
            size = np.abs(expected[key]).max(initial=0.0)
            error = np.abs(at_steps(result.trajectories[parameter], key) - expected[key])
            limit = tolerance * size + NOISE[key] * run / delta
            assert error.max(initial=0.0) <= limit, (parameter, key, error.max() / limit)


# Parameters whose default is zero, the step [s], the range of values of the differences, and their
# errors, the tolerances of positions and multipliers. Runs are smooth functions of a retardation
# time only up to the order of the step; for smaller values, rounding and Newton errors dominate.
ZERO_DEFAULTS = [
    (hub_beam, "damping", 5e-3, 5e-4, 1e-6, 1e-5),
    (pendulum, "mass_damping", 5e-4, 3.0, 1e-6, 1e-4),
    (pendulum, "stiffness_damping", 5e-4, 1e-4, 1e-6, 1e-4),
    (pendulum, "air_drag", 5e-4, 3.0, 1e-6, 1e-4),
    (slider_crank, "damping", 5e-3, 5e-4, 5e-4, 1e-3),
    (spin_up, "damping", 5e-3, 5e-4, 5e-4, 2e-2),
]


@pytest.mark.slow(reason="twenty steps of ten runs")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize(("model", "name", "step", "width", "q", "lam"), ZERO_DEFAULTS)
def test_parameters_with_default_zero(model, name, step, width, q, lam, formulation):
    # Derivative of the polynomial of degree 8 through Chebyshev points of [0, width].
    points = 0.5 - 0.5 * np.cos(np.pi * np.arange(9) / 8)
    weights = np.linalg.inv(np.vander(points, increasing=True))[1] / width
    values = {"formulation": formulation, "elements": 2}
    method = bd.GeneralizedAlpha(step=step, newton_tolerance=1e-12)
    result = bd.sensitivities(
        model, name, method, 20 * step, parameters=values, estimate_error=False
    )
    runs = [
        bd.simulate(model(**values, **{name: float(x)}), method, 20 * step).trajectory
        for x in width * points
    ]
    for key, tolerance in (("q", q), ("lam", lam)):
        first, *others = (at_steps(run, key) for run in runs)
        expected = sum(w * (x - first) for w, x in zip(weights[1:], others, strict=True))
        error = np.abs(at_steps(result.trajectories[name], key) - expected).max()
        assert error <= tolerance * np.abs(expected).max(), key


@bd.model(t_end=0.02)
def added_stiffness(extra=0.0, base=1e9):
    return oscillator(stiffness=base + extra)


@bd.model(t_end=0.02)
def eccentric(eccentricity=0.0, gap=1e-5):
    """Stiffness that changes by its own size within a gap of a bearing."""
    return oscillator(stiffness=40.0 * (1.0 + math.sin(eccentricity / gap)))


@bd.model(t_end=0.02)
def phased(phase=1000.0):
    return oscillator(stiffness=40.0 * (1.5 + math.sin(phase)))


SCALES = [
    (added_stiffness, {"base": 1e9}, 1e9, 1.0),
    (added_stiffness, {"base": 2e11}, 2e11, 1.0),
    (added_stiffness, {"base": 1e11, "extra": 1.0}, 1e11, 1.0),
    (added_stiffness, {"base": 40.0, "extra": 1e-11}, 40.0, 1.0),
    (eccentric, {"gap": 1e-8}, 40.0, 4e9),
    (eccentric, {"gap": 1e-5}, 40.0, 4e6),
    (eccentric, {"gap": 1e6}, 40.0, 4e-5),
    (phased, {}, 40.0 * (1.5 + math.sin(1000.0)), 40.0 * math.cos(1000.0)),
]


@pytest.mark.parametrize("model", [added_stiffness, eccentric, phased])
@pytest.mark.slow(reason="half a second and more")
def test_parameters_of_any_scale(model):
    # Differences with the first step have relative errors of 1e-4 to 1, or are refused.
    method, (name, *_) = bd.GeneralizedAlpha(step=1e-3), model.parameters
    for values, stiffness, rate in (case[1:] for case in SCALES if case[0] is model):
        actual = bd.sensitivities(model, name, method, output_step=2e-3, parameters=values)
        expected = bd.sensitivities(
            oscillator, "stiffness", method, 0.02, 2e-3, parameters={"stiffness": stiffness}
        ).sensitivity("mass.x", "stiffness")
        size = abs(rate) * np.abs(expected).max()
        np.testing.assert_allclose(
            actual.sensitivity("mass.x", name), rate * expected, rtol=0.0, atol=1e-7 * size
        )
        gradient = bd.gradient(
            model, quantities.EndValue("mass.x"), name, integrator=method, parameters=values
        )
        assert gradient.derivatives[name] == pytest.approx(rate * expected.iloc[-1], rel=1e-7)


@bd.model(t_end=0.1)
def seesaw(offset=1e-8):
    """Body whose center is slightly beside 1 m, on a pin at 1 m."""
    mech = bd.Mechanism(gravity=EARTH)
    body = mech.add(bd.RigidBody("body", 2.0, 0.3, (1.0 + offset, offset)))
    mech.add(bd.Revolute("pin", mech.ground.at(1.0, 0.0), body.at(1.0, 0.0)))
    return mech


def test_small_offset_of_coordinates():
    # 1e-11 m, a thousandth of the offset, would be lost in rounding errors of 1 m.
    result = bd.sensitivities(seesaw, "offset", bd.GeneralizedAlpha(step=1e-3), 0.01)
    assert at_steps(result.trajectories["offset"], "q")[0, :2] == pytest.approx(1.0, abs=1e-7)


@bd.model(t_end=0.01)
def kinked_slope(x=0.0):
    """x |x| has a derivative at zero, but its differences do not converge to it quickly."""
    return oscillator(stiffness=40.0 + x * abs(x))


def test_differences_that_depend_on_their_step_are_reported():
    with pytest.warns(bd.BeamdaeWarning, match="depend on their step at x = 0"):
        bd.sensitivities(kinked_slope, "x", bd.GeneralizedAlpha(step=1e-3))


@pytest.mark.slow(reason="two seconds of motion")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_spin_up(formulation):
    assert_agree_with_runs(spin_up, ["speed"], 4.0, {"formulation": formulation}, step=0.02)


@bd.model(t_end=0.1)
def geared(load=3.0):
    """Rod whose motion is prescribed; the load changes only the torque of the driver."""
    mech = bd.Mechanism(gravity=EARTH)
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.3, 0.0), mass=1.0))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    sides = (mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0))
    driver = mech.add(bd.Driver("driver", *sides, lambda t: 5.0 * t**2))
    mech.add(bd.Moment("load", on=rod.at(0.0, 0.0), law=load))
    mech.observe("driver", driver.reaction)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_parameter_that_changes_only_reactions():
    # The derivatives of the positions are rounding errors, which do not converge.
    result = bd.sensitivities(geared, "load")
    np.testing.assert_allclose(np.abs(result.sensitivity("driver.M", "load")), 1.0, rtol=1e-9)
    assert np.abs(result.sensitivity("rod.angle", "load")).max() < 1e-12


@bd.model(t_end=0.1)
def welded(mass=2.0, gravity=9.81):
    """Bar that is welded at both ends, which share its weight."""
    mech = bd.Mechanism(gravity=(0.0, -gravity), redundant="minimum norm")
    bar = mech.add(bd.RigidBody.rod("bar", (-1.0, 0.0), (1.0, 0.0), mass=mass))
    for name, x in (("left", -1.0), ("right", 1.0)):
        weld = mech.add(bd.Weld(name, mech.ground.at(x, 0.0), bar.at(x, 0.0)))
        mech.observe(name, weld.reaction)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_reactions_of_minimum_norm():
    result = bd.sensitivities(welded, ["mass", "gravity"])
    for name, rate in (("mass", 9.81), ("gravity", 2.0)):
        sign = np.sign(result.solution.columns["left.Fy [N]"][-1])
        for side in ("left", "right"):
            actual = result.sensitivity(f"{side}.Fy", name)
            np.testing.assert_allclose(actual, 0.5 * sign * rate, rtol=1e-9)


@bd.model(t_end=0.2)
def parallel(length=0.5, height=0.3):
    """Coupler on three parallel cranks, one of which is redundant."""
    mech = bd.Mechanism(gravity=EARTH, redundant="minimum norm")
    ends = (0.0, height), (length, height)
    coupler = mech.add(bd.RigidBody.rod("coupler", *ends, mass=2.0))
    for k, x in enumerate((0.0, 0.4 * length, length)):
        crank = mech.add(bd.RigidBody.rod(f"crank {k}", (x, 0.0), (x, height), mass=0.5 + 0.1 * k))
        mech.add(bd.Revolute(f"pivot {k}", mech.ground.at(x, 0.0), crank.at(x, 0.0)))
        pin = bd.Revolute(f"pin {k}", crank.at(x, height), coupler.at(x, height))
        mech.observe(f"pin {k}", mech.add(pin).reaction)
    mech.add(bd.Force("push", coupler.at(0.0, height), (3.0, 0.0)))
    return mech


@pytest.mark.slow(reason="eleven runs")
@pytest.mark.parametrize("name", ["length", "height"])
def test_redundant_joints(name):
    # The norm of the reactions depends on the dimensions, too.
    result = bd.sensitivities(parallel, name, bd.Radau(rtol=1e-6))
    for column, expected in differences_of_runs(parallel, name, 1e-9).items():
        # Reactions of order 3 at this rtol.
        size = max(abs(expected), np.abs(result.solution.columns[column]).max())
        actual = result.sensitivity(column, name).iloc[-1]
        assert actual == pytest.approx(expected, abs=1e-4 * size), column


@bd.model(t_end=0.5)
def formula(stiffness=10.0):
    """Mass on a spring whose law is a local function."""
    mech, mass = free_ball((1.0, 0.0), velocity=(SPEED, 0.0), mass=MASS, name="mass")

    def law(elongation, rate):
        return stiffness * elongation

    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, law=law))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_parameter_in_a_user_formula():
    method = bd.GeneralizedAlpha(step=0.01)
    result = bd.sensitivities(formula, "stiffness", method)
    values = {"stiffness": 10.0, "damping": 0.0}
    expected = bd.sensitivities(oscillator, "stiffness", method, t_end=0.5, parameters=values)
    np.testing.assert_allclose(
        result.sensitivity("mass.x", "stiffness"),
        expected.sensitivity("mass.x", "stiffness"),
        rtol=0.0,
        atol=1e-12,
    )


@bd.model(t_end=0.2)
def wheel_on_table(factor=1.0):
    """Wheel with a moment of `factor` times a table of two arguments, the angle and its rate."""
    angles, rates = (-0.3, -0.1, 0.0, 0.2, 0.3), (-1.0, 0.0, 1.0)
    moments = [[-3.0 * angle - 0.5 * rate for rate in rates] for angle in angles]
    mech, wheel = hinged_body(1.0, 0.5, name="wheel", angular_velocity=0.3)
    center = wheel.at(0.0, 0.0)
    state = [mech.sensor(name, center, name) for name in ("angle", "angle_dot")]
    mech.add(bd.Moment("motor", center, factor * bd.table((angles, rates), moments)(*state)))
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_regression_factors_of_one_keep_the_rows_of_tables():
    """The derivative was 3.5 times too large: integers of the table had rounding errors."""
    method = bd.GeneralizedAlpha(step=0.01)
    result = bd.sensitivities(wheel_on_table, "factor", method, estimate_error=False)
    last, first = (bd.simulate(wheel_on_table(factor=x), method, t_end=0.2) for x in (1.001, 0.999))
    expected = (last["angle"] - first["angle"]) / 0.002
    np.testing.assert_allclose(result.sensitivity("angle", "factor"), expected, atol=1e-8)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("step", [0.05, 0.01])
def test_regression_errors_of_fixed_steps_are_reported(step):
    """The period is 1.4 s; with 28 steps per period, the derivative is wrong by 11 % at 4 s."""
    method, t_end = bd.GeneralizedAlpha(step=step), 4.0
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        result = bd.sensitivities(oscillator, "stiffness", method, t_end)
        bd.simulate(oscillator, method, t_end, sensitivities="stiffness")
    values = {"stiffness": 40.0, "damping": 0.8, "speed": SPEED}
    exact = complex_step(partial(exact_position, t=result.t), values, "stiffness")
    error = relative_error(result.sensitivity("mass.x", "stiffness"), exact)
    assert measured_error(result, "mass.x") == pytest.approx(error, rel=0.4)
    sentences = [str(x.message) for x in messages if ": d(mass.x" in str(x.message)]
    callers = ["sensitivities", "simulate"] if error > 0.05 else []
    assert [x.partition(":")[0] for x in sentences] == callers


def relative_error(derivative, exact):
    return np.linalg.norm(derivative - exact) / np.linalg.norm(exact)


def measured_error(result, column):
    """Return the error of a derivative that the result states."""
    totals = result.errors.table()["total"]
    return totals[next(x for x in totals.index if x.startswith(f"d({column})"))]


@bd.model(t_end=1.0)
def ripple(stiffness=1e4, speed=0.02):
    """Two masses that oscillate slowly, and vibrate against each other by 0.1 % of this motion."""
    mech, first = free_ball((1.0, 0.0), name="first", velocity=(1.0, 0.0))
    second = mech.add(bd.PointMass("second", 1.0, at=(2.0, 0.0), velocity=(1.0 + speed, 0.0)))
    mech.add(bd.Spring("soft", mech.ground.at(0.0, 0.0), first.point, 40.0))
    mech.add(bd.Spring("hard", first.point, second.point, stiffness))
    mech.observe("second", second.point)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("rtol", [2e-4, 2e-5])
def test_regression_errors_of_adaptive_steps_are_reported(rtol, recwarn):
    """Velocities and their derivatives; rtol=2e-4 damps the vibration, by 13 % in derivatives."""
    result = bd.sensitivities(ripple, "stiffness", bd.Radau(rtol), output_step=0.01)
    stiffness = 1e4 + 1e-25j
    matrix = np.array([[40.0 + stiffness, -stiffness], [-stiffness, stiffness]])
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-matrix, np.zeros((2, 2))]])
    states = [scipy.linalg.expm(system * t) @ [0.0, 0.0, 1.0, 1.02] for t in result.t]
    exact = np.imag(states)[:, 1] / 1e-25
    error = relative_error(result.sensitivity("second.x", "stiffness"), exact)
    assert measured_error(result, "second.x") == pytest.approx(error, rel=0.4)
    assert (error > 0.05) == (rtol == 2e-4)
    start = "sensitivities: d(second.x"
    assert any(str(x.message).startswith(start) for x in recwarn) == (error > 0.05)


def test_errors_of_steps_are_not_estimated_on_request(recwarn):
    bd.sensitivities(ripple, "stiffness", bd.Radau(1e-3), estimate_error=False)
    assert not [x for x in recwarn if "d(" in str(x.message)]


@bd.model(t_end=0.02)
def pinned(position=0.13):
    """Curved beam in a floating frame that is pinned between its nodes, at rest."""
    mech = bd.Mechanism()
    steel = rectangle(0.01)
    beam = mech.add(bd.Beam("beam", bd.Arc(0.5, 0.4), steel, elements=2))
    pin = beam.at(position)
    mech.add(bd.Revolute("pin", mech.ground.at(*pin.point), pin))
    return mech


@pytest.mark.slow(reason="kernels of a beam")
def test_parameter_without_effect():
    # The derivatives are rounding errors, which do not converge.
    result = bd.sensitivities(pinned, "position")
    assert np.abs(at_steps(result.trajectories["position"], "q")).max() < 1e-12


@bd.model(t_end=0.1)
def mounted(inclination=0.4, sliding=0.13):
    """Curved beam in a floating frame, whose joints depend on the directions of the beam there."""
    mech = bd.Mechanism(gravity=EARTH)
    steel = rectangle(0.01, damping=1e-4)
    beam = mech.add(bd.Beam("beam", bd.Arc(inclination, 0.4), steel, elements=2))
    mech.add(bd.Revolute("pin", mech.ground.at(*beam.at(sliding).point), beam.at(sliding)))
    mass = mech.add(bd.PointMass("mass", 2.0, at=beam.end.point))
    mech.add(bd.Revolute("tip", beam.end, mass.point))
    return mech


@pytest.mark.slow(reason="ten runs of a beam")
def test_operators_of_joints_that_depend_on_a_parameter():
    assert_agree_with_runs(mounted, ["inclination", "sliding"], 0.05, lam=1e-4)


@bd.model(t_end=0.1)
def resized(length=0.3):
    """Beam whose number of elements changes with its length."""
    steel = rectangle(0.01)
    line, count = bd.Line((0.0, 0.0), (length, 0.0)), math.ceil(10.0 * length - 1e-9)
    mech, _ = clamped_beam(steel, count, line)
    return mech


@bd.model(t_end=0.2)
def cocked(cosine=1.0):
    """acos^2 = 2 (1 - c) + ... is smooth at c = 1, but not defined beyond."""
    return oscillator(stiffness=10.0 + math.acos(cosine) ** 2)


@pytest.mark.slow(reason="a fifth of a second")
def test_formulas_that_fail_on_one_side_lead_to_one_sided_differences():
    method = bd.GeneralizedAlpha(step=2e-3)
    by_cosine = bd.sensitivities(cocked, "cosine", method).sensitivity("mass.x", "cosine")
    by_stiffness = bd.sensitivities(
        oscillator, "stiffness", method, 0.2, parameters={"stiffness": 10.0}
    ).sensitivity("mass.x", "stiffness")
    np.testing.assert_allclose(by_cosine, -2.0 * by_stiffness, rtol=1e-6, atol=1e-12)


@bd.model(t_end=1.0)
def dropped(speed=1.0, rate=2.0):
    """Body and particle under a gravity that grows with time."""
    mech = bd.Mechanism(gravity=(0.0, lambda t: -1.0 - rate * t))
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, velocity=(0.0, speed)))
    particle = mech.add(bd.PointMass("particle", 1.0, at=(1.0, 0.0), velocity=(0.0, speed)))
    mech.observe("body", body.at(0.0, 0.0))
    mech.observe("particle", particle.point)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_regression_time_dependent_gravity():
    """Every parameter was said to change the structure of the equations."""
    result = bd.sensitivities(dropped, ["speed", "rate"])
    for name in ("body", "particle"):
        for parameter, exact in (("speed", result.t), ("rate", -(result.t**3) / 6.0)):
            actual = result.sensitivity(f"{name}.y", parameter)
            np.testing.assert_allclose(actual, exact, rtol=0.0, atol=1e-9)


@bd.model(t_end=0.1)
def amplified(gain=2.0):
    """CasADi stores 2 q as q + q, without a number."""
    t, q, v = symbols()
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0], force=-q, q0=[1.0], v0=[0.0], observe={"y [m]": gain * q}
    )


@bd.model(t_end=0.1)
def branched(gain=2.0):
    """Another formula is observed for smaller gains."""
    return amplified(gain=gain if gain > 1.9985 else 1.0)


@bd.model(t_end=0.4)
def driven(gain=1.0):
    """Mass driven by an observed input."""
    mech, mass = free_ball(
        (1.0, 0.0), velocity=(0.5, 0.0), mass=2.0, name="mass", spring=(40.0, 0.8)
    )
    drive = mech.input("drive", lambda t: gain * ca.sin(5.0 * t), unit="N")
    mech.add(bd.Force("push", mass.point, (drive, 0.0)))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("gain", [1.0, 2.0, -1.0, 0.0])
def test_regression_values_that_change_the_form_of_observed_columns(gain):
    """They were rejected; CasADi stores 1 q, 2 q and 0 q without a number."""
    method, step = bd.GeneralizedAlpha(step=5e-3), 1e-3
    ahead, behind = (bd.simulate(driven(gain=gain + x), method, 0.4) for x in (step, -step))
    options = {"parameters": {"gain": gain}, "estimate_error": False}
    result = bd.sensitivities(driven, "gain", method, **options)
    for column in ("mass.x", "drive"):
        expected = (ahead[column].iloc[-1] - behind[column].iloc[-1]) / (2.0 * step)
        forward = result.sensitivity(column, "gain").iloc[-1]
        adjoint = bd.gradient(driven, quantities.EndValue(column), "gain", method, **options)
        assert forward == pytest.approx(expected, rel=1e-6)
        assert adjoint.derivatives["gain"] == pytest.approx(forward, rel=1e-11)


@pytest.mark.parametrize(
    ("model", "by", "integrator", "message"),
    [
        (oscillator, "stiffnes", None, "no parameter 'stiffnes' .did you mean 'stiffness'"),
        (oscillator, "elements", None, "elements of oscillator is not a float"),
        (oscillator, [["speed"]], None, "by must be a list of names of parameters"),
        (oscillator, [], None, "by must contain each parameter once"),
        (oscillator, ["speed", "speed"], None, "by must contain each parameter once"),
        (oscillator, "scale", None, "have a kink at scale = 0"),
        (oscillator, "speed", bd.Ida(), "runs of Ida cannot .* use Radau or GeneralizedAlpha"),
        (oscillator, "speed", bd.GeneralizedAlpha(formulation="stabilized-index2"), "index3"),
        (branched, "gain", None, "changes the form of an observed column from one value next to"),
        (resized, "length", None, "length of resized changes the coordinates or constraints"),
    ],
)
def test_refusals(model, by, integrator, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.sensitivities(model, by, integrator)


def test_unknown_columns_and_parameters_are_named():
    result = bd.sensitivities(oscillator, "speed", bd.GeneralizedAlpha(step=0.1))
    with pytest.raises(bd.BeamdaeError, match=r"must be one of 'speed', got 'damping'"):
        result.sensitivity("mass.x", "damping")
    with pytest.raises(bd.BeamdaeError, match="several columns"):
        result.sensitivity("mass", "speed")
    with pytest.raises(bd.BeamdaeError, match=r"no column 'mass\.z'"):
        result.sensitivity("mass.z", "speed")


def test_table_is_written_as_csv(tmp_path):
    result = bd.sensitivities(oscillator, "speed", bd.GeneralizedAlpha(step=0.1))
    lines = result.to_csv(tmp_path / "sensitivities.csv").read_text().splitlines()
    assert lines[0].startswith("t [s],d(mass.x)/d(speed) [m per unit of speed]")
    assert len(lines) == 1 + len(result.t)


@bd.model(t_end=0.01)
def stepped_strip(step=0.11, height=3e-3, unused=1.0):
    """Clamped strip whose height changes at an arc length."""
    material = bd.Material(E=2e9, nu=0.4, rho=1200.0)

    def section(s):
        return rectangle(height if s < step else 2e-3, material=material)

    mech, beam = clamped_beam(section, 2, 0.4, name="strip", gravity=9.81)
    mech.observe("tip", beam.end)
    return mech


def test_an_unused_parameter_has_a_warning():
    with pytest.warns(bd.BeamdaeWarning, match="small changes of unused change no number"):
        bd.equilibrium_sensitivities(stepped_strip, "unused")


@pytest.mark.parametrize(
    ("call", "differentiate"),
    [
        (
            "sensitivities",
            lambda by: bd.sensitivities(stepped_strip, by, bd.GeneralizedAlpha(step=1e-3)),
        ),
        ("equilibrium_sensitivities", lambda by: bd.equilibrium_sensitivities(stepped_strip, by)),
        (
            "mode_sensitivities",
            lambda by: bd.mode_sensitivities(stepped_strip, by, about="equilibrium", n=2),
        ),
        (
            "gradient",
            lambda by: bd.gradient(
                stepped_strip, quantities.EndValue("tip.y"), by, bd.GeneralizedAlpha(step=1e-3)
            ),
        ),
    ],
    ids=["run", "equilibrium", "modes", "gradient"],
)
def test_regression_parameters_without_effect_are_named(call, differentiate):
    with pytest.warns(bd.BeamdaeWarning) as records:
        differentiate(["step", "height", "unused"])
    records = [x for x in records if "change no number" in str(x.message)]
    for record, name in zip(records, ("step", "unused"), strict=True):
        assert str(record.message).startswith(f"{call}: small changes of {name} change no")
        assert "does not use" in str(record.message)
        assert "only moves a jump" in str(record.message)
        # The warning cites this file, not the package.
        assert record.filename == __file__


@bd.model(t_end=0.2)
def kinked_oscillator(stiffness=40.0):
    mech, mass = mass_on_rail(x=1.0)
    spring = 40.0 + abs(stiffness - 40.0)
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, spring, 1.0))
    mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=1.0), 0.0)))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("sensitivities", lambda f, *x: f(*x)),
        ("mode_sensitivities", lambda f, *x: f(*x)),
        ("equilibrium_sensitivities", lambda f, *x: f(*x)),
        ("periodic_sensitivities", lambda f, *x: f(*x, period=1.0)),
        ("gradient", lambda f, model, by: f(model, quantities.EndValue("mass.x"), by)),
        ("optimize", lambda f, model, by: f(model, quantities.EndValue("mass.x"), by)),
        ("optimize", lambda f, model, by: f(model, quantities.Frequency(1), by)),
        ("fit", lambda f, model, by: f(model, {"t [s]": [0.1], "mass.x": [1.0]}, by)),
    ],
)
@pytest.mark.slow(reason="half a second each")
def test_regression_messages_name_the_function_that_was_called(name, call):
    """All messages named `sensitivities`, and gradients at this kink were zero."""
    with pytest.raises(bd.BeamdaeError, match=rf"^{name}: the numbers of kinked_oscillator have"):
        call(getattr(bd, name), kinked_oscillator, "stiffness")


@bd.model(t_end=0.2)
def jumping_oscillator(stiffness=40.0):
    """Oscillator whose mass jumps next to the default stiffness, as tables of curves can."""
    at, speed = (1.0, 0.0), (0.2, 0.0)
    mass = 1.0 + 1e-5 * (stiffness > 40.06)
    mech, _body = free_ball(at, velocity=speed, mass=mass, name="mass", spring=(stiffness, 0.1))
    return mech


@pytest.mark.slow(reason="half a second")
def test_regression_jumps_next_to_a_value_are_no_kinks():
    method = bd.GeneralizedAlpha(step=0.01)
    result = bd.sensitivities(jumping_oscillator, "stiffness", method)
    runs = [
        bd.simulate(jumping_oscillator(stiffness=40.0 + x), method).columns["mass.x [m]"][-1]
        for x in (1e-3, -1e-3)
    ]
    expected = (runs[0] - runs[1]) / 2e-3
    actual = result.sensitivity("mass.x", "stiffness").iloc[-1]
    assert actual == pytest.approx(expected, rel=1e-6)
