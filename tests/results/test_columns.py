"""Columns of runs: selection, values that vanish, and elastic columns."""

import math
import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from mechanisms import ALLOY, EARTH, clamped_beam, driven, free_ball, hinged_body, rectangle

import beamdae as bd


def falling(*names):
    """Return a run of falling masses, which are all observed."""
    mech = bd.Mechanism(gravity=EARTH)
    for k, name in enumerate(names):
        mech.observe(name, mech.add(bd.PointMass(f"mass {k}", 1.0, at=(k, 2.0))).point)
    return mech


@pytest.fixture(scope="module")
def run():
    return bd.simulate(falling("tip"), t_end=0.1)


def test_a_single_column_is_selected_with_or_without_its_unit(run):
    for name in ("tip.y", "tip.y [m]"):
        assert run[name].name == "tip.y [m]"


@pytest.mark.parametrize("name", ["ti", "tip.y [N]", 3, None])
def test_names_of_no_column_are_rejected(name, run):
    with pytest.raises(bd.BeamdaeError, match=r"column"):
        run[name]


def test_regression_a_list_of_names_selects_a_table_over_time():
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    run = bd.simulate(mech, t_end=0.1)
    table = run[["ball.y", "ball.x [m]", "ball.y"]]
    assert list(table) == ["ball.y [m]", "ball.x [m]"]
    assert table.index.name == "t [s]"
    assert list(run[["ball.y"]]) == ["ball.y [m]"]
    with pytest.raises(bd.BeamdaeError, match=r"no column 'ball\.z'"):
        run[["ball.y", "ball.z"]]
    with pytest.raises(AttributeError, match=r"plot\.save\(path\)"):
        run.plot("ball.y").savefig("y.png")


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("motr.M", "motor.M"),
        ("motor.T", "motor.M"),
        ("knee 2.z", "knee 2.y"),
    ],
)
def test_regression_messages_list_the_most_similar_columns_first(name, first):
    """Torques of drivers were hidden behind "and 2 more"."""
    mech = falling(*(f"{point} {k}" for point in ("tip", "knee") for k in range(5)))
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.1))
    center = mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", *center))
    motor = mech.add(bd.Driver("motor", *center, bd.sine(1.0, 2.0)))
    mech.observe("motor", motor.reaction)
    with pytest.raises(bd.BeamdaeError) as caught:
        bd.simulate(mech, t_end=1e-3)[name]
    listed = str(caught.value).partition("available columns: ")[2]
    assert listed.startswith(f"{first}, ")
    assert listed.endswith(" more.")


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


WITH_WARNINGS = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")


