"""Equilibria over the time, a driver, an input or a parameter, and drivers beside the drawing."""

import numpy as np
import pytest
from mechanisms import EARTH, hinged_body, rectangle
from scipy.optimize import minimize_scalar

import beamdae as bd

TRUSS, RISE, REST = 1e4, 0.2, np.hypot(1.0, 0.2)  # N/m, m, m


@bd.model(t_end=1.0)
def pressed_truss(spring=200.0, travel=0.0):
    """Shallow truss under a slide at the depth `travel` [m] that presses through a `spring`."""
    mech = bd.Mechanism()
    crown = mech.add(bd.PointMass("crown", mass=1.0, at=(1.0, RISE)))
    mech.add(bd.Spring("left", mech.ground.at(0.0, 0.0), crown.point, TRUSS))
    mech.add(bd.Spring("right", mech.ground.at(2.0, 0.0), crown.point, TRUSS))
    slide = mech.add(bd.RigidBody("slide", mass=1.0, inertia=0.1, center=(1.0, 0.6)))
    guide = mech.ground.at(1.0, 0.6), slide.at(1.0, 0.6)
    mech.add(bd.Prismatic("guide", *guide, direction=(0.0, 1.0)))
    further = mech.input("further", unit="m")

    def law(t):
        return travel + 0.1 * t + further

    drive = mech.add(bd.TranslationalDriver("drive", *guide, law, direction=(0.0, -1.0)))
    mech.add(bd.Spring("tip", slide.at(1.0, 0.6), crown.point, spring))
    mech.observe("crown", crown.point)
    mech.observe("push", drive.drive)
    return mech


def truss_force(y):
    """Return the force that holds the crown at the height y, downwards."""
    length = np.hypot(1.0, y)
    return -2.0 * TRUSS * (length - REST) * y / length


def travel_at(y, spring):
    """Return the travel of the slide at which the crown is in equilibrium at the height y."""
    return RISE - y + truss_force(y) / spring


def check_path(path, values, spring):
    heights = path["crown.y"].to_numpy()
    # Newton's method ends at corrections of 1e-10 of the size of the mechanism.
    np.testing.assert_allclose(travel_at(heights, spring), values, atol=1e-7)
    np.testing.assert_allclose(path["push.F"], truss_force(heights), atol=1e-5)


@pytest.mark.parametrize(
    ("over", "to", "per_unit", "header"),
    [
        ("t", 5.0, 0.1, "t [s]"),
        ("drive", 0.5, 1.0, "drive [m]"),
        ("further", 0.5, 1.0, "further [m]"),
        ("travel", 0.5, 1.0, "travel [m]"),
    ],
)
def test_force_over_travel_does_not_depend_on_what_moves_the_slide(over, to, per_unit, header):
    path = bd.equilibrium(pressed_truss, over=over, to=to, control="arc length")
    assert path.status.success
    assert path.table().columns[0] == header
    check_path(path, per_unit * path.factors[:, 0], 200.0)
    limits = [point.factor * per_unit for point in path.critical[:2]]
    first = minimize_scalar(lambda y: -travel_at(y, 200.0), (0.05, 0.1, 0.15)).x
    # The extrema of the travel are symmetrical about the middle of the snap-through.
    expected = travel_at(first, 200.0), 2.0 * RISE - travel_at(first, 200.0)
    assert [point.kind for point in path.critical[:2]] == ["limit point"] * 2
    assert limits == pytest.approx(expected, abs=1e-6)


def test_a_stiff_spring_holds_the_truss_stable_past_its_largest_force():
    path = bd.equilibrium(pressed_truss(spring=2000.0), over="drive", to=0.5)
    assert path.status.success
    assert path.stable
    assert path.critical == ()
    assert np.all(path.unstable == 0)
    check_path(path, path.factors[:, 0], 2000.0)
    force = path["push.F"]
    assert force.max() > 30.0 > -30.0 > force.min()


@pytest.mark.slow(reason="several runs")
def test_a_parameter_changes_a_stiffness_along_the_path():
    mech = pressed_truss(travel=0.15)
    stiff = bd.equilibrium(pressed_truss, over="spring", to=2000.0, t=1.5, from_=400.0)
    for spring, height in zip(stiff.factors[:, 0], stiff["crown.y"], strict=True):
        assert travel_at(height, spring) == pytest.approx(0.15, abs=1e-7)
    assert mech.parts["tip"].stiffness == 200.0
    assert stiff.table().columns[0] == "spring"  # the model states no unit


