"""Gradients by the adjoint: against forward derivatives, closed forms and single differences."""

from dataclasses import replace

import numpy as np
import pytest
from differentiable_models import skater, swing, turning
from mechanisms import EARTH, clamped_beam, free_ball, hinged_body
from quick_return import quick_return
from slider_crank import slider_crank

import beamdae as bd
from beamdae import quantities
from beamdae.analysis.gradients.flat_model import FlatModel
from beamdae.analysis.gradients.objectives import SampleGrid
from beamdae.analysis.sensitivities.neighbors import difference_models
from beamdae.analysis.sensitivities.observable_derivatives import read_column
from beamdae.native.object_code import is_native_enabled

MASS, SPEED = 2.0, 0.3
# Derivatives of positions along both paths differ by rounding errors. In derivatives of multipliers
# these are larger by 1 / step^2.
POSITIONS, MULTIPLIERS = 1e-11, 1e-8
NEGLIGIBLE = 1e-3


@bd.model(t_end=1.0)
def oscillator(stiffness=40.0, damping=0.8, speed=SPEED, elements=1):
    """Mass on a spring and a damper, moving along the line of the spring."""
    mech, _mass = free_ball(
        (1.0, 0.0), velocity=(speed, 0.0), mass=MASS, name="mass", spring=(stiffness, damping)
    )
    return mech


@bd.model(t_end=0.2)
def hanging(stiffness=300.0, length=0.5, load=2.0, mass=1.0):
    """Rod on a pin and a spring, released from equilibrium when its load begins to vary."""
    mech = bd.Mechanism(gravity=EARTH, start="equilibrium")
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (length, 0.0), mass=mass))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    tip = rod.at(length, 0.0)
    mech.add(bd.Spring("spring", mech.ground.at(length, 0.5), tip, stiffness, free_length=0.45))
    mech.add(bd.Force("load", tip, (0.0, lambda t: -load * (1.0 + t))))
    mech.observe("tip", tip)
    return mech


