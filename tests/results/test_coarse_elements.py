"""Warnings about elements that are few, or long for the axial tension of beams."""

from dataclasses import replace

import numpy as np
import pytest
from beamdae.results.diagnostics.meshes.element_errors import instant_warnings

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.errors import BeamdaeWarning
from beamdae.results.run_checks import BEAMS, skip_error_estimates
from beamdae.results.trajectory import Interval, Trajectory

STEEL = bd.Material.of("steel")
WIDTH, HEIGHT, LENGTH = 0.02, 1e-3, 0.5


def leaf(name, curve, elements, formulation="exact", height=HEIGHT):
    section = bd.Section.rectangle(STEEL, width=WIDTH, height=height, damping=1e-3)
    return bd.Beam(name, curve, section, elements=elements, formulation=formulation)


def clamped_beam(elements, load, formulation="exact", **settings):
    """A beam between two clamps with a force in the middle, where elements meet."""
    mech = bd.Mechanism(**settings)
    ground = mech.ground
    beam = mech.add(leaf("leaf", bd.Line((0.0, 0.0), (LENGTH, 0.0)), elements, formulation))
    mech.add(bd.Weld("left", ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Weld("right", ground.at(LENGTH, 0.0), beam.end))
    mech.add(bd.Force("push", beam.at(0.5 * LENGTH), (0.0, load)))
    mech.observe("middle", beam.at(0.5 * LENGTH))
    mech.observe("left", mech.part("left").reaction)
    if "redundant" in settings:
        box = mech.add(bd.RigidBody("box", mass=1.0, inertia=1.0, center=(0.0, -1.0)))
        for k, x in enumerate((-0.1, 0.1)):
            mech.add(bd.Weld(f"foot {k}", ground.at(x, -1.0), box.at(x, -1.0)))
    return mech


def arch(elements, load):
    mech = bd.Mechanism()
    arc = bd.Arc(radius=-0.6, length=0.66, angle=0.55)
    beam = mech.add(leaf("arch", arc, elements, "floating frame", height=0.025))
    for name, s in (("left", 0.0), ("right", 0.66)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), beam.at(s)))
    mech.add(bd.Force("push", beam.at(0.44), (0.0, load)))
    mech.observe("middle", beam.at(0.33))
    return mech


def ramp(load):
    return bd.table([0.0, 0.6, 1.0], [0.0, load, load], "pchip")


def taut(result):
    return [x for x in result.warnings if "too long for its tension" in x]


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_statics_compare_travels_and_reactions_with_halved_elements(formulation):
    settings = {"formulation": formulation}
    coarse, fine = (bd.equilibrium(clamped_beam(n, 100.0, **settings)) for n in (2, 16))
    (warning,) = taut(coarse)
    moment, travel = (
        abs(coarse[name].iloc[-1] / fine[name].iloc[-1] - 1.0) for name in ("left.M", "middle.y")
    )
    assert moment > 0.5  # the bending moment at the clamp
    assert travel > 0.05
    halved = bd.equilibrium(clamped_beam(4, 100.0, **settings))
    assert f"left.M is {halved['left.M'].iloc[-1]:.5g} N m" in warning
    assert "middle.y" in warning
    assert not taut(fine)


def test_statics_to_a_position_compare_the_load():
    coarse, halved = (bd.equilibrium(clamped_beam(n, 1.0), to={"middle.y": 5e-3}) for n in (2, 4))
    (warning,) = taut(coarse)
    change = 1.0 - halved.factor / coarse.factor
    assert f"load factor {100.0 * change:.2g} %" in warning
    assert change > 0.1


@pytest.mark.slow(reason="a fifth of a second")
def test_statics_name_beams_of_few_elements_whose_travels_change():
    coarse, fine = (bd.equilibrium(arch(n, -100.0)) for n in (1, 8))
    (warning,) = coarse.warnings
    # The force divides the element.
    assert warning.startswith("arch: 2 elements are too few: with halved elements, middle.")
    assert "use elements=4" in warning
    travels = [np.ptp(x.table()["middle.x [m]"].to_numpy()) for x in (coarse, fine)]
    assert abs(travels[0] / travels[1] - 1.0) > 0.02
    assert not fine.warnings


