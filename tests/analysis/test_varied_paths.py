"""Equilibria over the time, a driver, an input or a parameter, and drivers beside the drawing."""

import re
from itertools import pairwise

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, hinged_arch, hinged_body, rectangle, welded_frame
from numpy.testing import assert_allclose
from properties.random_frames import build_frame, check_path, draw_frame, trace
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


def assert_path(path, values, spring):
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
    assert_path(path, per_unit * path.factors[:, 0], 200.0)
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
    assert_path(path, path.factors[:, 0], 2000.0)
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
    assert_path(path, path.factors[:, 0], 2000.0)


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
    assert re.search(
        r"last converged t \[s\]: (1|0\.99).*jumps of their laws", path.status.sentence
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


# Laws that every equilibrium path obeys, on random frames and columns of any slenderness.

FORMULATIONS = [{"formulation": "exact"}, {"strain": "exact"}]
BOTH = pytest.mark.parametrize("options", FORMULATIONS, ids=["exact", "floating frame"])
CONTROLS = [{"control": "load"}, {"control": "arc length"}, {"step": 0.02}]


def portal(height=0.02, **options):
    """Return a shallow portal of 1 m whose girder snaps through."""
    section = rectangle(height)
    points = [(0.0, 0.0), (0.5, 0.1), (1.0, 0.0)]
    mech, (left, _right) = welded_frame(points, section, 4, (bd.Revolute, bd.Revolute), **options)
    mech.add(bd.Force("press", left.end, (0.0, -section.EI)))
    mech.observe("ridge", left.end)
    return mech


def pressed_column(height, elements=8, **options):
    """Return a column of 1 m under the load EI / L^2, and its flexibility in shear."""
    section = rectangle(height)
    mech, beam = clamped_beam(section, elements, (0.0, 1.0), name="column", **options)
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI)))
    mech.observe("tip", beam.end)
    return mech, section.EI * (1.0 / section.GA - 1.0 / section.EA)


def assert_same_points(one, other):
    assert [point.kind for point in one] == [point.kind for point in other]
    assert_allclose([point.factor for point in one], [point.factor for point in other], rtol=1e-8)


def count_growing_modes(mech, path, row):
    values = bd.modes(mech, n=path.q.shape[1], about=path.at(row)).eigenvalues
    growing = values[values.real > 1e-6 * np.abs(values)]
    # An oscillation is a pair of conjugate values, of which one is listed.
    return sum(2 if abs(x.imag) > 1e-6 * abs(x) else 1 for x in growing)


