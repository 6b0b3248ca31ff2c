"""Events that switch joints and forces: against closed forms, with the books closed."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import integrators
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.symbolic.statements import Named, Quantity

RUNS = integrators(1e-7, 2e-4)
SPEED, INERTIA = 2.0, 0.3


def spinning(**bar):
    """A bar that spins about its center, which a hinge holds."""
    mech = bd.Mechanism()
    bar = {"mass": 1.0, "inertia": INERTIA, "angular_velocity": SPEED} | bar
    bar = mech.add(bd.RigidBody("bar", **bar))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    mech.observe("bar", bar.at(0.0, 0.0))
    return mech, bar


@RUNS
def test_a_bob_that_is_released_flies_on(integrator):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass=2.0, inertia=0.1, center=(1.0, 0.0)))
    string = mech.add(bd.Revolute("string", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    mech.when("bob.x", 0.0, "down", bd.deactivate(string), "cut")
    solution = bd.simulate(mech, integrator, 1.5)
    (cut,) = solution.occurred
    # m l^2 + J = 2.1 kg m^2 has fallen by 1 m: speed and spin at the bottom.
    speed = np.sqrt(2.0 * 2.0 * 9.81 / 2.1)
    t = solution.t[solution.t > cut.t] - cut.t
    flown = {"bob.x [m]": -speed * t, "bob.y [m]": -1.0 - 0.5 * 9.81 * t**2}
    for column, expected in flown.items():
        # 100 rtol of 5 m, and of fixed steps 2e-5.
        assert_allclose(solution.columns[column][-len(t) :], expected, atol=1e-4)
    assert_allclose(solution.columns["bob.angle_dot [rad/s]"][-len(t) :], -speed, atol=1e-4)
    assert np.all(solution.lam[solution.t > cut.t] == 0.0)
    assert np.any(solution.lam[solution.t < cut.t] != 0.0)
    assert solution.quality.energy_imbalance < 1e-5
    assert cut.energy_lost == pytest.approx(0.0, abs=1e-9)


@RUNS
def test_a_bar_that_is_locked_stands_still(integrator):
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
    # A rate that jumps over its value crosses it.
    mech.when("bar.angle_dot", 0.5 * SPEED, "both", "record", "slow")
    solution = bd.simulate(mech, integrator, 1.0)
    caught, slow = solution.occurred
    assert (slow.t, slow.direction) == (caught.t, "down")
    assert_allclose(caught.t, 0.5 / SPEED, rtol=1e-6)
    after = solution.t > caught.t
    assert_allclose(solution.columns["bar.angle [rad]"][after], 0.5, atol=1e-6)
    assert_allclose(solution.v[after], 0.0, atol=1e-9)
    assert_allclose(caught.impulses["lock.angle"], INERTIA * SPEED, rtol=1e-5)
    assert_allclose(caught.energy_lost, 0.5 * INERTIA * SPEED**2, rtol=1e-5)
    dissipated = solution.ledger["energy.dissipated [J]"]
    assert_allclose(dissipated.iloc[-1], caught.energy_lost, rtol=1e-9)
    assert solution.quality.energy_imbalance < 1e-6
    assert_allclose(solution.events["energy lost [J]"], [caught.energy_lost, 0.0])
    assert solution.beside()["events"][0]["impulses"]["lock.angle"] == caught.impulses["lock.angle"]


@RUNS
def test_a_bar_caught_off_its_center_swings_on(integrator):
    """Free until it is caught at a point: its angular momentum about that point is kept."""
    mech = bd.Mechanism()
    bar = mech.add(bd.RigidBody("bar", mass=2.0, inertia=0.4, angular_velocity=2.0 * np.pi))
    peg = mech.add(bd.Revolute("peg", mech.ground.at(0.5, 0.0), bar.at(0.5, 0.0)))
    mech.deactivate(peg)
    mech.observe("bar", bar.at(0.0, 0.0))
    # After one turn it is where it was drawn.
    mech.when("bar.angle", 2.0 * np.pi, "up", bd.activate(peg), "caught")
    solution = bd.simulate(mech, integrator, 1.5)
    (caught,) = solution.occurred
    assert_allclose(caught.t, 1.0, rtol=1e-6)
    about = 0.4 + 2.0 * 0.25
    spin = 0.4 * 2.0 * np.pi / about
    assert_allclose(solution.columns["bar.angle_dot [rad/s]"][-1], spin, rtol=1e-6)
    assert_allclose(
        caught.energy_lost, 0.5 * (0.4 * (2.0 * np.pi) ** 2 - about * spin**2), rtol=1e-6
    )
    # v+ of the center is -0.5 m times the spin: m times that is the impulse on the bar.
    assert_allclose(abs(caught.impulses["peg.y"]), 2.0 * 0.5 * spin, rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-6


@RUNS
def test_a_driver_gives_way_to_another(integrator):
    mech, bar = spinning(angular_velocity=0.0)
    sides = (mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0))
    slow = mech.add(bd.Driver("slow", *sides, law=lambda t: 1.0 * t))
    fast = mech.add(bd.Driver("fast", *sides, law=lambda t: 3.0 * t - 1.0))
    mech.deactivate(fast)
    mech.when("bar.angle", 0.5, "up", [bd.deactivate(slow), bd.activate(fast)], "shift")
    solution = bd.simulate(mech, integrator, 1.0)
    assert_allclose(solution.occurred[0].t, 0.5, atol=1e-7)
    assert_allclose(solution.columns["bar.angle [rad]"][-1], 2.0, atol=1e-6)
    assert_allclose(solution.occurred[0].energy_lost, 0.5 * INERTIA * (1.0 - 9.0), rtol=1e-6)


@RUNS
def test_a_force_ends_and_comes_back(integrator):
    """1 N pushes 1 kg from 0 to 1 m, not from there to 2 m, and again from there on."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    push = mech.add(bd.Force("push", ball.point, (1.0, 0.0)))
    mech.observe("ball", ball.point)
    mech.when("ball.x", 1.0, "up", bd.deactivate(push), "off")
    mech.when("ball.x", 2.0, "up", bd.activate(push), "on")
    solution = bd.simulate(mech, integrator, 4.0)
    off = np.sqrt(2.0)
    on = off + 1.0 / off
    assert_allclose([one.t for one in solution.occurred], [off, on], rtol=1e-6)
    left = 4.0 - on
    assert_allclose(solution.q[-1, 0], 2.0 + off * left + 0.5 * left**2, rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-7
    works = solution.ledger["energy.work_of_loads [J]"].to_numpy()
    assert_allclose(works[-1], 1.0 + solution.q[-1, 0] - 2.0, rtol=1e-6)


def test_a_joint_that_is_open_is_not_switched_on():
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.7))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
    with pytest.warns(bd.BeamdaeWarning, match=r"event caught: lock\.angle: it is open by 0\.2,"):
        solution = bd.simulate(mech, bd.Radau(), 1.0)
    assert solution.status.kind == "failed"
    assert_allclose(solution.trajectory.end, 0.25, rtol=1e-6)


