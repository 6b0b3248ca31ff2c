"""Equilibria against closed forms: limit points, branch points, flutter, and what has none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd

STIFFNESS, RISE = 1000.0, 0.2


def truss(load=1.0, damping=0.0):
    """Von Mises' truss: two springs from (-1, 0) and (1, 0) to a crown."""
    mech = bd.Mechanism()
    crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, RISE)))
    for name, x in (("left", -1.0), ("right", 1.0)):
        foot = mech.ground.at(x, 0.0)
        mech.add(bd.SpringDamper(name, foot, crown.point, stiffness=STIFFNESS, damping=damping))
    mech.add(bd.Force("press", crown.point, (0.0, -load)))
    mech.observe("crown", crown.point)
    return mech


def truss_load(y):
    """2 k (L0 - L) y / L."""
    drawn, length = np.hypot(1.0, RISE), np.hypot(1.0, y)
    return 2.0 * STIFFNESS * (drawn - length) * y / length


# d/dy of it is zero where L^3 = L0.
HEIGHT = np.sqrt(np.hypot(1.0, RISE) ** (2.0 / 3.0) - 1.0)
LIMIT = truss_load(HEIGHT)


def test_a_truss_is_followed_through_both_of_its_limit_loads():
    for control in ("displacement", "arc length"):
        path = bd.equilibrium(truss(), to={"crown.y": -0.25}, control=control)
        assert path.status.success
        kinds, rows, factors, moves = zip(*path.critical, strict=True)
        assert kinds == ("limit point",) * 2
        assert moves == ("crown.y",) * 2
        # Rounding of the interpolation at a limit point.
        assert_allclose(factors, [LIMIT, -LIMIT], rtol=1e-11)
        y = path.columns["crown.y [m]"]
        assert_allclose(y[list(rows)], [HEIGHT, -HEIGHT], rtol=1e-7)
        assert_allclose(path.factors[:, 0], truss_load(y), rtol=1e-9, atol=1e-9)
        assert y[-1] == pytest.approx(-0.25, abs=1e-14)
        between = (np.abs(y) < 0.999 * HEIGHT).nonzero()[0]
        assert np.all(path.unstable[between] == 1)
        assert np.all(path.unstable[: rows[0]] == 0)
        assert path.stable


def test_a_load_beyond_the_limit_is_not_reached_and_the_path_is_kept():
    with pytest.warns(bd.BeamdaeWarning, match=r"the last load factor .* is 3\.019"):
        path = bd.equilibrium(truss(), to=4.0)
    assert path.status.kind == "failed"
    assert "crown.y has lost" in path.status.sentence
    assert "control='arc length' goes on" in path.status.sentence
    # Cut back to a millionth of a step.
    assert path.factor == pytest.approx(LIMIT, rel=1e-6)
    assert np.all(np.diff(path.factors[:, 0]) > 0.0)


def test_the_dynamics_jump_from_the_limit_point_to_the_other_side():
    path = bd.equilibrium(truss(load=LIMIT), to={"crown.y": 0.05})
    begin = path.at(path.critical[0].row)
    run = bd.simulate(truss(1.001 * LIMIT, damping=60.0), bd.Radau(1e-6), 20.0, start=begin)
    assert run.columns["crown.y [m]"][0] == pytest.approx(HEIGHT, rel=1e-7)
    below = bd.equilibrium(truss(1.001 * LIMIT), to=1.0, start={"crown.y": -0.3})
    assert below.stable
    assert run.q[-1] == pytest.approx(below.q[-1], abs=1e-6)
    assert truss_load(below.q[-1][1]) == pytest.approx(1.001 * LIMIT, rel=1e-9)