@pytest.mark.parametrize(("begin", "end"), [(0.0, 2000.0), (2000.0, 0.0)])
def test_a_spring_may_begin_or_end_without_stiffness(begin, end):
    path = bd.equilibrium(pressed_truss, over="spring", from_=begin, to=end, t=1.5)
    assert path.status.success
    np.testing.assert_allclose(path.factors[:, 0], np.linspace(begin, end, 51))
    heights = path["crown.y"].to_numpy()
    np.testing.assert_allclose(
        path.factors[:, 0] * (0.15 - RISE + heights), truss_force(heights), atol=1e-5
    )


def test_a_soft_spring_ends_at_the_limit_point_with_a_remedy():
    path = bd.equilibrium(pressed_truss, over="drive", to=0.5)
    assert not path.status.success
    assert "last converged drive [m]: 0.25" in path.status.sentence
    assert "arc length" in path.status.sentence


def test_values_of_a_list_are_rows_and_from_begins_elsewhere():
    path = bd.equilibrium(
        pressed_truss(spring=2000.0), over="drive", from_=0.1, to=[0.2, 0.3], step=1.0
    )
    np.testing.assert_allclose(path.factors[:, 0], [0.1, 0.2, 0.3])
    check_path(path, path.factors[:, 0], 2000.0)


def pushed_leaf(travel, side=1.0, radius=0.008, by_law=True):
    """Leaf spring, and a cylinder on a driven slide drawn 1 mm beside its end."""
    mech = bd.Mechanism()
    leaf = rectangle(0.0003, 0.01, material=bd.Material(E=2e11, nu=0.3, rho=7800.0))
    line = bd.Line((0.0, 0.0), (0.0, 0.06))
    beam = mech.add(bd.Beam("leaf", line, leaf, elements=4, formulation="exact"))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    center = (-side * (radius + 0.001), 0.06)
    slide = mech.add(bd.RigidBody("slide", mass=0.1, inertia=1e-5, center=center))
    guide = mech.ground.at(*center), slide.at(*center)
    mech.add(bd.Prismatic("guide", *guide, direction=(1.0, 0.0)))
    law = (lambda t: 0.5 * side * travel * t) if by_law else side * travel
    mech.add(bd.TranslationalDriver("drive", *guide, law))
    cylinder = bd.CircleSurface(slide.at(*center), radius, "outside")
    touch = mech.add(bd.Contact("touch", beam.end, cylinder, stiffness=2e5, exponent=1))
    mech.observe("end", beam.end)
    mech.observe("touch", touch.force)
    return mech


def bending_force(deflection):
    return 3.0 * 2e11 * (0.01 * 0.0003**3 / 12.0) / 0.06**3 * deflection


# The travels exceed the radius or the diameter of the cylinder.
@pytest.mark.parametrize(("travel", "radius"), [(0.006, 0.008), (0.006, 0.001), (0.01, 0.004)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_driven_contacts_stay_on_their_side(travel, radius, side):
    # Deflections of 1/6 of the length raise the force by 2 % (elastica).
    expected = pytest.approx(bending_force(travel - 0.001), rel=0.03)
    at_time = bd.equilibrium(pushed_leaf(travel, side, radius), t=2.0)
    assert at_time["touch.N"].iloc[-1] == expected
    assert at_time["end.x"].iloc[-1] == pytest.approx(side * (travel - 0.001), rel=0.01)
    start = pushed_leaf(travel, side, radius, by_law=False)
    run = bd.simulate(start, bd.Radau(rtol=1e-3), t_end=1e-4, start="equilibrium")
    assert run["touch.N"].iloc[0] == pytest.approx(at_time["touch.N"].iloc[-1], rel=1e-6)
    path = bd.equilibrium(pushed_leaf(travel, side, radius), over="t", to=2.0)
    assert path["touch.N"].iloc[-1] == pytest.approx(at_time["touch.N"].iloc[-1], rel=1e-6)


def test_contacts_that_are_pressed_through_are_named():
    mech = bd.Mechanism()
    pad = mech.add(bd.RigidBody("pad", mass=0.1, inertia=1e-5, center=(0.0, 0.0)))
    rail = mech.ground.at(0.0, 0.0), pad.at(0.0, 0.0)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.1, 0.0), pad.at(0.0, 0.0), 1e4))
    slide = mech.add(bd.RigidBody("slide", mass=0.1, inertia=1e-5, center=(-0.003, 0.0)))
    guide = mech.ground.at(-0.003, 0.0), slide.at(-0.003, 0.0)
    mech.add(bd.Prismatic("guide", *guide, direction=(1.0, 0.0)))
    mech.add(bd.TranslationalDriver("drive", *guide, lambda t: 0.006 * t))
    cylinder = bd.CircleSurface(slide.at(-0.003, 0.0), 0.002, "outside")
    mech.add(bd.Contact("touch", pad.at(0.0, 0.0), cylinder, stiffness=1e2, exponent=1))
    for path in (bd.equilibrium(mech, t=1.0), bd.equilibrium(mech, over="t", to=1.0)):
        assert any("touch: the contact sinks" in sentence for sentence in path.warnings)


