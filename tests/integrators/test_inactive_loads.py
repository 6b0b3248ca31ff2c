"""Loads of inactive forces are zero in columns, events, controllers, equilibria and derivatives."""

import numpy as np
import pytest
from mechanisms import free_ball, mass_on_rail
from numpy.testing import assert_allclose

import beamdae as bd

OFF = 0.1  # position at which the spring is deactivated [m]
LOADS = ("spring [N]", "load.Fx [N]", "power.power [W]", "measured [N]", "push.Fx [N]")


def build(stiffness=100.0):
    """A mass on a guide between two springs, one of which is cut when the mass passes `OFF`."""
    mech, mass = mass_on_rail(1.0, 0.3)
    left, right = mech.ground.at(-1.0, 0.0), mech.ground.at(1.0, 0.0)
    spring = mech.add(bd.Spring("spring", left, mass.point, stiffness, free_length=1.0))
    mech.add(bd.Spring("other", right, mass.point, 5.0, free_length=0.8))
    mech.observe("mass", mass.point)
    mech.observe("spring", spring.force)
    mech.observe("load", spring.load_on("b"))
    mech.observe("power", spring.power)
    mech.observe("elongation", spring.elongation)
    measured = mech.sensor("measured", spring.force)
    push = mech.add(bd.Force("push force", mass.point, (lambda t: 0.5 * measured, 0.0)))
    mech.observe("push", push.force)
    return mech, spring


@bd.model(t_end=0.5)
def cut(stiffness=100.0):
    mech, spring = build(stiffness)
    mech.when("mass.x", OFF, "down", bd.deactivate(spring), "cut")
    mech.when("measured", 1.0, "down", "record", "unloaded")
    return mech


METHOD = bd.GeneralizedAlpha(step=2e-3)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "method", [METHOD, bd.Radau(1e-7), bd.Ida(1e-7)], ids=["alpha", "radau", "ida"]
)
def test_regression_loads_of_a_cut_spring_are_zero(method):
    run = bd.simulate(cut(), method, output_step=0.02)
    record = run.event_records[0]
    after = run.t > record.t
    assert record.name == "cut"
    assert after.any()
    for header in LOADS:
        assert np.all(run.columns[header][after] == 0.0)
        assert run.columns[header][~after][-1] != 0.0
    # Deformations are not loads.
    assert np.all(run.columns["elongation [m]"][after] != 0.0)
    # The table of events contains the load before the action.
    assert run.events["spring [N]"].iloc[0] == pytest.approx(100.0 * OFF, rel=1e-4)
    # The measured load no longer acts through the other force: the energy balance would miss it.
    assert run.quality.energy_imbalance < 1e-3


@pytest.mark.slow(reason="half a second and more")
def test_regression_derivatives_of_loads_of_a_cut_spring():
    run = bd.sensitivities(cut, "stiffness", METHOD, output_step=0.1, estimate_error=False)
    step = 1e-3
    ends = [bd.simulate(cut(stiffness=100.0 + d), METHOD, 0.5, 0.1) for d in (step, -step)]
    for header in LOADS:
        difference = (ends[0].columns[header] - ends[1].columns[header]) / (2.0 * step)
        values = run.columns.observed["stiffness"][header]
        assert_allclose(values, difference, atol=1e-6 * np.max(np.abs(difference)))


@pytest.mark.slow(reason="half a second and more")
def test_regression_gradient_of_the_integral_of_a_load_that_ends():
    objective = bd.quantities.TimeIntegral("spring")

    def value(stiffness):
        parameters = {"stiffness": stiffness}
        return bd.gradient(
            cut, objective, "stiffness", METHOD, parameters=parameters, estimate_error=False
        )

    step = 1e-2
    difference = (value(100.0 + step).value - value(100.0 - step).value) / (2.0 * step)
    assert value(100.0).derivatives["stiffness"] == pytest.approx(difference, rel=1e-5)


def test_regression_equilibria_and_linear_models_without_the_load():
    mech, spring = build()
    mech.deactivate(spring)
    path = bd.equilibrium(mech)
    assert path.columns["mass.x [m]"][-1] == pytest.approx(0.2)  # free length of the other spring
    linear = bd.linearize(mech, about=path)
    for header in LOADS:
        if header in path.columns:
            assert path.columns[header][-1] == 0.0
        row = [x.header for x in linear.outputs].index(header)
        assert not linear.C[row].any()
        assert linear.output_values[row] == 0.0


def test_regression_formulas_of_inactive_forces_need_not_be_finite():
    mech, mass = free_ball((0.1, 0.0), velocity=(-1.0, 0.0), name="mass")
    spring = mech.add(
        bd.Spring(
            "spring", mech.ground.at(-1.0, 0.0), mass.point, law=lambda u, v: (u + 0.1) ** 0.5
        )
    )
    mech.observe("spring", spring.force)
    mech.when("mass.x", 0.05, "down", bd.deactivate(spring))
    run = bd.simulate(mech, METHOD, 0.5)
    assert run.status.success
    assert run.columns["spring [N]"][-1] == 0.0


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_controllers_read_zero_for_a_cut_spring():
    mech, spring = build()
    mech.when("mass.x", OFF, "down", bd.deactivate(spring), "cut")
    held = mech.input("held", 0.0, unit="N")
    reads = mech.sensor("read", spring.force)
    mech.add(bd.Controller("logger", 0.01, [reads], [held], lambda sample: sample.reads[0]))
    run = bd.simulate(mech, METHOD, 0.5, output_step=0.01)
    after = run.t > run.event_records[0].t + 0.011
    assert np.all(run.columns["held [N]"][after] == 0.0)
    assert np.all(run.columns["held [N]"][1:10] > 0.0)


def test_regression_columns_added_after_the_run():
    mech, spring = build()
    mech.when("mass.x", OFF, "down", bd.deactivate(spring), "cut")
    run = bd.simulate(mech, METHOD, 0.5).observe("added", spring.load_on("b"))
    assert np.all(run.columns["added.Fx [N]"][run.t > run.event_records[0].t] == 0.0)