def link(stiffness=10.0, length=2.0):
    """A rigid column on a torsion spring; P = k / L holds it straight."""
    mech = bd.Mechanism()
    foot, top = mech.ground.at(0.0, 0.0), (0.0, length)
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, (0.0, 0.5 * length)))
    mech.add(bd.Revolute("hinge", foot, bar.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("spring", foot, bar.at(0.0, 0.0), stiffness))
    mech.add(bd.Force("press", bar.at(*top), (0.0, -stiffness / length)))
    mech.observe("top", bar.at(*top))
    return mech


@pytest.mark.parametrize("side", [1, -1])
def test_a_column_leaves_its_straight_path_at_the_branch_point(side):
    path = bd.equilibrium(link(), to=1.3, switch=side)
    (branch,) = path.critical
    assert branch[0] == "branch point"
    assert branch.factor == pytest.approx(1.0, abs=1e-10)
    bent = slice(branch.row + 1, None)
    angle = path.columns["top.angle [rad]"]
    assert_allclose(path.factors[bent, 0], angle[bent] / np.sin(angle[bent]), rtol=1e-9)
    assert np.all(path.unstable[bent] == 0)
    assert np.sign(angle[-1]) == side * np.sign(bd.equilibrium(link(), to=1.3, switch=1).q[-1, 2])


def test_the_straight_path_goes_on_unstable():
    path = bd.equilibrium(link(), to=[1.3, 0.5])
    assert [one.kind for one in path.critical] == ["branch point"] * 2
    assert set(path.unstable[path.factors[:, 0] > 1.01]) == {1}
    assert path.stable


def ziegler(load):
    """Ziegler's double pendulum with masses 2 m and m under a follower load, k = l = m = 1."""
    mech = bd.Mechanism()
    foot = mech.ground.at(0.0, 0.0)
    # Bars without a mass of their own that would count.
    lower = mech.add(bd.RigidBody("lower", 2.0, 1e-9, (0.0, 1.0)))
    upper = mech.add(bd.RigidBody("upper", 1.0, 1e-9, (0.0, 2.0)))
    mech.add(bd.Revolute("foot", foot, lower.at(0.0, 0.0)))
    mech.add(bd.Revolute("knee", lower.at(0.0, 1.0), upper.at(0.0, 1.0)))
    mech.add(bd.TorsionSpring("first", foot, lower.at(0.0, 0.0), 1.0))
    mech.add(bd.TorsionSpring("second", lower.at(0.0, 1.0), upper.at(0.0, 1.0), 1.0))
    mech.add(bd.Force("follower", upper.at(0.0, 2.0), (0.0, -load), axes="body"))
    return mech


def test_a_follower_load_flutters_where_ziegler_says():
    # Ziegler, Ing.-Arch. 20 (1952) 49: P l / k = 7/2 - sqrt(2).
    path = bd.equilibrium(ziegler(1.0), to=3.0)
    (flutter,) = path.critical
    assert flutter.kind == "flutter point"
    # Where eigenvalues meet their difference is a root: a millionth of a step is found.
    assert flutter.factor == pytest.approx(3.5 - np.sqrt(2.0), abs=1e-5)
    assert path.unstable[-1] == 2


def bob(gravity=(0.0, -9.81), held=True):
    mech = bd.Mechanism(gravity=gravity)
    body = mech.add(bd.RigidBody("bob", 2.0, 0.1, (1.0, 0.0)))
    if held:
        mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    return mech


def test_a_pendulum_is_let_down_by_its_weight():
    path = bd.equilibrium(bob())
    assert path.status.success
    assert path.stable
    assert path.loads == (("gravity",),)
    assert_allclose(path.q[-1], [0.0, -1.0, -0.5 * np.pi], atol=1e-9)
    assert_allclose(path.lam[-1], [0.0, -2.0 * 9.81], atol=1e-8)


def test_what_is_free_to_move_without_stiffness_is_named():
    with pytest.warns(bd.BeamdaeWarning, match=r"bob\.angle: it is free to move without stiff"):
        rest = bd.equilibrium(bob(gravity=(0.0, 0.0)))
    assert rest.status.success
    assert rest.loads == ()
    with pytest.warns(bd.BeamdaeWarning, match=r"bob\.y: no equilibrium .* factor .* is 0"):
        falling = bd.equilibrium(bob(held=False))
    assert falling.status.kind == "failed"
    assert len(falling.q) == 1
    mech = bob()
    mech.observe("bob", mech.parts["bob"].at(1.0, 0.0))
    with pytest.warns(bd.BeamdaeWarning, match=r"bob\.angle is free to move without stiffness"):
        assert len(bd.equilibrium(mech, to={"bob.y": -0.5}).q) == 1


def hung():
    """A mass on two springs under its weight and two pushes."""
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


def test_loads_are_scaled_by_name_and_in_stages():
    x, y, angle = 0.2, -0.6, 0.2
    whole = bd.equilibrium(hung(), to=0.5)
    assert whole.loads == (("push", "turn", "gravity"),)
    assert_allclose(whole.q[-1], [0.5 * x, 0.5 * y, 0.5 * angle], rtol=1e-9)
    one = bd.equilibrium(hung(), loads=["push"], to=[0.5, -2.0])
    assert_allclose(one.q[0], [0.0, y, angle], rtol=1e-9, atol=1e-12)
    assert_allclose(one.q[-1], [-2.0 * x, y, angle], rtol=1e-9)
    assert 0.5 in one.factors
    staged = bd.equilibrium(hung(), loads=[["gravity"], ["push", "turn"]], to=2.0)
    assert staged.factors.shape[1] == 2
    assert_allclose(staged.factors[-1], [1.0, 2.0])
    assert_allclose(staged.q[-1], [2.0 * x, y, 2.0 * angle], rtol=1e-9)
    (turning,) = (staged.factors[:, 0] == 1.0).nonzero()[0][:1]
    assert_allclose(staged.q[turning], [0.0, y, 0.0], rtol=1e-9, atol=1e-12)
    assert list(staged.table())[:2] == ["load factor [-]", "load factor 2 [-]"]
    later = bd.equilibrium(hung(), t=1.0)
    assert later.q[-1, 2] == pytest.approx(2.0 * angle, rel=1e-9)


def test_the_start_in_equilibrium_is_the_same():
    found = bd.equilibrium(hung())
    equations = bd.equations_of_motion(hung(), start="equilibrium")
    assert_allclose(equations.q0, found.q[-1], rtol=1e-9)
    named = bd.Mechanism(start=found.positions)
    assert named.start == found.positions
    run = bd.simulate(hung(), bd.Radau(1e-6), 0.01, start=found)
    assert_allclose(run.q, np.tile(found.q[-1], (len(run.q), 1)), rtol=1e-2)
    assert_allclose(run.q[0], found.q[-1], rtol=1e-12)


def test_contact_carries_what_presses():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("ball", 1.0, 1.0, (0.0, 0.0)))
    ball, foot = body.at(0.0, 0.0), mech.ground.at(0.0, 0.0)
    contact = mech.add(bd.Contact("floor", ball, bd.LineSurface(foot), stiffness=1e6))
    mech.add(bd.Bushing("guide", foot, ball, kx=100.0, ktheta=1.0))
    mech.add(bd.Force("press", ball, (1.0, -50.0)))
    mech.observe("ball", ball)
    mech.observe("floor", contact.force)
    path = bd.equilibrium(mech)
    assert path.status.success
    assert path.stable
    assert path.columns["ball.x [m]"][-1] == pytest.approx(0.01, rel=1e-9)
    normal = [x for name, x in path.columns.items() if name.startswith("floor")]
    assert max(abs(x[-1]) for x in normal) == pytest.approx(50.0, rel=1e-9)


