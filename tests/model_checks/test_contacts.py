"""Warnings about contacts and jumps of velocities."""

import numpy as np
import pytest
from mechanisms import clamped_beam, free_ball, hinged_body, rectangle

import beamdae as bd

G = 9.81


def list_warnings(result):
    """Return the warnings about contacts of a result."""
    return [x for x in result.warnings if "the contact sinks" in x]


def run(mech, t_end, **settings):
    return bd.simulate(mech, bd.Radau(1e-4), t_end=t_end, **settings)


# Deep contacts ------------------------------------------------------------------------------------
def pressed_lip(stiffness, height=2e-3, start="as drawn"):
    """Return a cantilever of 0.2 m that a force of 10 N presses on a plate of 1 m below its tip."""
    rubber = bd.Material(E=6e6, nu=0.45, rho=1150.0)
    section = rectangle(height, 0.03, damping=3e-3, material=rubber)
    mech, lip = clamped_beam(section, 2, 0.2, name="lip", start=start, formulation="exact")
    mech.add(bd.Force("press", lip.end, (0.0, -10.0)))
    plate = mech.add(bd.RigidBody.plate("plate", (0.2, -0.5001), 0.5, 1.0, mass=1.0))
    mech.add(bd.Weld("bed", mech.ground.at(0.2, -1.0), plate.at(0.2, -1.0)))
    surface = bd.LineSurface(plate.at(0.2, -1e-4))
    mech.add(bd.Contact("glass", lip.end, surface, stiffness, exponent=1.0))
    return mech


