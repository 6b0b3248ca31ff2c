"""Columns of fixed points, and those that vanish by symmetry, in checks that compare computations.

They vary by drift and rounding errors only, which no mesh, strain or step determines.
"""

import math
import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from mechanisms import ALLOY, driven, hinged_body, rectangle

import beamdae as bd

STRIP = rectangle(0.002, damping=1e-4, material=ALLOY)
PERIOD = 1.0 / 12.9


def swing(amplitude: float) -> Callable[[object], object]:
    """Return the law of an angle [rad] that oscillates with the period."""
    return lambda t: amplitude * ca.sin(2.0 * ca.pi * t / PERIOD)


def four_bar(
    elements: int = 2, law: object = None, accelerations: bool = True, observed: bool = False
) -> bd.Mechanism:
    """Return a four-bar linkage whose rocker is observed at its fixed pivot."""
    crank, coupler, rocker, base = 0.1, 0.4, 0.3, 0.4
    start, pivot = np.array([crank, 0.0]), np.array([base, 0.0])
    span = base - crank
    angle = math.acos((coupler**2 + span**2 - rocker**2) / (2.0 * coupler * span))
    end = start + coupler * np.array([math.cos(angle), math.sin(angle)])
    disk = bd.RigidBody("crank", mass=0.2, inertia=1e-4)
    mech, arm = driven(disk, law or bd.run_up(25.0, 0.5), 9.81)
    beam = mech.add(bd.Beam("coupler", bd.Line(start, end), STRIP, elements=elements))
    inertia = 0.3 * rocker**2 / 12.0
    center = tuple(0.5 * (pivot + end))
    lever = mech.add(bd.RigidBody("rocker", mass=0.3, inertia=inertia, center=center))
    mech.add(bd.Revolute("A", arm.at(*start), beam.start))
    mech.add(bd.Revolute("B", beam.end, lever.at(*end)))
    mech.add(bd.Revolute("C", mech.ground.at(*pivot), lever.at(*pivot)))
    mech.observe("rocker", lever.at(*pivot))
    if accelerations:
        mech.observe("pivot", bd.acceleration(lever.at(*pivot)))
    if observed:
        mech.observe("middle", beam.deformation(0.5 * coupler, axes="frame"))
    return mech


def rotor(law: object) -> bd.Mechanism:
    """Return a hub with two opposite blades, which load its bearing equally."""
    mech, hub = driven(bd.RigidBody("hub", mass=5.0, inertia=0.03), law)
    section = rectangle(0.004, 0.03, damping=1e-4, material=ALLOY)
    for name, side in (("right", 1.0), ("left", -1.0)):
        line = bd.Line((0.1 * side, 0.0), (0.6 * side, 0.0))
        blade = mech.add(bd.Beam(name, line, section, elements=2))
        mech.add(bd.Weld(f"clamp {name}", hub.at(0.1 * side, 0.0), blade.start))
    mech.observe("bearing", mech.part("hinge").reaction)
    mech.observe("hub", hub.at(0.0, 0.0))
    mech.observe("center", bd.acceleration(hub.at(0.0, 0.0)))
    return mech


def guided_stage(elements: int) -> bd.Mechanism:
    """Return a stage between two flexures, and in a guide that symmetry does not load."""
    mech = bd.Mechanism()
    stage = mech.add(bd.RigidBody("stage", mass=0.3, inertia=1e-4, center=(0.0, 0.0)))
    section = rectangle(5e-4, material=ALLOY)
    for name, side in (("right", 1.0), ("left", -1.0)):
        line = bd.Line((0.12 * side, 0.0), (0.02 * side, 0.0))
        leaf = mech.add(bd.Beam(name, line, section, elements=elements))
        mech.add(bd.Weld(f"base {name}", mech.ground.at(0.12 * side, 0.0), leaf.start))
        mech.add(bd.Weld(f"stage {name}", leaf.end, stage.at(0.02 * side, 0.0)))
    ground = mech.ground.at(0.0, 0.0)
    guide = mech.add(bd.Prismatic("guide", ground, stage.at(0.0, 0.0), direction=(0.0, 1.0)))
    mech.add(bd.Force("push", stage.at(0.0, 0.0), (0.0, 3.0)))
    mech.observe("guide", guide.reaction)
    return mech