def test_friction_holds_nothing_at_rest_and_that_is_said():
    mech = bd.Mechanism()
    block = mech.add(bd.RigidBody("block", 1.0, 1.0, (0.0, 0.0)))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0, 0), block.at(0, 0), (1.0, 0.0)))
    mech.add(bd.Friction("rub", guide, 0.5, 1e-3, radius=0.1))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), block.at(0, 0), stiffness=100.0))
    mech.add(bd.Force("press", block.at(0, 0), (1.0, -100.0)))
    with pytest.warns(bd.BeamdaeWarning, match="friction follows the speed of sliding"):
        found = bd.equilibrium(mech)
    assert found.q[-1, 0] == pytest.approx(0.01, rel=1e-9)


def test_drivers_hold_and_inactive_parts_do_not():
    mech = hung()
    mech.deactivate(mech.parts["push"])
    mech.add(bd.Driver("turned", mech.ground.at(0, 0), mech.parts["mass"].at(0, 0), lambda t: t))
    found = bd.equilibrium(mech, t=0.3)
    assert found.loads == (("turn", "gravity"),)
    assert_allclose(found.q[-1], [0.0, -0.6, 0.3], atol=1e-12)
    assert found.lam[-1, 0] == pytest.approx(1.3 - 5.0 * 0.3)