def pressed_blade(elements, duration=0.1):
    """A blade of steel that leans on a plate, while its holder is lowered slowly."""
    mech = bd.Mechanism()
    section = rectangle(4e-4, 0.15, damping=1e-4)
    top, up = (0.04, 0.04 * np.sqrt(3.0)), (0.0, 1.0)
    holder = mech.add(bd.RigidBody("holder", mass=0.05, inertia=1e-5, center=top))
    ends = mech.ground.at(*top), holder.at(*top)
    mech.add(bd.Prismatic("guide", *ends, direction=up))

    def travel(t):
        x = t / duration
        return -8e-3 * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)

    law = bd.piecewise((duration, travel), -8e-3)
    mech.add(bd.TranslationalDriver("press", *ends, law, direction=up))
    line = bd.Line(top, (0.0, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", holder.at(*top), blade.start))
    mech.add(bd.PointOnLine("plate", mech.ground.at(0.0, 0.0), blade.end, direction=(1.0, 0.0)))
    mech.observe("clamp", blade.section_forces(0.0))
    return mech


def bushed_pendulum(stiffness, *event, **options):
    """Two bodies that a stiff bushing connects; an event may follow."""
    mech, arm = hinged_body(1.0, 0.1, name="arm", gravity=9.81)
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
    ends = arm.at(0.5, 0.0), bob.at(0.5, 0.0)
    springs = dict.fromkeys(("kx", "ky", "ktheta"), stiffness)
    dampers = dict.fromkeys(("cx", "cy", "ctheta"), 1e-5 * stiffness)
    bushing = mech.add(bd.Bushing("bushing", *ends, **springs, **dampers))
    mech.observe("bushing", bushing.force)
    idle = mech.add(bd.Force("idle", bob.at(1.0, 0.0), (0.0, 0.0)))
    if event:
        do = options.pop("do", None) or bd.deactivate(idle)
        mech.when(*event, do=do, name="limit", **options)
    return mech


def mesh_warnings(run):
    return [x for x in run.warnings if "mesh error" in x]


@WITH_WARNINGS
@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "integrator", [bd.Radau(1e-5), bd.Ida(1e-5), bd.GeneralizedAlpha(rtol=1e-5)]
)
def test_regression_axial_forces_between_steps_are_as_accurate_as_at_steps(integrator):
    """They were wrong by 93 % of the largest value with Radau; at the steps, they are right."""
    coarse, fine = (bd.simulate(pressed_blade(16), x, 0.2) for x in (integrator, bd.Radau(1e-9)))
    balanced = fine.section_forces("blade", s=[0.0])
    for name in ("N", "Q", "M"):
        reference = fine[f"clamp.{name}"].to_numpy()
        largest = np.max(np.abs(reference))
        # Errors at the steps are up to 1e-3.
        np.testing.assert_allclose(
            coarse[f"clamp.{name}"].to_numpy(), reference, atol=3e-3 * largest
        )
        # From the loads, without strains.
        np.testing.assert_allclose(reference, getattr(balanced, name)[:, 0], atol=2e-3 * largest)


@WITH_WARNINGS
@pytest.mark.slow(reason="half a second")
def test_regression_forces_of_stiff_bushings_between_steps_are_accurate():
    """They were wrong by 35 and 49 % of the largest value."""
    coarse, fine = (bd.simulate(bushed_pendulum(1e9), bd.Radau(x), 1.0) for x in (1e-5, 1e-9))
    for name in ("bushing.Fx", "bushing.Fy"):
        reference = fine[name].to_numpy()
        largest = np.max(np.abs(reference))
        np.testing.assert_allclose(coarse[name].to_numpy(), reference, atol=2e-3 * largest)


@WITH_WARNINGS
@pytest.mark.slow(reason="half a second and more")
def test_regression_errors_between_steps_are_no_mesh_errors():
    """Shorter elements were recommended, which make them larger."""
    run = bd.simulate(pressed_blade(16, duration=1.0), bd.Radau(1e-5), 2.0)
    assert not mesh_warnings(run)


@WITH_WARNINGS
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize("integrator", [bd.GeneralizedAlpha(step=0.01), bd.Radau(1e-2)])
def test_largest_stresses_between_steps_are_those_of_both_fibers(integrator, formulation):
    """Polynomials through kinks of magnitudes were negative, and missed their zeros by 8 %."""
    strip = rectangle(0.004, damping=1e-3)
    mech, beam = clamped_beam(strip, curve=0.6, name="strip", formulation=formulation)
    mech.add(bd.Force("shaker", beam.end, (0.0, lambda t: ca.sin(6.0 * np.pi * t + 1.0))))
    for name, exponent in (("largest", None), ("bound", 20.0)):
        mech.observe(name, beam.largest_stress(s=[0.0], exponent=exponent))
    for side in ("top", "bottom"):
        mech.observe(side, beam.stress(0.0, side))
    run = bd.simulate(mech, integrator, t_end=0.9, output_step=5e-4)
    top, bottom = (run[x].to_numpy() for x in ("top", "bottom"))
    both = np.maximum(np.abs(top), np.abs(bottom))
    for name in ("largest.largest", "bound.bound"):
        magnitude = run[name].to_numpy()
        assert magnitude.min() >= 0.0
        # Eleven steps a period interpolate positions and stresses within 2 % of the amplitude.
        np.testing.assert_allclose(magnitude, both, atol=0.02 * both.max())


@WITH_WARNINGS
@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e11])
@pytest.mark.parametrize(
    "integrator", [bd.Radau(1e-4), bd.Radau(1e-6), bd.GeneralizedAlpha(step=2e-3)]
)
def test_events_of_stiff_forces_are_crossings_of_their_columns(integrator, stiffness):
    """Forces at interpolated positions crossed limits that columns never reach, 662 times."""
    free = bd.simulate(bushed_pendulum(stiffness), integrator, 1.0)
    for column in ("bushing.Fx", "bushing.Fy"):
        extremes = free.step_extremes[column]
        middle = 0.5 * (extremes.min + extremes.max)

        for side in (-1.5, 0.0, 1.5):
            limit = middle + side * extremes.half_range
            mech = bushed_pendulum(stiffness, column, limit, do="record")
            run = bd.simulate(mech, integrator, 1.0)
            assert run.events.empty == (side != 0.0)
            if side == 0.0:
                rows = run.at_times(run.events["t [s]"].to_numpy())
                for values in (run.events[f"{column} [N]"], rows[column]):
                    np.testing.assert_allclose(values, limit, atol=1e-9 * extremes.half_range)


@WITH_WARNINGS
@pytest.mark.parametrize("stiffness", [1e9, 1e11])
@pytest.mark.parametrize("rtol", [1e-5, 1e-6])
def test_stiff_forces_are_accurate_where_a_run_restarts(rtol, stiffness):
    """They were wrong by 6 to 41 % of the largest value; transverse ones, by up to four times."""
    free = bd.simulate(bushed_pendulum(stiffness), bd.Radau(1e-8), 1.0)
    run = bd.simulate(bushed_pendulum(stiffness, "t", 0.3137), bd.Radau(rtol), 1.0)
    times = 0.3137 + np.linspace(0.0, 5e-3, 50)
    coarse, fine = (x.at_times(times) for x in (run, free))
    for column in ("bushing.Fx", "bushing.Fy"):
        largest = np.max(np.abs(free[column]))
        np.testing.assert_allclose(coarse[column], fine[column], atol=0.02 * largest)