def dropped_bar(stiffness, is_guided=False):
    """Return a bar of 0.3 m and 4 mm that falls flat on a layer of foam at 2 m/s."""
    section = rectangle(0.004, damping=2e-5)
    line, start = bd.Line((-0.15, 0.0), (0.15, 0.0)), {"velocity": (0.0, -2.0)}
    mech = bd.Mechanism(gravity=(0.0, -G))
    bar = mech.add(bd.Beam("bar", line, section, elements=2, formulation="exact", **start))
    for name, point in (("left", bar.start), ("right", bar.end)):
        mech.add(bd.PointMass(name, 0.2, on=point))
    if is_guided:
        mech.add(bd.PointOnLine("guide", mech.ground.at(-0.15, 0.0), bar.start, (0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("foam", bar.at(0.15), floor, stiffness, exponent=1.0))
    return mech


def falling_crate(stiffness, height=0.1):
    """Return a crate of 5 kg, 0.2 m wide, that falls by 0.25 m on two of its corners."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    crate = mech.add(bd.RigidBody.plate("crate", (0.0, 0.3), 0.2, height, mass=5.0))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.05 - height / 2.0))
    for name, x in (("left", -0.1), ("right", 0.1)):
        point = crate.at(x, 0.3 - height / 2.0)
        mech.add(bd.Contact(name, point, floor, stiffness, exponent=1.0))
    return mech


def colliding_balls(stiffness, side="outside"):
    mech, ball = free_ball(velocity=(5.0, 0.0))
    other = mech.add(bd.PointMass("other", 1.0, at=(0.0 if side == "inside" else 0.5, 0.0)))
    circle = bd.CircleSurface(other.point, 0.1, side)
    mech.add(bd.Contact("hit", ball.point, circle, stiffness, exponent=1.0))
    return mech


DEEP_CASES = {
    "lip": (pressed_lip(1e3), 0.2, "lip is thick (0.002 m)"),
    "lip at rest": (pressed_lip(1e3, start="equilibrium"), 0.05, "lip is thick (0.002 m)"),
    "bar in air": (dropped_bar(1.0), 0.4, "bar is long (0.3 m)"),
    "guided bar": (dropped_bar(2e4, is_guided=True), 0.03, "bar is thick (0.004 m)"),
    "bar on foam": (dropped_bar(2e4), 0.03, ""),
    "crate": (falling_crate(100.0), 0.8, "crate is large (0.224 m)"),
    "balls": (colliding_balls(100.0), 0.3, "half the radius of the circle (0.05 m)"),
    "stiff lip": (pressed_lip(1e5), 0.05, ""),
    "thick lip": (pressed_lip(1e3, 0.05), 0.05, ""),
    "stiff crate": (falling_crate(1e4), 0.5, ""),
    "large crate": (falling_crate(300.0, height=0.4), 0.5, ""),
    "stiff balls": (colliding_balls(1e4), 0.3, ""),
    # The clearance of a bore says nothing about the thickness of its wall.
    "bore": (colliding_balls(100.0, side="inside"), 0.3, ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "t_end", "limit"), DEEP_CASES.values(), ids=DEEP_CASES.keys())
def test_contacts_deeper_than_a_touching_part_have_a_warning(mech, t_end, limit):
    found = list_warnings(run(mech, t_end))
    assert len(found) == bool(limit)
    assert all(f"deep, more than {limit}" in x for x in found)


def test_checks_and_equilibria_name_deep_contacts():
    for stiffness, count in ((1e3, 1), (1e5, 0)):
        # 10 N / (1e3 N/m) are 10 mm, of which the beam carries some.
        for text in (found := list_warnings(bd.check(pressed_lip(stiffness, start="equilibrium")))):
            assert 0.008 < float(text.split("sinks ")[1].split(" m deep")[0]) <= 0.01
        assert len(found) == count
        mech = bd.Mechanism(gravity=(0.0, -G))
        plate = mech.add(bd.RigidBody.plate("plate", (0.0, 0.05), 0.1, 0.1, mass=30.0))
        guide = mech.ground.at(0.0, 0.05), plate.at(0.0, 0.05)
        mech.add(bd.Prismatic("guide", *guide, direction=(0.0, 1.0)))
        floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
        mech.add(bd.Contact("floor", plate.at(0.0, 0.0), floor, stiffness, exponent=1.0))
        found = list_warnings(bd.equilibrium(mech))
        assert [x[:40] for x in found] == count * ["floor: the contact sinks 0.294 m deep, mo"[:40]]


TIMES, ANGLES = [0.0, 0.4, 0.8, 1.2], [0.0, 0.4, -0.2, 0.2]


def crank(law, joint=bd.Driver):
    mech, body = hinged_body(1.0, 0.1, (1.0, 0.0), gravity=9.81)
    if joint is bd.Distance:
        mech.add(bd.Distance("drive", mech.ground.at(2.0, 0.5), body.at(1.0, 0.5), law))
    else:
        mech.add(joint("drive", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0), law))
    mech.observe("drive", mech.part("drive").drive)
    return mech


@pytest.mark.parametrize("integrator", [bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(step=0.01)])
def test_regression_a_driver_whose_slope_jumps_has_a_warning(integrator):
    """The torque at the rows was that of gravity alone, and nothing told of the impulses."""
    law = bd.table(TIMES, ANGLES, kind="linear")
    solution = bd.simulate(crank(law), integrator, t_end=1.2)
    assert solution["drive.M"].abs().max() < 9.82
    (warning,) = (x for x in solution.warnings if "slope of its law" in x)
    assert warning.startswith("drive: the slope of its law jumps 2 times, first at t = 0.4 s")


@pytest.mark.slow(reason="a fifth of a second")
def test_a_distance_whose_slope_jumps_has_a_warning():
    law = bd.piecewise((0.5, lambda t: 1.0 + 0.1 * t), 1.05)
    warnings = bd.simulate(crank(law, bd.Distance), t_end=1.0).warnings
    assert (
        sum(x.startswith("drive: the slope of its law jumps at t = 0.5 s") for x in warnings) == 1
    )


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha(step=0.01)])
@pytest.mark.parametrize(
    "law",
    [
        bd.run_up(3.0, 1.0),
        bd.table(TIMES, ANGLES),
        bd.table(TIMES, ANGLES, kind="pchip"),
        bd.piecewise((1.0, lambda t: t**2), lambda t: 2.0 * t - 1.0),
        bd.piecewise((0.5, lambda t: 1e-3 * np.sin(t)), lambda t: 1e-3 * np.sin(t)),
        bd.piecewise((0.2, 0.0), (0.7, lambda t: 0.1 - 0.1 * np.cos(4.0 * np.pi * (t - 0.2))), 0.0),
    ],
    ids=["run up", "spline", "pchip", "smooth pieces", "small", "bump"],
)
def test_continuous_slopes_have_no_warning(law, integrator):
    assert not any("slope" in x for x in bd.simulate(crank(law), integrator, t_end=1.2).warnings)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("kind", ["linear", "spline"])
def test_regression_angles_that_a_driver_holds_have_no_jumps(kind):
    """Velocities of 1e-17 rad/s at the rows of the force table were jumps of the constant law."""
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    section = rectangle(0.008, 0.05, damping=2e-5, material=steel)
    mech, leaf = clamped_beam(section, 2, 0.4, name="leaf", formulation="exact")
    tip = mech.add(bd.RigidBody("tip", 0.5, 1e-3, center=(0.4, 0.0)))
    mech.add(bd.Weld("bolt", leaf.end, tip.at(0.4, 0.0)))
    mech.add(bd.Driver("guide", mech.ground.at(0.4, 0.0), tip.at(0.4, 0.0), law=0.0))
    force = bd.table(np.linspace(0.0, 0.01, 5), [0.0, -400.0, -600.0, -400.0, 0.0], kind)
    mech.add(bd.Force("pulse", leaf.end, (0.0, force)))
    mech.observe("tip", leaf.end)
    run = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-4), t_end=0.02)
    assert not any("slope" in x for x in run.warnings)


# Warnings about strains and tables beyond their ranges.

SOFT = bd.Material(E=1e7, nu=0.3, rho=1000.0)
STRIP = rectangle(0.01, 1.0, damping=0.3, material=SOFT)

LINE = bd.Line((0.0, 0.0), (1.0, 0.0))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("settings", [{"formulation": "exact"}, {"strain": "exact"}, {}])
@pytest.mark.parametrize(("strain", "is_reported"), [(-101.0, True), (0.9, True), (0.1, False)])
def test_strains_beyond_linear_elasticity_are_reported(settings, strain, is_reported):
    """A cantilever pulled to (1 + strain) of its length; at -100 m, its axis is inverted."""
    if not settings and abs(strain) > 1.0:
        settings = {"strain": "linear"}
    mech, beam = clamped_beam(STRIP, 2, LINE, name="bar", **settings)
    mech.add(bd.Force("pull", beam.end, (strain * STRIP.EA, 0.0)))
    result = bd.equilibrium(mech)
    sentences = [x for x in result.warnings if "linear elasticity" in x]
    assert bool(sentences) == is_reported
    assert all(x.startswith("bar: the largest strain is") for x in sentences)
    if strain == 0.9 or settings.get("strain") == "linear":
        return
    mech.start = "equilibrium"
    run = bd.simulate(mech, bd.Radau(1e-4), 1e-5)
    assert any("linear elasticity" in x for x in run.warnings) == is_reported
    if settings.get("formulation") == "exact":
        (sentence,) = sentences or ("strain is 0.1,",)
        assert float(sentence.split("strain is ")[1].split(",")[0]) == pytest.approx(abs(strain))


@pytest.mark.parametrize(
    ("modulus", "strain"), [(2.1e11, 0.03), (7e10, 0.03), (1e10, 0.03), (1e9, 0.6)]
)
def test_regression_stiff_materials_are_not_strained_by_several_percent(modulus, strain):
    """Steel at 44 GPa, and a steel rod at five times the Euler load, 2 % strain, were silent."""
    section = rectangle(0.001, 0.01, material=bd.Material(modulus, 0.3, 7850.0))
    for factor, is_reported in ((1.0, True), (0.5, False)):
        mech, beam = clamped_beam(section, 2, LINE, name="leaf", formulation="exact")
        mech.add(bd.Force("pull", beam.end, (factor * strain * section.EA, 0.0)))
        sentences = [x for x in bd.equilibrium(mech).warnings if "linear elasticity" in x]
        assert bool(sentences) == is_reported


@pytest.mark.parametrize("height", [0.001, 0.02])
@pytest.mark.parametrize("profile", ["rectangle", "i_profile"])
def test_a_yield_stress_is_the_limit_of_linear_elasticity(profile, height):
    steel = bd.Material(2.1e11, 0.3, 7850.0, yield_stress=250e6)
    more = {"flange": 0.1 * height, "web": 1e-3} if profile == "i_profile" else {}
    section = getattr(bd.Section, profile)(steel, width=0.01, height=height, **more)
    for utilization in (0.98, 1.02):
        mech, beam = clamped_beam(section, 2, LINE, name="leaf")
        moment = utilization * steel.yield_stress * section.EI / (0.5 * height * steel.E)
        mech.add(bd.Moment("bend", beam.end, moment))
        path = bd.equilibrium(mech)
        sentences = [x for x in path.warnings if "yield stress" in x]
        assert bool(sentences) == (utilization > 1.0)
        assert (path.section_forces(beam).safety().factor < 1.0) == bool(sentences)
        assert all(x.startswith("leaf: the largest stress is 2.55e+08 Pa, ") for x in sentences)


LEFT = "where its value is held"


def falling(rows, values, argument=lambda point, t: point.position[1], kind="linear"):
    """Return a ball that falls from 1 m with a force from a table."""
    table = bd.table(rows, values, kind=kind, name="curve")
    mech, ball = free_ball((0.0, 1.0), gravity=9.81)
    mech.add(bd.ForceLaw("pull", ball.point, lambda x, t: (0.0, table(argument(x, t)))))
    return mech


def turning(rows, values, outside="hold", unit=1.0):
    """Return a disk that turns twice with a torque from a table of its angle, times `unit`."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0, (0.0, 0.0), angular_velocity=4.0 * np.pi))
    center = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), center))
    table = bd.table(rows, values, "pchip", outside)
    mech.add(bd.ForceLaw("load", center, lambda disk, t: (0, 0, table(unit * disk.angle))))
    return mech