def preloaded_arch(elements):
    """A strip that is bent to an arch between hinges, with a force on its crown."""
    half_angle = 0.551  # sin(a) / a = 0.95, the distance of the hinges over the length of 0.3 m
    radius = 0.15 / half_angle
    angles = np.linspace(-half_angle, half_angle, 81)
    span = 2.0 * radius * np.sin(half_angle)
    points = np.column_stack(
        [0.5 * span + radius * np.sin(angles), radius * (np.cos(angles) - np.cos(half_angle))]
    )
    mech = bd.Mechanism()
    curve = bd.Curve(points=points)
    straight = bd.Line((0.0, 0.0), (curve.length, 0.0))
    section = bd.Section.rectangle(STEEL, width=WIDTH, height=HEIGHT)
    strip = mech.add(
        bd.Beam("strip", curve, section, elements, formulation="exact", free_curve=straight)
    )
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Revolute("right", mech.ground.at(span, 0.0), strip.end))
    crown = strip.at(0.5 * strip.length)
    mech.add(bd.Force("push", crown, (0.0, -1.0)))
    mech.observe("crown", crown)
    return mech


@pytest.mark.slow(reason="traces two paths")
def test_regression_ends_that_are_not_found_near_those_of_coarse_elements_are_traced():
    """The crown sank 10 % too little at 76 N in silence, but warnings named it at other loads."""
    coarse, fine = (bd.equilibrium(preloaded_arch(n), to=76.0) for n in (2, 16))
    (warning,) = (x for x in coarse.warnings if "halved" in x)
    heights = [x["crown.y"].to_numpy() for x in (coarse, fine)]
    error = 1.0 - np.ptp(heights[0]) / np.ptp(heights[1])
    assert 0.08 < error < 0.12
    stated = float(warning.split("a change of ")[1].split()[0]) / 100.0
    # It is relative to the motion with the coarse elements.
    np.testing.assert_allclose(stated, error / (1.0 - error), rtol=0.1)
    assert not [x for x in fine.warnings if "halved" in x]


@pytest.mark.slow(reason="traces two paths")
def test_regression_critical_points_are_compared_with_halved_elements():
    """Of the branch point, 3 to 6 % too high, an error of 1.1 % was stated."""
    coarse, halved = (
        bd.equilibrium(preloaded_arch(n), to={"crown.y": 0.02}, control="arc length")
        for n in (2, 4)
    )
    (warning,) = (x for x in coarse.warnings if "halved" in x)
    for one, other in zip(coarse.critical, halved.critical, strict=True):
        change = 100.0 * (one.factor / other.factor - 1.0)
        assert change > 2.0
        assert one.kind == other.kind
    assert "load factor of the limit point" in warning
    assert not [x for x in coarse.warnings if "too long for the" in x]


def test_regression_parasitic_motions_of_flexures_are_compared():
    """The pitch of a platform, 1 / 5000 of its travel, was off by half in silence."""
    mech = bd.Mechanism()
    platform = mech.add(bd.RigidBody("platform", mass=0.5, inertia=1e-3, center=(0.03, 0.1)))
    for name, x, height in (("left", 0.0, 0.4e-3), ("right", 0.06, 0.45e-3)):
        axis = bd.Line((x, 0.0), (x, 0.1))
        beam = mech.add(leaf(name, axis, 1, height=height))
        mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Weld(f"{name} head", platform.at(x, 0.1), beam.end))
    mech.add(bd.Force("push", platform.at(0.03, 0.1), (1.0, 0.0)))
    mech.observe("platform", platform.at(0.03, 0.1))
    path = bd.equilibrium(mech, to={"platform.x": 0.035})
    (warning,) = (x for x in path.warnings if "halved" in x)
    assert "platform.angle" in warning
    assert abs(path["platform.angle"].iloc[-1]) < 1e-3


@pytest.mark.slow(reason="a quarter of a second")
def test_runs_compare_beams_of_few_curved_elements():
    coarse, fine = (bd.simulate(arch(n, ramp(-100.0)), t_end=1.0) for n in (1, 8))
    (warning,) = (x for x in coarse.warnings if "too few" in x)
    assert warning.startswith("arch: 2 elements are too few: with halved elements, middle.")
    assert not [x for x in fine.warnings if "too few" in x]