def test_redundant_joints_tell_the_least_reactions():
    mech = bd.Mechanism(gravity=(0.0, -10.0), redundant="minimum norm")
    bar = mech.add(bd.RigidBody("bar", 2.0, 1.0, (0.0, 0.0)))
    mech.add(bd.Weld("left", mech.ground.at(-1.0, 0.0), bar.at(-1.0, 0.0)))
    mech.add(bd.Weld("right", mech.ground.at(1.0, 0.0), bar.at(1.0, 0.0)))
    found = bd.equilibrium(mech)
    assert_allclose(found.lam[-1, [1, 4]], found.lam[-1, 1], rtol=1e-9)
    assert abs(found.lam[-1, 1]) == pytest.approx(10.0)


def test_a_constrained_system_is_brought_to_rest_as_it_is():
    import casadi as ca

    t, q, v = (ca.SX.sym(*x) for x in (("t",), ("q", 2), ("v", 2)))
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(0.0, -9.81),
        q0=[0.6, -0.8],
        v0=[0, 0],
        constraints=ca.dot(q, q) - 1.0,
    )
    found = bd.equilibrium(system)
    assert_allclose(found.q, [[0.0, -1.0]], atol=1e-9)
    assert found.factor == 1.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"loads": ["puhs"]}, "no part 'puhs' .did you mean 'push'"),
        ({"loads": ["mass"]}, "loads must name parts that state forces alone, mass is a RigidBody"),
        ({"loads": ["push", "push"]}, "loads must name 'push' once"),
        ({"loads": [["push"], []]}, "loads must not hold a stage without loads"),
        ({"loads": 3}, "loads must be names of loads"),
        ({"to": {}}, "to must be a load factor, several, or one observed position"),
        ({"to": []}, "to must hold at least one number"),
        ({"to": {"mass.x": 1.0}}, "no observed position 'mass.x', of none is observed"),
        ({"control": "displacement"}, "take control='load'"),
        ({"control": "load", "switch": 1}, "take control='arc length'"),
        ({"control": "lode"}, "did you mean 'load'"),
        ({"switch": 0.5}, "switch must be a whole number"),
        ({"start": "anywhere"}, "or another equilibrium"),
        ({"most_points": 1}, "most_points must be a whole number of at least 2"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(given, words):
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.equilibrium(hung(), **given)


def test_a_blade_has_no_place_to_rest():
    mech = bd.Mechanism()
    sled = mech.add(bd.RigidBody("sled", 1.0, 1.0, (0.0, 0.0)))
    mech.add(bd.Skate("blade", sled.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Force("push", sled.at(0.0, 0.0), (1.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match=r"blade.*holds velocities alone"):
        bd.equilibrium(mech)


def test_a_path_is_a_table_and_files(tmp_path):
    path = bd.equilibrium(truss(), to={"crown.y": -0.25})
    table = path.table()
    assert list(table.columns) == [
        "load factor [-]",
        "crown.x [m]",
        "crown.y [m]",
        "unstable directions [-]",
        "point",
    ]
    assert (table["point"] == "limit point").sum() == 2
    assert path.to_csv(tmp_path / "path.csv").read_text().startswith("load factor [-],crown.x [m]")
    assert '"kind": "limit point"' in (tmp_path / "path.json").read_text()
    assert len(path.coordinates()) == len(table)
    with pytest.warns(bd.BeamdaeWarning, match="ended after 3 points"):
        short = bd.equilibrium(truss(), to={"crown.y": -0.25}, most_points=3)
    assert short.status.kind == "limited"
    assert len(short.q) == 3
