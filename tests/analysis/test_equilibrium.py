"""Equilibria against closed forms: loads, joints and laws, and what has none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd


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


def test_modes_are_about_the_end_of_a_path():
    def heavy(load):
        mech = hung()
        mech.add(bd.Force("pull", mech.parts["mass"].at(0.3, 0.0), (load, 0.0)))
        return mech

    path = bd.equilibrium(heavy(5.0))
    own, found = (bd.modes(heavy(5.0), about=about) for about in (path, "equilibrium"))
    assert not own.warnings
    assert_allclose(own.eigenvalues, found.eigenvalues, rtol=1e-9)
    # The pull stiffens the turn: frequencies are not those of the drawing.
    assert abs(own.eigenvalues[0]) > 1.02 * abs(bd.modes(hung()).eigenvalues[0])
    half = bd.equilibrium(heavy(5.0), loads=["pull"], to=0.5)
    own, found = bd.modes(heavy(5.0), about=half), bd.modes(heavy(2.5), about="equilibrium")
    assert_allclose(own.eigenvalues, found.eigenvalues, rtol=1e-9)