def connecting_rod(elements, observed):
    """The rod of a slider-crank, which its own inertia bends."""
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", mass=1.0, inertia=1e-3))
    shaft = mech.add(bd.Revolute("shaft", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    law = bd.run_up(30.0, 0.2)
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0), law))
    axis = bd.Line((0.04, 0.0), (0.24, 0.0))
    rod = mech.add(leaf("rod", axis, elements, "floating frame", height=5e-3))
    mech.add(bd.Revolute("pin", crank.at(0.04, 0.0), rod.start))
    mech.add(bd.PointMass("slider", 1.0, on=rod.end))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), rod.end, direction=(1.0, 0.0)))
    mech.observe("shaft", shaft.reaction)
    mech.observe("slider", rod.end)
    if observed == "bending":
        mech.observe("bow", rod.deformation(s=0.1, axes="frame"))
    elif observed == "position":
        mech.observe("middle", rod.at(0.1))
    return mech


@pytest.mark.slow(reason="a third of a second")
def test_runs_compare_observed_bending_within_one_straight_element():
    coarse, fine = (bd.simulate(connecting_rod(n, "bending"), t_end=0.6) for n in (1, 8))
    (warning,) = (x for x in coarse.warnings if "too few" in x)
    assert warning.startswith("rod: 1 element is too few: with halved elements, bow.")
    change = np.ptp(fine["bow.v"]) / np.ptp(coarse["bow.v"]) - 1.0
    stated = float(warning.split("bow.v ")[1].split()[0]) / 100.0
    # The warning is relative to the whole range, at one of its ends.
    assert 0.4 * change < stated < 1.1 * change
    assert change > 0.03
    assert not [x for x in fine.warnings if "too few" in x]


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("observed", ["ends", "position"])
def test_runs_with_one_straight_element_whose_columns_are_right_have_no_warning(observed):
    run = bd.simulate(connecting_rod(1, observed), t_end=0.3)
    assert not [x for x in run.warnings if "too few" in x]


@pytest.mark.slow(reason="half a second and more")
def test_regression_runs_of_snapping_strips_are_repeated_with_halved_elements():
    """No state was found with which that while the strip snaps could be compared."""

    def strip(elements):
        mech = bd.Mechanism()
        section = bd.Section.rectangle(STEEL, width=WIDTH, height=2e-4, damping=5e-3)
        line = bd.Line((0.0, 0.0), (0.0, 0.3))
        beam = mech.add(bd.Beam("strip", line, section, elements, formulation="exact"))
        mech.add(bd.Weld("foot", mech.ground.at(0.0, 0.0), beam.start))
        load = np.pi**2 * section.EI / (4.0 * 0.3**2)
        laws = (bd.table([0.0, 2.0, 3.0], [0.0, x, x]) for x in (0.02 * load, -8.0 * load))
        mech.add(bd.Force("press", beam.end, tuple(laws)))
        mech.observe("middle", beam.at(0.12))
        return mech

    coarse, halved = (bd.simulate(strip(n), bd.Ida(1e-6), 3.0) for n in (1, 2))
    (warning,) = (x for x in coarse.warnings if "halved elements" in x)
    name = warning.split("halved elements, ")[1].split(" differs by")[0]
    one, other = coarse[name], halved[name]
    change = np.max(np.abs(one - other)) / max(np.ptp(one), np.ptp(other))
    assert change > 0.05
    stated = float(warning.split("differs by up to ")[1].split()[0]) / 100.0
    np.testing.assert_allclose(stated, change, rtol=0.1)


def test_the_recommended_elements_have_no_warning():
    (warning,) = taut(bd.equilibrium(clamped_beam(2, 100.0)))
    longest = float(warning.split("at most ")[1].split()[0])
    result = bd.equilibrium(clamped_beam(int(np.ceil(LENGTH / longest)), 100.0))
    assert not taut(result)


@pytest.mark.parametrize("settings", [{}, {"redundant": "minimum norm"}])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_runs_compare_a_state_with_halved_elements(formulation, settings):
    mechanisms = (clamped_beam(n, ramp(100.0), formulation, **settings) for n in (2, 4))
    with skip_error_estimates(BEAMS):  # as long runs, which are not repeated
        coarse, halved = (bd.simulate(mech, t_end=1.0) for mech in mechanisms)
        (warning,) = taut(coarse)
    change = abs(halved["left.M"].iloc[-1] / coarse["left.M"].iloc[-1] - 1.0)
    stated = float(warning.split("a change of ")[1].split()[0]) / 100.0
    # The state with the largest tension is near the end of the ramp.
    np.testing.assert_allclose(stated, change, rtol=0.1)
    assert "left.M at t" in warning


