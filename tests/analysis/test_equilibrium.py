"""Equilibria against closed-form solutions, load stages, and rejected arguments."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import EARTH, free_ball, symbols
from numpy.testing import assert_allclose

import beamdae as bd


def pendulum(gravity=(0.0, -9.81), hinged=True):
    mech = bd.Mechanism(gravity=gravity)
    body = mech.add(bd.RigidBody("bob", 2.0, 0.1, (1.0, 0.0)))
    if hinged:
        mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    return mech


def test_pendulum_hangs_down_under_its_weight():
    path = bd.equilibrium(pendulum())
    assert path.status.success
    assert path.stable
    assert path.loads == (("gravity",),)
    assert_allclose(path.q[-1], [0.0, -1.0, -0.5 * np.pi], atol=1e-9)
    assert_allclose(path.lam[-1], [0.0, -2.0 * 9.81], atol=1e-8)


def hanging_mass(force, counterforce=None):
    """Return a mass on a rigid rod of length 1 that hangs straight down, without gravity."""
    mech, mass = free_ball((0.0, -1.0), name="bob")
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), mass.point))
    mech.add(bd.Force("pull", mass.point, force))
    if counterforce is not None:
        mech.add(bd.Force("counter", mass.point, counterforce))
    return mech


def test_reactions_balance_the_loads_where_the_drawing_is_an_equilibrium():
    # Only the reaction of 5 N makes the rod resist sideways motion.
    path = bd.equilibrium(hanging_mass((0.0, -5.0)))
    assert path.lam[-1] == pytest.approx([-5.0])
    assert path.stable
    assert not path.free


def test_path_begins_in_equilibrium_where_only_the_full_load_balances():
    # Without "counter", the rod takes the direction of (5, -5) N; with it, that of (0, -5) N.
    path = bd.equilibrium(hanging_mass((5.0, -5.0), (-5.0, 0.0)), loads=["counter"])
    assert path.status.success
    assert_allclose(path.q[0], [np.sqrt(0.5), -np.sqrt(0.5)], atol=1e-9)
    assert_allclose(path.q[-1], [0.0, -1.0], atol=1e-9)
    assert path.lam[-1] == pytest.approx([-5.0])


@pytest.mark.slow(reason="a quarter of a second")
def test_motion_without_stiffness_is_named():
    with pytest.warns(
        bd.BeamdaeWarning, match=r"bob\.angle: this coordinate can move without stiff"
    ):
        rest = bd.equilibrium(pendulum(gravity=(0.0, 0.0)))
    assert rest.status.success
    assert rest.loads == ()
    with pytest.warns(bd.BeamdaeWarning, match=r"bob\.y: no equilibrium .* factor: 0"):
        falling = bd.equilibrium(pendulum(hinged=False))
    assert falling.status.kind == "failed"
    assert len(falling.q) == 1
    mech = pendulum()
    mech.observe("bob", mech.parts["bob"].at(1.0, 0.0))
    with pytest.warns(bd.BeamdaeWarning, match="check that the loads move the prescribed column"):
        assert len(bd.equilibrium(mech, to={"bob.y": -0.5}).q) == 1


def slide_on_rail(*load):
    """Return a slide that moves freely along x, and a load at a place on it."""
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("slide", 1.0, 0.1, (0.3, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), slide.at(0.0, 0.0)))
    mech.add(bd.Force("load", slide.at(0.3, 0.0), load))
    mech.observe("slide", slide.at(0.3, 0.0))
    return mech, slide


def test_start_chooses_a_position_that_no_load_determines():
    mech, _ = slide_on_rail(0.0, -3.0)
    with pytest.warns(bd.BeamdaeWarning, match="check that the loads move the prescribed"):
        assert not bd.equilibrium(mech, to={"slide.x": 0.5}).status.success
    with pytest.warns(
        bd.BeamdaeWarning, match=r"depends on the start; .* start={'slide\.x': \.\.\.}\.$"
    ):
        path = bd.equilibrium(mech, start={"slide.x": 0.5})
    assert_allclose(path["slide.x"], 0.5, rtol=1e-12)


@pytest.mark.parametrize("x", [0.401, 0.405, 0.41, 0.395])
def test_displacements_are_prescribed_beyond_a_free_motion(x):
    """A mechanism that is free to move without load had no path to a displacement."""
    mech, slide = slide_on_rail(10.0, 0.0)
    stop = bd.LineSurface(mech.ground.at(0.4, 0.0), (0.0, 1.0))
    mech.add(bd.Contact("stop", slide.at(0.3, 0.0), stop, stiffness=1e3, exponent=1.0))
    path = bd.equilibrium(mech, to={"slide.x": x})
    assert path.status.success
    assert path["slide.x"].iloc[-1] == pytest.approx(x)
    assert path.factor == pytest.approx(1e3 * max(x - 0.4, 0.0) / 10.0, rel=1e-6)


def mass_on_bushing():
    """Return a mass on a bushing under its weight, a force and a moment."""
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    mass = mech.add(bd.RigidBody("mass", 3.0, 1.0, (0.0, 0.0)))
    mech.add(
        bd.Bushing(
            "stay", mech.ground.at(0.0, 0.0), mass.at(0.0, 0.0), kx=100.0, ky=50.0, ktheta=5.0
        )
    )
    mech.add(bd.Force("push", mass.at(0.0, 0.0), (20.0, 0.0)))
    mech.add(bd.Moment("turn", mass.at(0.0, 0.0), lambda t: 1.0 + t))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_loads_scale_by_name_and_in_stages():
    x, y, angle = 0.2, -0.6, 0.2
    all_loads = bd.equilibrium(mass_on_bushing(), to=0.5)
    assert all_loads.loads == (("push", "turn", "gravity"),)
    assert_allclose(all_loads.q[-1], [0.5 * x, 0.5 * y, 0.5 * angle], rtol=1e-9)
    push = bd.equilibrium(mass_on_bushing(), loads=["push"], to=[0.5, -2.0])
    assert_allclose(push.q[0], [0.0, y, angle], rtol=1e-9, atol=1e-12)
    assert_allclose(push.q[-1], [-2.0 * x, y, angle], rtol=1e-9)
    assert 0.5 in push.factors
    staged = bd.equilibrium(mass_on_bushing(), loads=[["gravity"], ["push", "turn"]], to=2.0)
    assert staged.factors.shape[1] == 2
    assert_allclose(staged.factors[-1], [1.0, 2.0])
    assert_allclose(staged.q[-1], [2.0 * x, y, 2.0 * angle], rtol=1e-9)
    (second_stage,) = (staged.factors[:, 0] == 1.0).nonzero()[0][:1]
    assert_allclose(staged.q[second_stage], [0.0, y, 0.0], rtol=1e-9, atol=1e-12)
    assert list(staged.table())[:2] == ["load factor [-]", "load factor 2 [-]"]
    later = bd.equilibrium(mass_on_bushing(), t=1.0)
    assert later.q[-1, 2] == pytest.approx(2.0 * angle, rel=1e-9)


def test_start_in_equilibrium_is_the_same_state():
    rest = bd.equilibrium(mass_on_bushing())
    equations = bd.equations_of_motion(mass_on_bushing(), start="equilibrium")
    assert_allclose(equations.q0, rest.q[-1], rtol=1e-9)
    mech = bd.Mechanism(start=rest.positions)
    assert mech.start == rest.positions
    run = bd.simulate(mass_on_bushing(), bd.Radau(1e-6), 0.01, start=rest)
    assert_allclose(run.q, np.tile(rest.q[-1], (len(run.q), 1)), rtol=1e-2)
    assert_allclose(run.q[0], rest.q[-1], rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e10])
def test_regression_stiff_contacts_at_several_points_carry_a_body(stiffness, exponent):
    """Steps into the contacts and out of them ended with "no equilibrium was found"."""
    mech = bd.Mechanism(gravity=EARTH)
    box = mech.add(bd.RigidBody("box", 2.0, 0.1, (0.0, 0.1)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    # One foot begins 2 cm below the floor, and the other one 2 cm above.
    for name, x in (("left", -0.2), ("right", 0.3)):
        foot = box.at(x, 0.1 * x)
        contact = mech.add(bd.Contact(name, foot, floor, stiffness, exponent))
        mech.observe(name, contact.force)
    mech.add(bd.Spring("guide", mech.ground.at(-1.0, 0.1), box.at(0.0, 0.1), 10.0))
    path = bd.equilibrium(mech)
    assert path.status.success
    forces = [np.asarray(path[f"{name}.N"])[-1] for name in ("left", "right")]
    # Distances of the feet from the center of mass, along the line through them, which is level.
    left, right = (np.dot([x, 0.1 * x - 0.1], [1.0, 0.1]) for x in (-0.2, 0.3))
    share = right / (right - left)
    # At the lowest stiffness, penetrations change the inclination by 1e-5.
    assert_allclose(forces, 2.0 * 9.81 * np.array([share, 1.0 - share]), rtol=1e-4)


def test_friction_is_zero_at_rest_with_a_warning():
    mech = bd.Mechanism()
    block = mech.add(bd.RigidBody("block", 1.0, 1.0, (0.0, 0.0)))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0, 0), block.at(0, 0), (1.0, 0.0)))
    mech.add(bd.Friction("rub", guide, 0.5, 1e-3, radius=0.1))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), block.at(0, 0), stiffness=100.0))
    mech.add(bd.Force("press", block.at(0, 0), (1.0, -100.0)))
    with pytest.warns(
        bd.BeamdaeWarning, match="friction depends on the sliding velocity and is zero at rest"
    ):
        rest = bd.equilibrium(mech)
    assert rest.q[-1, 0] == pytest.approx(0.01, rel=1e-9)


def test_drivers_act_and_inactive_parts_do_not():
    mech = mass_on_bushing()
    mech.deactivate(mech.parts["push"])
    mech.add(bd.Driver("turned", mech.ground.at(0, 0), mech.parts["mass"].at(0, 0), lambda t: t))
    rest = bd.equilibrium(mech, t=0.3)
    assert rest.loads == (("turn", "gravity"),)
    assert_allclose(rest.q[-1], [0.0, -0.6, 0.3], atol=1e-12)
    assert rest.lam[-1, 0] == pytest.approx(1.3 - 5.0 * 0.3)


def test_redundant_joints_share_reactions_of_minimum_norm():
    mech = bd.Mechanism(gravity=(0.0, -10.0), redundant="minimum norm")
    bar = mech.add(bd.RigidBody("bar", 2.0, 1.0, (0.0, 0.0)))
    mech.add(bd.Weld("left", mech.ground.at(-1.0, 0.0), bar.at(-1.0, 0.0)))
    mech.add(bd.Weld("right", mech.ground.at(1.0, 0.0), bar.at(1.0, 0.0)))
    rest = bd.equilibrium(mech)
    assert_allclose(rest.lam[-1, [1, 4]], rest.lam[-1, 1], rtol=1e-9)
    assert abs(rest.lam[-1, 1]) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"loads": ["puhs"]},
            "loads contain 'puhs', but no part has this name .did you mean 'push'",
        ),
        (
            {"loads": ["mass"]},
            "loads must name parts that only apply forces, but mass is a RigidBody",
        ),
        ({"loads": ["push", "push"]}, "loads contain 'push' more than once"),
        ({"loads": [["push"], []]}, "loads must not contain an empty stage"),
        ({"loads": 3}, "loads must be names of loads"),
        ({"to": {}}, "to must be a load factor, a list of load factors, or one observed position"),
        ({"to": []}, "to must contain at least one number"),
        (
            {"to": {"mass.x": 1.0}},
            "got 'mass.x'; observe this position, or name an observed one .observed: none",
        ),
        ({"control": "displacement"}, "use control='load'"),
        ({"control": "load", "switch": 1}, "use control='arc length'"),
        ({"control": "lode"}, "did you mean 'load'"),
        ({"switch": 0.5}, "switch must be a whole number"),
        ({"start": "anywhere"}, "or another equilibrium"),
        ({"max_points": 1}, "max_points must be a whole number of at least 2"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equilibrium(mass_on_bushing(), **arguments)


def test_nonholonomic_constraints_are_rejected():
    mech = bd.Mechanism()
    sled = mech.add(bd.RigidBody("sled", 1.0, 1.0, (0.0, 0.0)))
    mech.add(bd.Skate("blade", sled.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Force("push", sled.at(0.0, 0.0), (1.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match=r"blade.*this constraint acts on velocities only"):
        bd.equilibrium(mech)


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_free_coordinates_belong_to_rows():
    # The load at the hinge does not resist the rotation.
    mech = pendulum(gravity=(0.0, 0.0))
    mech.add(bd.Force("pull", mech.parts["bob"].at(0.0, 0.0), (0.0, -1.0)))
    path = bd.equilibrium(mech, to=[0.5, 1.0])
    assert path.free_coordinates == ("bob.angle",) * len(path.q)
    held = replace(path, free_coordinates=("",) * (len(path.q) - 1) + ("bob.angle",))
    assert held.free == "bob.angle"
    assert not held.stable
    assert held.at(1).free == ""
    assert held.at(1).stable
    assert held.at(1).warnings == ()


def test_regression_equilibria_with_drivers_need_no_inertia():
    """The search for turning drivers required the accelerations of a massless coordinate."""
    import casadi as ca

    t, q, v = symbols(2)
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[2.0, 0.0],
        force=ca.vertcat(0.0, -100.0 * (q[1] - q[0])),
        constraints=q[0] - 20.0 * t,
        q0=[0.0, 0.0],
        v0=[0.0, 0.0],
    )
    assert_allclose(bd.equilibrium(system).q[-1], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("stiffness", "exponent"), [(1e3, 1.0), (1e5, 1.0), (1e6, 1.5), (1e9, 1.5)]
)
def test_regression_loads_reverse_where_a_snapping_truss_meets_a_stop(stiffness, exponent):
    """Arc length failed at the corner, or called it a branch point."""
    spring, width, height, stop = 1000.0, 1.0, 0.2, -0.1
    mech, mass = free_ball((0.0, height), name="mass")
    for side in (-width, width):
        foot = mech.ground.at(side, 0.0)
        mech.add(bd.Spring(f"spring at {side:g}", foot, mass.point, stiffness=spring))
    surface = bd.LineSurface(mech.ground.at(0.0, stop))
    mech.add(bd.Contact("stop", mass.point, surface, stiffness, exponent))
    mech.add(bd.Force("load", mass.point, (0.0, -1.0)))

    def load(y):
        stretch = 1.0 - np.hypot(width, height) / np.hypot(width, y)
        return -2.0 * spring * stretch * y

    path = bd.equilibrium(mech, to=4.5, control="arc length")
    assert path.status.success
    assert [x.kind for x in path.critical] == ["limit point", "limit point"]
    peak = max(load(np.linspace(0.0, height, 100_001)))
    assert [x.factor for x in path.critical] == pytest.approx([peak, load(stop)], rel=1e-4)
    assert path.stable


def test_regression_positions_that_a_driver_prescribes_are_refused_with_the_time_as_remedy():
    """The message advised a load, although a driver moves the mechanism."""
    mech, slider = free_ball((1.0, 0.0), name="slider")
    law = bd.run_up(speed=0.1, duration=1.0)
    mech.add(bd.TranslationalDriver("drive", mech.ground.at(0.0, 0.0), slider.point, law))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), slider.point))
    with pytest.raises(
        bd.BeamdaeError, match=r"if a driver moves the mechanism, set t= to the time"
    ):
        bd.equilibrium(mech, to={"slider.x": 1.05})


def test_a_load_that_no_spring_carries_ends_a_path_of_a_free_mass():
    """The force of the spring is largest, 4.29 N, at y = 0.707 m; nothing resists along x."""
    mech, bob = free_ball(name="bob")

    def soften(a, t):
        return 0.0, -10.0 * a.position[1] * np.exp(-(a.position[1] ** 2))

    mech.add(bd.ForceLaw("spring", bob.point, soften))
    mech.add(bd.Force("pull", bob.point, (0.0, 10.0)))
    with pytest.warns(bd.BeamdaeWarning):
        path = bd.equilibrium(mech, loads="pull")
    assert not path.status.success
    assert_allclose(path.factor, np.sqrt(0.5 / np.e), rtol=1e-4)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_mass_that_hangs_on_a_spring_is_stable(angle):
    """Without load, it swings freely; the stretched spring is stiff sideways."""
    length, mass, stiffness = 0.5, 2.0, 300.0
    at = length * np.array([np.sin(angle), -np.cos(angle)])
    mech, _bob = free_ball(tuple(at), mass=mass, name="bob", gravity=9.81, spring=(stiffness,))
    path = bd.equilibrium(mech)
    assert (path.status.success, path.stable, path.warnings) == (True, True, ())
    assert_allclose(path["bob.x"].iloc[-1], 0.0, atol=1e-9)
    assert_allclose(path["bob.y"].iloc[-1], -length - mass * 9.81 / stiffness, rtol=1e-12)