@pytest.mark.slow(reason="a second each")
@pytest.mark.parametrize("seed", range(12))
def test_unstable_directions_are_growing_modes_and_change_at_critical_points(seed):
    frame = draw_frame(seed)
    mech = build_frame(frame)
    path = trace(mech, frame.target, **CONTROLS[seed % 3])
    weights = {one.row: 2 if one.kind == "flutter point" else 1 for one in path.critical}
    regular = [row for row in range(len(path.q)) if row not in weights]
    for a, b in pairwise(regular):
        expected = sum(weights.get(row, 0) for row in range(a, b))
        assert abs(path.unstable[b] - path.unstable[a]) == expected
        if b == a + 2:  # the motion that becomes critical does not count
            assert path.unstable[a + 1] == min(path.unstable[a], path.unstable[b])
    for row in regular[:: len(regular) // 8 + 1]:
        assert path.unstable[row] == count_growing_modes(mech, path, row)


@pytest.mark.slow(reason="a fifth of a second each")
@BOTH
@pytest.mark.parametrize("slenderness", [1e2, 1e3, 1e4, 1e5, 1e6, 1e7])
def test_slenderness_does_not_cost_digits(slenderness, options):
    mech, shear = pressed_column(1.0 / slenderness, **options)
    path = bd.equilibrium(mech, to=30.0)
    # Force and moment of a shear-flexible column in balance: P (1 + P (1/GA - 1/EA)) = EI k^2.
    euler = np.array([0.25, 2.25]) * np.pi**2
    expected = 2.0 * euler / (1.0 + np.sqrt(1.0 + 4.0 * shear * euler))
    assert [one.kind for one in path.critical] == ["branch point"] * 2
    assert_allclose([one.factor for one in path.critical], expected, rtol=1e-6)
    assert path.unstable[-1] == 2


@BOTH
def test_long_taut_strips_are_stable(options):
    # The load stiffens each coordinate a thousandfold: determinants exceed the range of numbers.
    section = rectangle(1e-5, 0.01)
    mech, beam = clamped_beam(section, 60, name="strip", **options)
    mech.add(bd.Force("pull", beam.end, (1e-3 * section.EA, 0.0)))
    path = bd.equilibrium(mech)
    assert path.status.success
    assert not path.unstable.any()
    assert not path.critical


@pytest.mark.slow(reason="half a second each")
@BOTH
@pytest.mark.parametrize("height", [2e-2, 1e-4])
def test_critical_points_do_not_depend_on_direction_and_steps(height, options):
    mech, depth = portal(height, **options), -0.06
    there = bd.equilibrium(mech, to={"ridge.y": [depth, 0.1]})
    assert there.status.success
    count = len(there.critical) // 2
    assert count >= 2
    first, back = there.critical[:count], there.critical[count:]
    assert_same_points(first, back[::-1])
    for step in (0.01, 0.005, 0.0025):
        assert_same_points(bd.equilibrium(mech, to={"ridge.y": depth}, step=step).critical, first)
    by_arc = bd.equilibrium(mech, to={"ridge.y": depth}, control="arc length", step=0.02)
    finer = bd.equilibrium(mech, to={"ridge.y": depth}, control="arc length", step=0.01)
    assert_same_points(by_arc.critical, finer.critical)
    assert_same_points(by_arc.critical, first)


@BOTH
@pytest.mark.parametrize("control", ["load", "arc length"])
@pytest.mark.parametrize("relative", [0.0, 1e-12, -1e-12, 1e-10, -1e-10, 1e-9, -1e-9, 1e-7, -1e-7])
def test_targets_at_a_branch_point_are_reached_on_the_path(relative, control, options):
    # The straight column has its tip at x = 0, the shallow portal its ridge at x = 0.5 m.
    for mech, column, x, to in (
        (pressed_column(0.01, **options)[0], "tip.x", 0.0, 4.0),
        (portal(0.01, **options), "ridge.x", 0.5, 30.0),
    ):
        branch = bd.equilibrium(mech, to=to, control="arc length").critical[0]
        target = branch.factor * (1.0 + relative)
        path = bd.equilibrium(mech, to=[target, 1.2 * branch.factor], control=control)
        row = int(np.argmin(np.abs(path.factors[:, -1] - target)))
        assert path.factors[row, -1] == pytest.approx(target, rel=1e-11)
        assert path.status.success
        assert [one.kind for one in path.critical] == ["branch point"]
        # Rounding moves points along the mode. The crossing path is 1e-5 m away at 1e-10.
        assert_allclose(path.table()[f"{column} [m]"], x, rtol=0.0, atol=1e-6)
        assert list(np.sort(path.unstable)) == list(path.unstable)
        assert list(path.unstable[[0, -1]]) == [0, 1]


@pytest.mark.slow(reason="a second")
@BOTH
def test_machine_code_finds_the_same_path(options, monkeypatch):
    paths = []
    for native in ("off", "on"):
        monkeypatch.setenv("BEAMDAE_NATIVE", native)
        mech = portal(**options)
        paths.append(bd.equilibrium(mech, to={"ridge.y": -0.06}, control="arc length"))
    assert_same_points(paths[0].critical, paths[1].critical)
    assert_allclose(paths[0].q[-1], paths[1].q[-1], rtol=0.0, atol=1e-8)
    assert paths[0].unstable[-1] == paths[1].unstable[-1]


@pytest.mark.slow(reason="half a second each")
@BOTH
def test_steps_do_not_lead_to_neighboring_paths(options):
    # The load acts 1e-5 of the length beside the crown. The point was a branch point at 8.98758,
    # between the path and that on the other side of the gap that the asymmetry opens.
    radius = (0.25 + 0.05**2) / (2.0 * 0.05)
    angle = np.arcsin(0.5 / radius)
    arc = bd.Arc(-radius, 2.0 * radius * angle, start=(0.0, 0.0), angle=angle)
    mech = hinged_arch(arc, rectangle(0.01), at=0.5 + 1e-5, **options)
    path = bd.equilibrium(mech, to={"crown.y": -0.02}, control="arc length", step=0.01)
    assert path.status.success
    # Displacement control with small steps.
    assert [point.kind for point in path.critical] == ["limit point"]
    assert path.critical[0].factor == pytest.approx(8.97864, rel=1e-5)


# A frame that moves freely without load (67), a path that begins under load with
# large reactions (78), one on which pivots in a fixed order are unsuitable (80), and a chain with
# another equilibrium under small loads, unstable and 0.02 away (232).
@pytest.mark.slow(reason="up to three seconds each")
@pytest.mark.parametrize("seed", [67, 78, 80, 232])
def test_paths_are_reversible_and_depend_on_no_steps_units_or_axes(seed):
    departures = dict(check_path(draw_frame(seed)))
    assert departures == dict.fromkeys(departures, "")
    assert "reversed" in departures