def test_runs_that_stop_at_once_are_not_compared():
    run = bd.simulate(clamped_beam(2, 100.0), t_end=1e-3, start="equilibrium")
    first = run.trajectory.intervals[0]
    start = Interval(first.nodes[:1], State(*(x[:1] for x in first.rows)), first.branch)
    stopped = replace(run, trajectory=Trajectory((start,)))
    assert not list(instant_warnings(stopped, None))


@pytest.mark.slow(reason="a quarter of a second")
def test_runs_compare_the_active_parts():
    mech = clamped_beam(2, ramp(100.0))
    middle = mech.part("leaf").at(0.5 * LENGTH)
    spring = bd.Spring("spring", mech.ground.at(0.5 * LENGTH, -0.1), middle, stiffness=1e3)
    mech.add(spring)
    mech.when("t", crosses=0.3, do=bd.deactivate(spring))
    (warning,) = taut(bd.simulate(mech, t_end=1.0))
    assert "left.M" in warning


@pytest.mark.slow(reason="a quarter of a second")
def test_short_elements_and_compression_have_no_warning():
    assert not taut(bd.simulate(clamped_beam(16, ramp(100.0)), t_end=1.0))
    mech = bd.Mechanism()
    strut = mech.add(leaf("strut", bd.Line((0.0, 0.0), (LENGTH, 0.0)), 1))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), strut.start))
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), strut.end))
    euler = np.pi**2 * STEEL.E * WIDTH * HEIGHT**3 / 12.0 / LENGTH**2
    mech.add(bd.Force("push", strut.end, (-0.9 * euler, 0.0)))
    mech.add(bd.Force("side", strut.at(0.5 * LENGTH), (0.0, 0.01)))
    mech.observe("middle", strut.at(0.5 * LENGTH))
    assert not taut(bd.equilibrium(mech))


def rotor(elements):
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=20.0, inertia=0.3, center=(0.0, 0.0)))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    blade = mech.add(leaf("blade", bd.Line((0.1, 0.0), (0.6, 0.0)), elements))
    mech.add(bd.Weld("root", hub.at(0.1, 0.0), blade.start))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law=0.0))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
def test_modes_and_campbell_diagrams_compare_frequencies_of_taut_blades():
    speeds = [0.0, 300.0]
    coarse, halved, fine = (
        [bd.modes(rotor(n), about=bd.rotation(x), n=2) for x in speeds] for n in (1, 2, 16)
    )
    assert not taut(coarse[0])
    (warning,) = taut(coarse[1])
    one, two, right = (float(x[1].frequencies[0]) for x in (coarse, halved, fine))
    change = 100.0 * abs(one / two - 1.0)
    assert f"frequency of {one:.4g} Hz has an error of about {change:.2g} %" in warning
    assert abs(one / right - 1.0) > 0.03
    assert not taut(fine[1])
    with pytest.warns(BeamdaeWarning, match="at 300 rad/s, blade: the elements of 0.5 m"):
        bd.campbell(rotor(1), [*speeds, 0.0], n=2)


@pytest.mark.slow(reason="a quarter of a second")
def test_periodic_motions_of_taut_beams_are_compared_with_halved_elements():
    def pulled(elements):
        mech = bd.Mechanism()
        beam = mech.add(leaf("beam", bd.Line((0.0, 0.0), (LENGTH, 0.0)), elements))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), beam.end))
        mech.add(bd.Force("pull", beam.end, (2000.0, 0.0)))
        load = bd.Force("shake", beam.at(0.5 * LENGTH), (0.0, lambda t: np.sin(160.0 * np.pi * t)))
        mech.add(load)
        mech.observe("middle", beam.at(0.5 * LENGTH))
        return bd.periodic(mech, 1.0 / 80.0)

    coarse, fine = (pulled(n) for n in (2, 8))
    change = abs(fine["middle.y"]).max() / abs(coarse["middle.y"]).max() - 1.0
    assert change > 0.03
    assert any("errors by the elements are" in x for x in coarse.warnings)