@pytest.mark.slow(reason="thousands of switches")
def test_switching_without_end_ends_the_run_with_the_reason():
    """A mass is pushed back from the line x + v = 0 on either side: it slides along it."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0)))
    left = mech.add(bd.Force("left", ball.point, (-5.0, 0.0)))
    right = mech.add(bd.Force("right", ball.point, (5.0, 0.0)))
    mech.deactivate(right)
    piece = ball.point.piece
    line = Quantity((Named("line", "m"),), (piece,), lambda local: local.q[0] + local.v[0])
    mech.when(line, 0.0, "down", (bd.deactivate(left), bd.activate(right)), "below")
    mech.when(line, 0.0, "up", (bd.deactivate(right), bd.activate(left)), "above")
    with pytest.warns(bd.BeamdaeWarning, match="no end in sight, event"):
        solution = bd.simulate(mech, bd.Radau(1e-6, max_steps=10**6), 5.0)
    assert solution.status.kind == "limited"


def test_runs_with_switches_repeat_themselves_and_are_estimated():
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
    first, second = (bd.simulate(mech, bd.Radau(1e-6), 1.0) for _ in range(2))
    assert np.array_equal(first.q, second.q)
    assert bd.verify(first)["verdict"].iloc[2] == "agrees"


def test_what_cannot_be_switched_is_refused():
    mech, bar = spinning()
    mech.deactivate(bar)
    with pytest.raises(bd.BeamdaeError, match="bar: it brings coordinates along"):
        bd.equations_of_motion(mech)
    mech, bar = spinning()
    with pytest.raises(bd.BeamdaeError, match="expected joints and forces, got 'hinge'"):
        bd.deactivate("hinge")
    with pytest.raises(bd.BeamdaeError, match="expected joints and forces, got 3"):
        mech.deactivate(3)
    other, _ = spinning()
    with pytest.raises(bd.BeamdaeError, match="must be added to this mechanism first"):
        mech.deactivate(other.part("hinge"))
    with pytest.raises(bd.BeamdaeError, match="do must be 'stop'"):
        mech.when("bar.angle", do=[])


def test_events_at_one_time_all_happen():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    right = mech.add(bd.Force("right", ball.point, (1.0, 0.0)))
    up = mech.add(bd.Force("up", ball.point, (0.0, 1.0)))
    mech.deactivate(right, up)
    mech.observe("ball", ball.point)
    mech.when("ball.x", 1.0, "up", bd.activate(right), "a")
    mech.when("ball.x", 1.0, "up", bd.activate(up), "b")
    mech.when("ball.x", 1.0, "up", "record", "seen")
    mech.when("ball.x", 1.0, "down", "record", "never")
    solution = bd.simulate(mech, bd.Radau(1e-7), 2.0)
    assert [one.name for one in solution.occurred] == ["seen", "a", "b"]
    assert_allclose([one.t for one in solution.occurred], 1.0, atol=1e-12)
    assert_allclose(solution.q[-1], [2.5, 0.5], rtol=1e-9)


def test_a_checkpoint_holds_what_was_switched(tmp_path):
    def caught(integrator, t_end, **more):
        mech, bar = spinning()
        lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
        mech.deactivate(lock)
        mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
        return bd.simulate(mech, integrator, t_end, **more)

    first = caught(bd.Radau(), 0.5)
    path = first.checkpoint(tmp_path / "end.json")
    for start in (first, path):
        later = caught(bd.Ida(), 1.0, start=start)
        assert later.occurred == ()
        assert_allclose(later.columns["bar.angle [rad]"], 0.5, atol=1e-9)
    both = first.followed_by(later)
    assert both.quality.energy_imbalance < 1e-6
    assert np.isfinite(both.table().to_numpy(float)).all()