@bd.model(t_end=0.05)
def arm(thickness=(0.004,) * 12, torque=1.0, elements=4):
    """Arm whose thickness is piecewise linear along its length, on a turning hub."""
    alloy = bd.Material(E=69e9, nu=0.3, rho=2700.0)
    knots = np.linspace(0.0, 1.0, len(thickness))

    def section(s):
        height = float(np.interp(s, knots, thickness))
        return bd.Section.rectangle(alloy, width=0.02, height=height, damping=1e-3)

    mech, hub = hinged_body(mass=1.0, inertia=0.3, name="hub")
    mech.add(bd.Moment("torque", on=hub.at(0.0, 0.0), law=bd.sine(torque, 1.0)))
    axis = bd.Arc(radius=1.0, length=1.0, start=(0.05, 0.0))
    beam = mech.add(bd.Beam("beam", axis, section, elements=elements))
    mech.add(bd.Weld("root", hub.at(0.05, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


def position_objective(run):
    """Return a sum of all kinds of objectives of the first column of a run."""
    header = next(iter(run.columns), None) or list(run.coordinate_columns())[1]
    column, end = header.rpartition(" [")[0], run.trajectory.end
    times = np.linspace(0.0, 0.99 * end, 5)
    samples = quantities.SquaredErrors(column, times, 0.1 + times, 0.5)
    return (
        quantities.EndValue(column)
        + 0.3 * quantities.TimeIntegral(column, 2)
        + quantities.SmoothMaximum(column)
        + samples
    )


def multiplier_objective(run):
    """Return a sum of objectives of the first and the last multiplier."""
    headers = [x for x in run.coordinate_columns() if x.startswith("lam.")]
    return quantities.TimeIntegral(headers[0]) + 0.2 * quantities.EndValue(headers[-1])


def chain_rule(result, objective, parameter):
    """Return the derivative of an objective by forward derivatives, and the sum of magnitudes."""
    grid, parts = SampleGrid.of(result.solution.trajectory), []
    for factor, term in objective.terms:
        times = term.sample_times(grid)
        header, values = read_column(result.solution.at_times(times), term.column)
        _, derivative = term.evaluate(values, grid.weights)
        column = result.at_times(times).sensitivity(header, parameter).to_numpy()
        parts.append(factor * derivative * column)
    terms = np.concatenate(parts)
    return terms.sum(), np.abs(terms).sum()


def assert_agrees_with_forward(
    model, by, t_end, method=None, values=None, start=None, positions=POSITIONS
):
    method = method or bd.GeneralizedAlpha(step=1e-3)
    forward = bd.sensitivities(
        model, by, method, t_end, parameters=values, start=start, estimate_error=False
    )
    objectives = [(position_objective(forward.solution), positions)]
    if forward.solution.equations.m:
        objectives.append((multiplier_objective(forward.solution), MULTIPLIERS))
    for objective, tolerance in objectives:
        actual = bd.gradient(
            model,
            objective,
            by,
            method,
            t_end,
            parameters=values,
            start=start,
            estimate_error=False,
        )
        assert actual.value == pytest.approx(objective.value(forward.solution), rel=1e-12)
        for name in by:
            expected, size = chain_rule(forward, objective, name)
            value = forward.parameters[name]
            if value != 0.0:
                # Parameters that hardly affect the objective: rounding errors of its value.
                size = max(size, NEGLIGIBLE * abs(actual.value / value))
            assert abs(actual.derivatives[name] - expected) <= tolerance * size, (name, objective)


@bd.model(t_end=0.2)
def loaded(stiffness=40.0, load=0.0, speed=SPEED):
    """Oscillator with a force that is missing in the equations without load."""
    mech, mass = free_ball(
        (1.0, 0.0), velocity=(speed, 0.0), mass=MASS, name="mass", spring=(stiffness,)
    )
    if load:
        mech.add(bd.Force("load", mass.point, (load, 0.0)))
    return mech


TWO_MS, FIVE_MS = bd.GeneralizedAlpha(step=2e-3), bd.GeneralizedAlpha(step=5e-3)
PLAIN = bd.GeneralizedAlpha(step=5e-3, family="hht", rho_inf=0.6, start="plain")
LAW = {
    "oscillator": (oscillator, ["stiffness", "damping", "speed"], 0.2, {}),
    # Negative damping is rejected: differences of the model are one-sided.
    "one-sided": (oscillator, ["damping", "speed"], 0.1, {"values": {"damping": 0.0}}),
    "vanishing force": (loaded, ["stiffness", "load", "speed"], 0.2, {"method": TWO_MS}),
    "vanishing force, Radau": (loaded, ["stiffness", "load"], 0.2, {"method": bd.Radau()}),
    "fixed breakpoints": (swing, ["torque", "width", "mass"], 0.5, {"method": FIVE_MS}),
    "plain start": (swing, ["torque", "width"], 0.25, {"method": PLAIN}),
    "adaptive": (swing, ["torque", "width"], 0.3, {"method": bd.GeneralizedAlpha(rtol=1e-3)}),
    "moving driver": (turning, ["speed", "length"], 0.01, {}),
    "nonholonomic": (skater, ["offset", "push", "spin"], 0.02, {}),
    "equilibrium": (hanging, ["stiffness", "length", "load", "mass"], 0.05, {"method": FIVE_MS}),
    # The mechanism can turn freely about its pivot, so that the tangent stiffness is singular.
    "free equilibrium": (arm, ["torque"], 0.01, {"start": "equilibrium"}),
}


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("case", LAW)
def test_adjoint_agrees_with_forward_derivatives(case):
    model, by, t_end, options = LAW[case]
    assert_agrees_with_forward(model, by, t_end, **options)


@pytest.mark.slow(reason="runs at a small tolerance")
@pytest.mark.parametrize("t_end", [0.3894, 0.4917])
def test_regression_undamped_slider_crank_with_radau(t_end):
    """Factors that had not been tested were unsuitable, and the transposed equations diverged."""
    method, by = bd.Radau(1e-8), ["damping", "density"]
    values = {"formulation": "exact", "damping": 0.0}
    objective = quantities.EndValue("slider.x")
    forward = bd.sensitivities(
        slider_crank, by, method, t_end, parameters=values, estimate_error=False
    )
    actual = bd.gradient(
        slider_crank, objective, by, method, t_end, parameters=values, estimate_error=False
    )
    for name in by:
        expected, size = chain_rule(forward, objective, name)
        size = max(size, NEGLIGIBLE * abs(actual.value / (forward.parameters[name] or 1.0)))
        assert abs(actual.derivatives[name] - expected) <= 1e-7 * size


@bd.model(t_end=1.0)
def leaf(height=(0.005,) * 9):
    """Leaf spring under a force of 300 N, with a height that is linear between nine points."""
    section = bd.taper(bd.Section.rectangle, bd.Material.of("steel"), width=0.05, height=height)
    mech, beam = clamped_beam(section, 8, 0.4, name="leaf", formulation="exact")
    mech.add(bd.Force("load", beam.end, (0.0, -300.0)))
    mech.observe("stress", beam.largest_stress())
    return mech


@pytest.mark.slow(reason="half a second")
def test_regression_heights_are_changed_together_although_stiffnesses_keep_their_ratios():
    """Equal heights, changed by equal factors, hid the ratios of stiffnesses that they affect."""
    uneven = (0.005, 0.004, 0.006, 0.003, 0.005, 0.002, 0.003, 0.002, 0.003)
    for heights in ((0.005,) * 9, uneven):
        entries = {f"height[{k}]": ("height", k) for k in range(9)}
        model = FlatModel(replace(leaf, parameters={"height": heights}), entries)
        base = bd.equations_of_motion(model())
        builds = []

        def assemble(mechanism, builds=builds):
            builds.append(1)
            return bd.equations_of_motion(mechanism)

        result = difference_models(model, list(entries), base, assemble)
        assert all(x.is_regular for x in result.values())
        assert len(builds) <= 24
        step = 1e-6 * heights[3]
        ahead, behind = (
            bd.equations_of_motion(model(**{"height[3]": heights[3] + x})).p for x in (step, -step)
        )
        derivative = (ahead - behind) / (2.0 * step)
        actual = result["height[3]"].along(lambda e: e.p)
        assert np.all(np.abs(actual - derivative) <= 1e-7 * np.max(np.abs(derivative)))
        assert np.count_nonzero(actual) == np.count_nonzero(derivative)


@bd.model(t_end=0.1)
def coupled(gains=(0.0,) * 10):
    """Oscillator whose stiffness depends on gains only if an even and an odd one change."""
    mech, mass = free_ball((1.0, 0.0), velocity=(SPEED, 0.0), mass=MASS, name="mass")
    product = sum(gains[::2]) * (1.0 + sum(gains[1::2])) + sum(gains)
    stiffness = 40.0 + product
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, stiffness, 0.5))
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_parameters_that_affect_the_same_number_are_changed_one_by_one():
    result = bd.gradient(
        coupled, quantities.EndValue("mass.x"), "gains", bd.GeneralizedAlpha(step=1e-3)
    )
    by_stiffness = bd.gradient(
        oscillator,
        quantities.EndValue("mass.x"),
        "stiffness",
        bd.GeneralizedAlpha(step=1e-3),
        0.1,
        parameters={"damping": 0.5},
    ).derivatives["stiffness"]
    np.testing.assert_allclose(result.derivatives["gains"], by_stiffness * np.tile([2.0, 1.0], 5))


@pytest.mark.slow(reason="half a second and more")
def test_lists_of_floats_and_floats():
    objective, method = quantities.TimeIntegral("tip.y", 2), bd.GeneralizedAlpha(step=1e-3)
    result = bd.gradient(arm, objective, ["torque", "thickness"], method)
    assert isinstance(result.derivatives["torque"], float)
    assert result.derivatives["thickness"].shape == (12,)
    assert result.array.shape == (13,)
    assert result.value == objective.value(result.solution)
    # All thicknesses together, by differences of runs.
    values = [
        objective.value(bd.simulate(arm(thickness=(0.004 + d,) * 12), method))
        for d in (2e-6, -2e-6)
    ]
    together = (values[0] - values[1]) / 4e-6
    assert result.derivatives["thickness"].sum() == pytest.approx(together, rel=1e-5)


@pytest.mark.slow(reason="a fifth of a second")
def test_interpreted_sweep_agrees_with_machine_code(monkeypatch):
    if not is_native_enabled():
        pytest.skip("machine code is switched off")
    arguments = (
        swing,
        quantities.EndValue("tip.x"),
        "torque",
        bd.GeneralizedAlpha(step=5e-3),
        0.1,
    )
    compiled = bd.gradient(*arguments).derivatives["torque"]
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    assert bd.gradient(*arguments).derivatives["torque"] == pytest.approx(compiled, rel=1e-10)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((oscillator, 3, "stiffness"), {}, "objective must be an Objective"),
        ((3, quantities.EndValue("mass.x"), "stiffness"), {}, "model must be a model function"),
        (
            (oscillator, quantities.EndValue("mass.x"), []),
            {},
            "by must contain each parameter once",
        ),
        (
            (oscillator, quantities.EndValue("mass.x"), "stifness"),
            {},
            "did you mean 'stiffness'",
        ),
        (
            (oscillator, quantities.EndValue("mass.x"), "elements"),
            {},
            "neither a float nor a list",
        ),
        (
            (oscillator, quantities.EndValue("mass.z"), "stiffness"),
            {},
            "there is no column 'mass.z'",
        ),
        (
            (oscillator, quantities.EndValue("mass.x"), "stiffness", bd.Ida()),
            {},
            "gradient: runs of Ida",
        ),
        (
            (
                oscillator,
                quantities.EndValue("mass.x"),
                "stiffness",
                bd.GeneralizedAlpha(formulation="stabilized-index2"),
            ),
            {},
            "must have formulation='index3'",
        ),
    ],
)
def test_invalid_arguments_are_rejected(arguments, options, message):
    if len(arguments) == 3:
        arguments = (*arguments, bd.GeneralizedAlpha(step=1e-2))
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.gradient(*arguments, **options)