TURN, LOAD = np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), [0.0, 0.0, -1.0, 0.0, 0.0]

# Model, end of the run, and words of the warning, or "".
CASES = {
    "left": (falling([0.5, 1.5], [-3.0, 3.0]), 0.9, LEFT),
    "left, nearly constant": (falling([0.5, 1.0, 1.5], [2.0, 2.001, 3.0]), 0.6, LEFT),
    "left at both sides": (falling([0.9, 0.95], [1.0, 2.0]), 0.2, LEFT),
    "zero at the end": (falling([0.5, 1.0, 1.5], [0.0, 3.0, 3.0]), 0.9, ""),
    "constant at the end": (falling([0.5, 1.0, 1.5], [2.0, 2.0, 3.0]), 0.9, ""),
    "rounding": (falling([0.5, 1.0, 1.5], [0.1 + 0.2, 0.3, 3.0]), 0.6, ""),
    "rounding of zero": (falling([0.5, 1.0, 1.5], [1e-16, 1.0, 3.0]), 0.6, ""),
    "over time": (falling([0.0, 0.1], [0.0, 3.0], lambda point, t: t), 0.3, ""),
    "inside": (falling([-1.0, 0.0, 1.0, 2.0], [1.0, 2.0, 1.0, 3.0]), 0.3, ""),
    "repeated turn": (turning(TURN, LOAD, "repeat"), 1.0, ""),
    "stop of a turn": (turning(TURN, [0.0, 0.0, 0.0, -1.0, -1.0]), 1.0, ""),
    "part of a turn": (turning(0.9 * TURN, LOAD), 1.0, ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "t_end", "words"), CASES.values(), ids=CASES.keys())
def test_arguments_that_leave_a_table_have_a_warning(mech, t_end, words):
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=t_end)
    found = [x for x in run.warnings if LEFT in x]
    assert len(found) == bool(words)


def test_warnings_name_the_argument():
    (left,) = bd.simulate(falling([0.5, 1.5], [-3.0, 3.0]), t_end=0.9).warnings
    assert left.startswith("pull: x = -3.")
    assert "leaves the range 0.5 to 1.5 of curve at t = 0.9 s, where its value is held" in left