def slider_crank(angle):
    mech, crank = hinged_body(
        mass=1.0, inertia=0.01, center=(0.05, 0.0), name="crank", gravity=9.81
    )
    rod = mech.add(bd.RigidBody("rod", mass=1.0, inertia=0.02, center=(0.25, 0.0)))
    slider = mech.add(bd.RigidBody("slider", mass=1.0, inertia=0.01, center=(0.4, 0.0)))
    bearing = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", crank.at(0.1, 0.0), rod.at(0.1, 0.0)))
    mech.add(bd.Revolute("wrist", rod.at(0.4, 0.0), slider.at(0.4, 0.0)))
    rail = mech.ground.at(0.4, 0.0), slider.at(0.4, 0.0)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    mech.add(bd.Driver("motor", *bearing, lambda t: angle * t))
    mech.observe("slider", slider.at(0.4, 0.0))
    return mech


@pytest.mark.parametrize("angle", [2.0, -2.5, 10.0])
def test_cranks_turn_by_the_angle_of_the_driver(angle):
    path = bd.equilibrium(slider_crank(angle), t=1.0)
    reach = 0.1 * np.cos(angle) + np.sqrt(0.3**2 - (0.1 * np.sin(angle)) ** 2)
    assert path["slider.x"].iloc[-1] == pytest.approx(reach, abs=1e-9)
    assert path.positions["crank.angle"] == pytest.approx(angle, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"over": "nothing", "to": 1.0}, "use one of t, drive, further, spring, travel"),
        ({"over": "drive"}, "to must be the last value of 'drive'"),
        ({"over": "drive", "to": {"crown.y": 0.0}}, "to must be the last value of 'drive'"),
        ({"over": 3, "to": 1.0}, "over must be 't' or the name"),
        ({"over": "drive", "to": 0.1, "loads": ["tip"]}, "loads= and over= cannot be combined"),
        ({"over": "t", "to": 1.0, "control": "displacement"}, "control='displacement'"),
        ({"from_": 1.0}, "name the quantity that varies with over="),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equilibrium(pressed_truss, **arguments)


@bd.model(t_end=1.0)
def cantilever(elements=4, length=0.1):
    """Steel leaf under its weight."""
    mech = bd.Mechanism(gravity=EARTH)
    leaf = rectangle(0.0005, 0.01)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("leaf", line, leaf, elements=elements, formulation="exact"))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="several runs")
def test_lengths_vary_and_numbers_of_elements_do_not():
    path = bd.equilibrium(cantilever, over="length", to=0.5)
    single = bd.equilibrium(cantilever(length=0.5))
    assert path["tip.y"].iloc[-1] == pytest.approx(single["tip.y"].iloc[-1], abs=1e-9)
    with pytest.raises(bd.BeamdaeError, match="must name a parameter that is a decimal number"):
        bd.equilibrium(cantilever, over="elements", to=8)


def test_paths_end_where_loads_jump_with_a_remedy():
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", mass=1.0, at=(1.0, 0.0)))
    mech.add(bd.Spring("along", mech.ground.at(0.0, 0.0), mass.point, 100.0))
    mech.add(bd.Spring("across", mech.ground.at(1.0, 1.0), mass.point, 100.0))
    mech.add(bd.Force("pull", mass.point, (bd.piecewise((1.0, 0.0), 60.0), 0.0)))
    mech.observe("mass", mass.point)
    path = bd.equilibrium(mech, over="t", to=2.0)
    assert "the loads jump at t = 1 s, so begin another path there with from_=" in (
        path.status.sentence
    )
    after = bd.equilibrium(mech, over="t", from_=1.0, to=2.0, start=path)
    assert after.status.success
    assert after["mass.x"].iloc[-1] > 1.5


def test_pictures_show_what_varies_over_the_quantity():
    """The picture without names showed the driven value over itself."""
    path = bd.equilibrium(pressed_truss(spring=2000.0), over="drive", to=0.3)
    axes = path.plot().figure.axes
    assert {axis.get_xlabel() for axis in axes} == {"drive [m]"}
    assert [axis.get_ylabel() for axis in axes] == ["crown.y [m]", "push.F [N]"]