def exact_derivative(time, stiffness=40.0):
    """Return d(mass.x)/d(stiffness) of the oscillator by a complex step."""
    rate = 0.5 * 0.8 / MASS
    omega = np.sqrt((stiffness + 1e-30j) / MASS - rate**2)
    position = np.exp(-rate * time) * SPEED / omega * np.sin(omega * time)
    return position.imag / 1e-30


@pytest.mark.parametrize("step", [0.4, 0.3, 0.2, 0.1])
def test_errors_of_steps_that_resolve_no_vibration_are_large(step):
    """Numbers by such steps and by half of them may agree by chance."""
    method = bd.GeneralizedAlpha(step=step)
    for t_end in (1.5, 2.5, 4.0):
        result = bd.gradient(oscillator, quantities.EndValue("mass.x"), "stiffness", method, t_end)
        actual = abs(result.array[0] / exact_derivative(t_end) - 1.0)
        assert 0.7 * actual < result.errors.total[1] < 1.4 * actual


def test_regression_errors_near_a_minimum_are_not_reported(recwarn):
    """The gradient vanishes near a stiffness of 40.46 N/m; an error of 88 % of it was stated."""
    result = bd.gradient(
        oscillator,
        quantities.EndValue("mass.x"),
        "stiffness",
        bd.GeneralizedAlpha(step=0.02),
        1.0,
        parameters={"stiffness": 40.48},
    )
    assert abs(result.array[0] / exact_derivative(1.0, 40.48) - 1.0) > 0.5
    # A relative change of the stiffness changes the objective by less than a thousandth of it.
    assert 40.48 * abs(result.array[0]) < 1e-3 * result.value
    assert result.errors.table()["companion"].iloc[1] == pytest.approx(
        exact_derivative(1.0, 40.48), rel=0.01
    )