def sentences(compute: Callable[[], object]) -> list[str]:
    """Return the warnings of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        compute()
    return [str(x.message) for x in caught]


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("integrator", [None, bd.Ida(rtol=1e-3)], ids=["default", "loose"])
@pytest.mark.parametrize("elements", [1, 2])
def test_regression_few_elements_do_not_change_the_velocity_of_a_fixed_pivot(
    elements: int, integrator: bd.Integrator | None
) -> None:
    """A velocity of 1e-8 m/s, the drift of the joint, differed by 40 % with halved elements."""
    mech = four_bar(elements, accelerations=False)
    assert not sentences(lambda: bd.simulate(mech, integrator, t_end=0.6, output_step=1e-3))


@pytest.mark.slow(reason="half a second")
def test_regression_few_elements_still_change_deformations_beside_a_fixed_pivot() -> None:
    mech = four_bar(1, accelerations=False, observed=True)
    (sentence,) = sentences(lambda: bd.simulate(mech, t_end=0.6, output_step=1e-3))
    assert sentence.startswith("middle.phi: the error is about")
    assert "rocker" not in sentence


@pytest.mark.slow(reason="half a second")
def test_regression_rows_do_not_resolve_the_acceleration_of_a_fixed_pivot() -> None:
    """Accelerations of 3e-4 m/s^2, beside 60 m/s^2, had a warning of a fast vibration."""
    assert not sentences(lambda: bd.simulate(four_bar(), t_end=0.6, output_step=1e-3))


@pytest.mark.parametrize("integrator", [bd.Radau(1e-5), bd.Ida(1e-5)])
def test_regression_rows_do_not_miss_the_drift_of_a_fixed_pivot(integrator: bd.Integrator) -> None:
    """At the steps, the drift was larger than at the few rows."""
    mech, wheel = hinged_body(1.0, 0.3, (0.3, 0.1))
    mech.add(bd.Moment("torque", on=wheel.at(0.0, 0.0), law=bd.sine(10.0, 1.0)))
    mech.observe("hub", wheel.at(0.0, 0.0))
    assert not sentences(lambda: bd.simulate(mech, integrator, t_end=1.0, output_step=0.1))


def test_velocities_across_a_guide_have_no_errors() -> None:
    """Between the steps of Radau, the drift of the guide is larger than at the steps."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, 1e-3), bd.run_up(30.0, 0.2))
    section = rectangle(0.005, damping=1e-3)
    rod = mech.add(bd.Beam("rod", bd.Line((0.04, 0.0), (0.24, 0.0)), section, elements=1))
    mech.add(bd.Revolute("pin", crank.at(0.04, 0.0), rod.start))
    mech.add(bd.PointMass("slider", 1.0, on=rod.end))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), rod.end, direction=(1.0, 0.0)))
    mech.observe("slider", rod.end)
    run = bd.simulate(mech, t_end=0.3)
    assert run["slider.y_dot"].abs().max() > 1e-7
    assert not run.errors.table()["total"]["slider.y_dot [m/s]"]


def test_regression_errors_of_the_acceleration_of_a_fixed_pivot_are_not_estimated() -> None:
    """The estimated error was 290 % of half the range."""
    run = bd.simulate(four_bar(), t_end=0.6, output_step=1e-3)
    errors = run.errors.table()["total"]
    assert not errors[["pivot.ax [m/s^2]", "pivot.ay [m/s^2]"]].any()
    assert errors["pivot.angle_ddot [rad/s^2]"] > 0.0


@pytest.mark.slow(reason="seconds")
@pytest.mark.parametrize(
    "mech", [four_bar(law=swing(0.1)), rotor(swing(1e-4))], ids=["four-bar", "rotor"]
)
def test_regression_periodic_motions_have_no_beam_errors_of_fixed_points(
    mech: bd.Mechanism,
) -> None:
    """Errors of velocities of 1e-12 m/s and of reactions of 1e-12 N were up to 1e18 %."""
    assert not sentences(lambda: bd.periodic(mech, period=PERIOD))


@pytest.mark.slow(reason="seconds")
def test_regression_periodic_motions_still_have_beam_errors_beside_fixed_points() -> None:
    mech = four_bar(1, law=swing(0.1), observed=True)
    texts = sentences(lambda: bd.periodic(mech, period=PERIOD))
    assert any(x.startswith("middle.phi: the error is about ") for x in texts)
    assert not any("rocker" in x or "pivot" in x for x in texts)


@pytest.mark.slow(reason="half a second")
def test_regression_accelerations_of_a_symmetric_hub_have_no_errors() -> None:
    """Errors of reactions of 1e-12 N were 7 times half the range."""
    run = bd.simulate(rotor(bd.run_up(5.0, 0.5)), t_end=0.1, output_step=1e-3, accuracy=0.01)
    assert run.errors.status.success
    assert run.errors.largest < 0.04


@pytest.mark.parametrize("elements", [1, 2, 3])
def test_regression_few_elements_do_not_change_a_reaction_that_vanishes_by_symmetry(
    elements: int,
) -> None:
    """A moment of 1e-14 N m in equilibrium differed by 17 % with halved elements."""
    assert not sentences(lambda: bd.equilibrium(guided_stage(elements)))


@pytest.mark.slow(reason="seconds")
def test_regression_sensitivities_of_reactions_that_vanish_have_no_step_errors() -> None:
    """The error of d(bearing.Fx)/d(amplitude), at a force of 1e-12 N, was above 100 %."""

    @bd.model(t_end=0.2)
    def model(amplitude: float = 0.05) -> bd.Mechanism:
        return rotor(swing(amplitude))

    texts = sentences(lambda: bd.sensitivities(model, ["amplitude"]))
    assert not any("sensitivities: the error" in x for x in texts)


def test_columns_vanish_beside_rates_and_reactions_that_are_not_observed() -> None:
    run = bd.simulate(rotor(bd.run_up(25.0, 0.5)), t_end=0.2)
    coarse = run.at_times(np.linspace(0.0, 0.2, 8))
    assert not any("bearing.F" in x or "hub.x" in x for x in coarse.missed_peaks)


def test_power_of_a_driver_that_holds_still_is_rounding(
    recwarn: pytest.WarningsRecorder,
) -> None:
    """A held strip that an event releases has no warning about the power of the driver."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.003, damping=1e-4)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.5, 0.0)), section))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    on = mech.ground.at(0.5, 0.0), beam.end
    hand = mech.add(bd.TranslationalDriver("hand", *on, -0.05, direction=(0.0, 1.0)))
    mech.observe("hand", hand.drive)
    mech.when("t", crosses=0.02, do=bd.deactivate(hand))
    run = bd.simulate(mech, t_end=0.1, start="equilibrium")
    assert 0.0 < run["hand.power"].abs().max() < 1e-20
    assert not [x for x in recwarn if "hand.power" in str(x.message)]