@pytest.mark.parametrize("call", [bd.gradient, bd.sensitivities])
def test_invalid_estimate_error_is_rejected(call):
    objective = [quantities.EndValue("mass.x")] if call is bd.gradient else []
    with pytest.raises(bd.BeamdaeError, match=r"estimate_error must be .*, got 'yes'"):
        call(oscillator, *objective, "stiffness", estimate_error="yes")


@bd.model(t_end=0.05)
def resting_ball(height=0.0, stiffness=2e4):
    """A ball that is placed on the floor, up to rounding."""
    mech, ball = free_ball((0.0, height), velocity=(0.5, 0.0), mass=0.5, gravity=9.81)
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", ball.point, floor, stiffness, friction=0.2))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("height", [0.0, -1e-18, -1e-12])
def test_regression_start_at_first_touch_of_a_contact(height):
    """The stiffness of the contact is proportional to the square root of the penetration.

    Its infinite slope made derivatives 1e142 at a penetration of zero, and 315 and -0.2 instead of
    -0.52 at penetrations of 1e-18 m and 1e-12 m. Neglecting it changes derivatives by 1e-3.
    """
    method, values = bd.GeneralizedAlpha(step=1e-3), {"height": height}
    objective, delta = quantities.EndValue("ball.y"), 1e-6
    ends = [
        bd.simulate(resting_ball(height=height + x), method, 0.05)["ball.y"].iloc[-1]
        for x in (-delta, delta)
    ]
    expected = (ends[1] - ends[0]) / (2.0 * delta)
    result = bd.gradient(resting_ball, objective, ["height"], method, parameters=values)
    forward = bd.sensitivities(resting_ball, ["height"], method, parameters=values)
    assert result.derivatives["height"] == pytest.approx(expected, rel=2e-3)
    assert forward.sensitivity("ball.y", "height").iloc[-1] == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow(reason="kernels of a mechanism with friction")
def test_regression_weights_that_decay_to_underflow():
    """Before the only sample, friction damps the weights of later steps to denormal numbers."""
    objective = quantities.SquaredErrors("motor.M", [0.1], [0.0], 1.0)
    whole, short = (
        bd.gradient(quick_return, objective, "crank_radius", bd.Radau(rtol=1e-8), t_end).array
        for t_end in (0.3, 0.12)
    )
    np.testing.assert_allclose(whole, short, rtol=1e-5)


@bd.model(t_end=0.1)
def loaded_rod(near=0.0, far=0.0, first=0.02, second=0.05, kind="force"):
    """Rod on a pin, perhaps with loads at half its length and at its end, or with late torques."""
    mech = bd.Mechanism()
    speed = 1.0 if kind == "damper" else 0.0
    rod = bd.RigidBody.rod("rod", (0.0, 0.0), (1.0, 0.0), mass=3.0, angular_velocity=speed)
    mech.add(rod)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    for x, value in ((0.5, near), (1.0, far)):
        point, anchor = rod.at(x, 0.0), mech.ground.at(x, 1.0)
        if value and kind == "force":
            mech.add(bd.Force(f"load{x:g}", point, (0.0, value)))
        elif value and kind == "spring":
            mech.add(bd.Spring(f"load{x:g}", anchor, point, value, free_length=0.5))
        elif value:
            mech.add(bd.Spring(f"load{x:g}", anchor, point, damping=value))
    mech.observe("rod", rod.at(1.0, 0.0))
    if kind == "torques":
        for name, time in (("first", first), ("second", second)):
            mech.add(bd.Moment(name, rod.at(0.0, 0.0), bd.piecewise((time, 0.0), 2.0)))
    elif kind == "damper":
        torque = mech.add(bd.Moment("torque", rod.at(0.0, 0.0), 5.0))
        mech.when("rod.angle", 0.05, "up", bd.deactivate(torque), name="released")
    return mech


def differentiate_rod(kind, by, method):
    """Return the derivatives of the angle at the end, forward and backward."""
    options = {"parameters": {"kind": kind}, "estimate_error": False}
    forward = bd.sensitivities(loaded_rod, by, method, **options)
    backward = bd.gradient(loaded_rod, quantities.EndValue("rod.angle"), by, method, **options)
    return {x: forward.sensitivity("rod.angle", x).iloc[-1] for x in by}, backward.derivatives


STEP = bd.GeneralizedAlpha(step=0.01)
BOTH_METHODS = [STEP, pytest.param(bd.Radau(), marks=pytest.mark.slow(reason="another method"))]


def assert_derivatives_of_rod(kind, expected, method, tolerance):
    for by in (list(expected), list(expected)[::-1]):
        forward, backward = differentiate_rod(kind, by, method)
        assert forward == pytest.approx(expected, rel=tolerance)
        assert backward == pytest.approx(forward, rel=1e-8)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("method", BOTH_METHODS, ids=repr)
def test_regression_missing_forces_that_differ_in_their_points(method):
    """Both parameters had the derivative of the first, because the structures are equal."""
    # The inertia about the pin is 1 kg m^2, and the torques are constant.
    expected = {"near": 0.5 * 0.1**2 / 2.0, "far": 0.1**2 / 2.0}
    assert_derivatives_of_rod("force", expected, method, 1e-6)


@pytest.mark.slow(reason="kernels of springs and dampers")
@pytest.mark.parametrize("kind", ["spring", "damper"])
@pytest.mark.parametrize("method", [STEP, bd.Radau(1e-8)], ids=repr)
def test_regression_missing_springs_and_dampers_that_differ_in_their_points(kind, method):
    """They had the derivatives of the first, also in runs with events."""
    alone = {x: differentiate_rod(kind, [x], method)[0][x] for x in ("near", "far")}
    assert abs(alone["far"]) > 1.5 * abs(alone["near"]) > 0.0
    assert_derivatives_of_rod(kind, alone, method, 1e-8)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("method", BOTH_METHODS, ids=repr)
def test_regression_parameters_that_move_different_breakpoints(method):
    """The second derivative was zero: the sweep of the first did not shift its breakpoint."""
    expected = {"first": -2.0 * (0.1 - 0.02), "second": -2.0 * (0.1 - 0.05)}
    assert_derivatives_of_rod("torques", expected, method, 1e-3)


def test_gradients_of_the_largest_of_several_objectives():
    """They follow from the derivatives of the objectives by the chain rule."""
    quantities = [bd.quantities.EndValue("mass.x"), bd.quantities.TimeIntegral("mass.x", 2)]
    method = bd.GeneralizedAlpha(step=1e-2)

    def differentiate(objective):
        return bd.gradient(oscillator, objective, "stiffness", method, estimate_error=False)

    whole = differentiate(bd.quantities.LargestOf(quantities, 3.0))
    parts = [differentiate(x) for x in quantities]
    values = np.array([x.value for x in parts])
    assert whole.value == pytest.approx(np.sum(values**3) ** (1.0 / 3.0))
    slopes = np.array([x.array[0] for x in parts])
    assert whole.array[0] == pytest.approx(np.sum(values**2 * slopes) / whole.value**2, rel=1e-9)
