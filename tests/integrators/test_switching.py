"""Events that switch joints, forces and laws: closed forms and energy balance."""

import math

import numpy as np
import pytest
from conformance import integrators
from mechanisms import EARTH, free_ball, hinged, hinged_body
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.symbolic.statements import Quantity, Variable

# One of the two fixed-step integrators by default, the other one is slow.
RUNS = integrators(1e-7, 2e-4, slow=("alpha stabilized",))
# A reduced set for behavior that other tests check with all integrators.
SOME = integrators(1e-7, 2e-4, slow=("ida", "alpha", "alpha stabilized", "alpha adaptive"))
SPEED, INERTIA = 2.0, 0.3


def spinning(**bar):
    """A bar that spins about a hinge at its center."""
    bar = {"mass": 1.0, "inertia": INERTIA, "angular_velocity": SPEED} | bar
    mech, bar = hinged(bd.RigidBody("bar", **bar))
    mech.observe("bar", bar.at(0.0, 0.0))
    return mech, bar


@pytest.mark.slow(reason="half a second and more")
@RUNS
def test_released_bob_flies_freely(integrator):
    mech, bob = hinged_body(2.0, 0.1, (1.0, 0.0), name="bob", gravity=9.81)
    string = mech.part("hinge")
    mech.observe("bob", bob.at(1.0, 0.0))
    mech.when("bob.x", 0.0, "down", bd.deactivate(string), "cut")
    solution = bd.simulate(mech, integrator, 1.5)
    (cut_record,) = solution.event_records
    # m l^2 + J = 2.1 kg m^2 has fallen by 1 m: speed and spin at the bottom.
    speed = np.sqrt(2.0 * 2.0 * 9.81 / 2.1)
    t = solution.t[solution.t > cut_record.t] - cut_record.t
    flown = {"bob.x [m]": -speed * t, "bob.y [m]": -1.0 - 0.5 * 9.81 * t**2}
    for column, expected in flown.items():
        # 100 rtol of 5 m; 2e-5 with fixed steps.
        assert_allclose(solution.columns[column][-len(t) :], expected, atol=1e-4)
    assert_allclose(solution.columns["bob.angle_dot [rad/s]"][-len(t) :], -speed, atol=1e-4)
    assert np.all(solution.lam[solution.t > cut_record.t] == 0.0)
    assert np.any(solution.lam[solution.t < cut_record.t] != 0.0)
    assert solution.quality.energy_imbalance < 1e-5
    assert cut_record.energy_lost == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow(reason="half a second and more")
@RUNS
def test_locked_bar_stands_still(integrator):
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
    # A rate that jumps past its threshold crosses it.
    mech.when("bar.angle_dot", 0.5 * SPEED, "both", "record", "slow")
    solution = bd.simulate(mech, integrator, 1.0)
    catch, slow = solution.event_records
    assert (slow.t, slow.direction) == (catch.t, "down")
    assert_allclose(catch.t, 0.5 / SPEED, rtol=1e-6)
    after = solution.t > catch.t
    assert_allclose(solution.columns["bar.angle [rad]"][after], 0.5, atol=1e-6)
    assert_allclose(solution.v[after], 0.0, atol=1e-9)
    assert_allclose(catch.impulses["lock.angle"], INERTIA * SPEED, rtol=1e-5)
    assert_allclose(catch.energy_lost, 0.5 * INERTIA * SPEED**2, rtol=1e-5)
    dissipated = solution.energies["energy.dissipated [J]"]
    assert_allclose(dissipated.iloc[-1], catch.energy_lost, rtol=1e-9)
    assert solution.quality.energy_imbalance < 1e-6
    assert_allclose(solution.events["energy lost [J]"], [catch.energy_lost, 0.0])
    assert (
        solution.metadata()["events"][0]["impulses"]["lock.angle"] == catch.impulses["lock.angle"]
    )


@RUNS
def test_bar_caught_off_center_keeps_angular_momentum(integrator):
    """A free bar is caught at a point: its angular momentum about that point is conserved."""
    mech = bd.Mechanism()
    bar = mech.add(bd.RigidBody("bar", mass=2.0, inertia=0.4, angular_velocity=2.0 * np.pi))
    peg = mech.add(bd.Revolute("peg", mech.ground.at(0.5, 0.0), bar.at(0.5, 0.0)))
    mech.deactivate(peg)
    mech.observe("bar", bar.at(0.0, 0.0))
    # After one rotation it is where it was drawn.
    mech.when("bar.angle", 2.0 * np.pi, "up", bd.activate(peg), "caught")
    solution = bd.simulate(mech, integrator, 1.5)
    (catch,) = solution.event_records
    assert_allclose(catch.t, 1.0, rtol=1e-6)
    about = 0.4 + 2.0 * 0.25
    spin = 0.4 * 2.0 * np.pi / about
    assert_allclose(solution.columns["bar.angle_dot [rad/s]"][-1], spin, rtol=1e-6)
    assert_allclose(
        catch.energy_lost, 0.5 * (0.4 * (2.0 * np.pi) ** 2 - about * spin**2), rtol=1e-6
    )
    # v+ of the center is -0.5 m times the spin: m times that is the impulse on the bar.
    assert_allclose(abs(catch.impulses["peg.y"]), 2.0 * 0.5 * spin, rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-6


@SOME
def test_force_is_switched_off_and_on(integrator):
    """1 N pushes 1 kg from 0 to 1 m and again beyond 2 m, but not in between."""
    mech, ball = free_ball()
    push = mech.add(bd.Force("push", ball.point, (1.0, 0.0)))
    mech.when("ball.x", 1.0, "up", bd.deactivate(push), "off")
    mech.when("ball.x", 2.0, "up", bd.activate(push), "on")
    solution = bd.simulate(mech, integrator, 4.0)
    off = np.sqrt(2.0)
    on = off + 1.0 / off
    assert_allclose([one.t for one in solution.event_records], [off, on], rtol=1e-6)
    left = 4.0 - on
    assert_allclose(solution.q[-1, 0], 2.0 + off * left + 0.5 * left**2, rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-7
    works = solution.energies["energy.work_of_loads [J]"].to_numpy()
    assert_allclose(works[-1], 1.0 + solution.q[-1, 0] - 2.0, rtol=1e-6)


@pytest.mark.parametrize("x", [0.5, 1.5, 3.0])
def test_regression_open_links_state_their_gap(x):
    """A link of 1 m between points at 3 m had a gap of 4 instead of 2 m."""
    mech, ball = free_ball((1.0, 0.0))
    link = mech.add(bd.Distance("link", mech.ground.at(0.0, 0.0), ball.point))
    mech.add(bd.Force("push", ball.point, (math.copysign(1.0, x - 1.0), 0.0)))
    mech.deactivate(link)
    mech.when("ball.x", x, "up" if x > 1.0 else "down", bd.activate(link), "caught")
    message = rf"link\.length: the joint has a gap of {abs(x - 1.0):.3g} \(in m or rad\) when"
    with pytest.warns(bd.BeamdaeWarning, match=message):
        assert bd.simulate(mech, bd.Radau(), 4.0).status.kind == "failed"


@pytest.mark.slow(reason="thousands of switches")
def test_endless_switching_ends_the_run():
    """Forces push a mass back to the line x + v = 0 from either side: it slides along it."""
    mech, ball = free_ball((1.0, 0.0))
    left = mech.add(bd.Force("left", ball.point, (-5.0, 0.0)))
    right = mech.add(bd.Force("right", ball.point, (5.0, 0.0)))
    mech.deactivate(right)
    piece = ball.point.piece
    line = Quantity((Variable("line", "m"),), (piece,), lambda local: local.q[0] + local.v[0])
    mech.when(line, 0.0, "down", (bd.deactivate(left), bd.activate(right)), "below")
    mech.when(line, 0.0, "up", (bd.deactivate(right), bd.activate(left)), "above")
    with pytest.warns(bd.BeamdaeWarning, match="event"):
        solution = bd.simulate(mech, bd.Radau(1e-6, max_steps=10**6), 5.0)
    assert solution.status.kind == "limited"


def test_simultaneous_events_all_happen():
    mech, ball = free_ball(velocity=(1.0, 0.0))
    right = mech.add(bd.Force("right", ball.point, (1.0, 0.0)))
    up = mech.add(bd.Force("up", ball.point, (0.0, 1.0)))
    mech.deactivate(right, up)
    mech.when("ball.x", 1.0, "up", bd.activate(right), "a")
    mech.when("ball.x", 1.0, "up", bd.activate(up), "b")
    mech.when("ball.x", 1.0, "up", "record", "seen")
    mech.when("ball.x", 1.0, "down", "record", "never")
    solution = bd.simulate(mech, bd.Radau(1e-7), 2.0)
    assert [one.name for one in solution.event_records] == ["seen", "a", "b"]
    assert_allclose([one.t for one in solution.event_records], 1.0, atol=1e-12)
    assert_allclose(solution.q[-1], [2.5, 0.5], rtol=1e-9)


@pytest.mark.slow(reason="half a second and more")
def test_events_at_the_time_of_an_impact_are_not_lost():
    """Three events at the floor, in any order: the ball bounces, and both forces are switched."""
    for order in ((0, 1, 2), (1, 0, 2), (2, 1, 0)):
        mech = bd.Mechanism(gravity=EARTH)
        ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
        side, lift = (mech.add(bd.Force(x, ball.point, (1.0, 0.0))) for x in ("side", "lift"))
        mech.deactivate(lift)
        gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(ball.point)
        actions = (bd.impact(gap, 0.5), bd.deactivate(side), bd.activate(lift))
        for k in order:
            mech.when(gap, 0.0, "down", actions[k], name=str(k))
        # The ball rises for 0.45 s after the impact.
        solution = bd.simulate(mech, bd.Radau(1e-7), 0.8)
        assert [record.name for record in solution.event_records] == [str(k) for k in order]
        t = np.sqrt(2.0 / 9.81)
        assert_allclose([record.t for record in solution.event_records], t, rtol=1e-9)
        assert solution.trajectory.intervals[-1].configuration.inactive == {"side"}
        assert_allclose(solution.v[-1, 1], 0.5 * 9.81 * t - 9.81 * (0.8 - t), rtol=1e-6)
        mech.when(gap, 0.0, "down", "stop", name="stop")
        stopped = bd.simulate(mech, bd.Radau(1e-7), 0.8)
        assert stopped.event_records[-1].name == "stop"
        assert_allclose(stopped.trajectory.end, t, rtol=1e-9)


def braked(brake_of, **bar):
    """A rotating bar that is braked after 1 s and released 1 s later."""
    mech, bar = spinning(**bar)
    clock = mech.add(bd.PointMass("clock", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    mech.observe("clock", clock.point)
    brake = mech.add(brake_of(mech, bar))
    mech.deactivate(brake)
    mech.when("clock.x", 1.0, "up", bd.activate(brake, as_is=True), "locked")
    mech.when("clock.x", 2.0, "up", bd.deactivate(brake), "released")
    return mech, brake


@SOME
def test_hinge_is_locked_at_any_angle_and_released(integrator):
    mech, brake = braked(
        lambda m, b: bd.Driver("brake", m.ground.at(0.0, 0.0), b.at(0.0, 0.0), law=0.0)
    )
    bar = mech.part("bar")
    mech.add(bd.Moment("push", bar.at(0.0, 0.0), 0.9))
    mech.observe("brake", brake.reaction)
    solution = bd.simulate(mech, integrator, 3.0)
    locked, _ = solution.event_records
    t, angle = solution.t, solution.columns["bar.angle [rad]"]
    # 2 rad/s and 0.9 / 0.3 rad/s^2 for a second, then at rest, and again from there.
    still = SPEED + 1.5
    assert_allclose(angle[(t > 1.0) & (t < 2.0)], still, rtol=1e-6)
    assert_allclose(angle[-1], still + 1.5, rtol=1e-6)
    assert_allclose(locked.impulses["brake.angle"], INERTIA * 5.0, rtol=1e-6)
    assert_allclose(locked.energy_lost, 0.5 * INERTIA * 25.0, rtol=1e-6)
    torque = solution.columns["brake.M [N m]"]
    assert_allclose(torque[(t > 1.0) & (t < 2.0)], -0.9, rtol=1e-6)
    assert np.all(torque[t > 2.0] == 0.0)
    assert solution.quality.energy_imbalance < 1e-6
    assert solution.quality.max_position_drift < 1e-9


@pytest.mark.slow(reason="a fifth of a second")
def test_slide_and_link_are_locked_at_any_position():
    for brake_of in (
        lambda g, b: bd.TranslationalDriver("brake", g, b, 0.0, (1.0, 0.0)),
        lambda g, b: bd.Distance("brake", g, b),
    ):
        mech = bd.Mechanism()
        block = mech.add(
            bd.RigidBody("block", mass=2.0, inertia=1.0, center=(1.0, 0.0), velocity=(3.0, 0.0))
        )
        ends = mech.ground.at(0.0, 0.0), block.at(1.0, 0.0)
        mech.add(bd.Prismatic("rail", *ends))
        brake = mech.add(brake_of(*ends))
        mech.deactivate(brake)
        mech.observe("block", block.at(1.0, 0.0))
        mech.when("block.x", 1.7, "up", bd.activate(brake, as_is=True), "locked")
        solution = bd.simulate(mech, bd.Radau(), 1.0)
        assert_allclose(solution.columns["block.x [m]"][-1], 1.7, rtol=1e-9)
        assert_allclose(solution.event_records[0].energy_lost, 9.0, rtol=1e-6)


@pytest.mark.parametrize("joint", [bd.Weld, bd.Revolute])
@pytest.mark.parametrize("swapped", [False, True])
def test_rotating_gripper_keeps_the_offset(joint, swapped):
    """Momentum is conserved, and the offset of the gripped body stays constant."""
    mech = bd.Mechanism()
    hand = mech.add(
        bd.RigidBody("hand", mass=2.0, inertia=0.4, velocity=(1.0, 0.0), angular_velocity=1.5)
    )
    box = mech.add(bd.RigidBody("box", mass=1.0, inertia=0.1, center=(0.5, 0.2)))
    # Drawn where they meet, joined at any position.
    places = [hand.at(0.5, 0.2), box.at(0.5, 0.2)]
    grip = mech.add(joint("grip", *(places[::-1] if swapped else places)))
    mech.deactivate(grip)
    mech.observe("hand", hand.at(0.0, 0.0))
    mech.observe("box", box.at(0.5, 0.2))
    mech.when("hand.x", 0.3, "up", bd.activate(grip, as_is=True), "gripped")
    solution = bd.simulate(mech, bd.Radau(1e-8), 2.0)
    x = {k.partition(" ")[0]: v for k, v in solution.columns.items()}
    after = solution.t > 0.3
    # Offset of the box from the hand, in the frame of the body that carries it.
    carrier = "box" if swapped else "hand"
    way = np.array([x["box.x"] - x["hand.x"], x["box.y"] - x["hand.y"]])
    c, s = np.cos(x[f"{carrier}.angle"]), np.sin(x[f"{carrier}.angle"])
    local_offset = np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])
    if joint is bd.Weld or not swapped:
        # A hinge keeps a point of its second body: here the center of the box.
        assert_allclose(local_offset[:, after] - local_offset[:, after][:, :1], 0.0, atol=1e-7)
    turn = x["box.angle"] - x["hand.angle"]
    assert (np.ptp(turn[after]) < 1e-7) == (joint is bd.Weld)
    momentum = 2.0 * x["hand.x_dot"] + 1.0 * x["box.x_dot"]
    assert_allclose(momentum, 2.0, rtol=1e-7)
    spin = sum(
        inertia * x[f"{n}.angle_dot"]
        + mass * (x[f"{n}.x"] * x[f"{n}.y_dot"] - x[f"{n}.y"] * x[f"{n}.x_dot"])
        for n, mass, inertia in (("hand", 2.0, 0.4), ("box", 1.0, 0.1))
    )
    assert_allclose(spin, spin[0], atol=1e-6)
    assert solution.event_records[0].energy_lost > 0.0
    assert solution.quality.energy_imbalance < 1e-6


CYCLES = [bd.Radau(1e-7), bd.Ida(1e-7), bd.GeneralizedAlpha(step=2e-3)]


def cycled(integrator, t_end=3.0, **more):
    """A driver at 1 rad/s up to 0.6 rad, then a law with two breakpoints, then a constant angle."""
    mech, bar = spinning(angular_velocity=0.0)
    drive = bd.Driver("drive", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=lambda t: 1.0 * t)
    drive = mech.add(drive)
    # 1 rad/s for 0.5 s, down to rest in 1 s, then another 0.25 rad/s.
    law = bd.piecewise(
        (0.5, lambda t: 7.0 + t),
        (1.5, lambda t: 7.5 + (t - 0.5) - 0.5 * (t - 0.5) ** 2),
        lambda t: 8.0 + 0.25 * (t - 1.5),
    )
    mech.observe("drive", drive.drive)
    mech.when("bar.angle", 0.6, "up", bd.change_law(drive, law), "slower")
    mech.when("bar.angle", 1.7, "up", bd.change_law(drive, 0.0), "held")
    return bd.simulate(mech, integrator, t_end, **more)


def angle_of(t):
    """Angle of `cycled` [rad]."""
    s = t - 0.6
    bent = np.select(
        [s < 0.0, s < 0.5, s < 1.5],
        [s, s, s - 0.5 * (s - 0.5) ** 2],
        1.0 + 0.25 * (s - 1.5),
    )
    return np.minimum(0.6 + bent, 1.7)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", CYCLES, ids=lambda one: one.method)
def test_driver_follows_another_law_after_an_event(integrator):
    solution = cycled(integrator)
    assert_allclose([one.t for one in solution.event_records], [0.6, 2.5], atol=1e-6)
    x, t = solution.columns, solution.t
    assert_allclose(x["bar.angle [rad]"], angle_of(t), atol=2e-6)
    braked = (t > 1.11) & (t < 2.09)
    assert_allclose(x["drive.M [N m]"][braked], -INERTIA, atol=1e-5)
    # The error is that of the event times.
    rate = 1.0 - (t - 1.1)
    assert_allclose(x["drive.power [W]"][braked], (-INERTIA * rate)[braked], atol=1e-5)
    # The law continues without a velocity jump; the last law stops the bar.
    slower, stop_record = solution.event_records
    assert abs(slower.energy_lost) < 1e-9
    assert_allclose(stop_record.energy_lost, 0.5 * INERTIA * 0.25**2, rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-6
    # Runs restart where pieces of the law meet.
    ends = [interval.t[-1] for interval in solution.trajectory.intervals]
    assert_allclose(ends, [0.6, 1.1, 2.1, 2.5, 3.0], atol=1e-6)


def test_law_that_becomes_infinite_fails_the_event():
    mech, bar = spinning()
    ends = mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)
    drive = mech.add(bd.Driver("drive", *ends, law=lambda t: SPEED * t))
    mech.when("bar.angle", 0.5, "up", bd.change_law(drive, lambda t: 1.0 / (t - 0.25)), "pole")
    with pytest.warns(bd.BeamdaeWarning, match="event pole: drive: the law becomes infinite"):
        solution = bd.simulate(mech, bd.Radau(), 1.0)
    assert solution.status.kind == "failed"


def test_parts_added_later_do_not_change_built_equations():
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock), "caught")
    equations = bd.equations_of_motion(mech)
    mech.add(bd.PointMass("late", 1.0, at=(3.0, 0.0)))
    mech.when("bar.angle", 0.1, "up", "stop", "late")
    solution = bd.simulate(equations, bd.Radau(), 1.0)
    assert [one.name for one in solution.event_records] == ["caught"]


@SOME
@pytest.mark.parametrize("as_is", [False, True], ids=["as it is due", "as it is"])
def test_one_driver_replaces_another(integrator, as_is):
    """Positions are continuous as they are, where the laws alone would differ by 7 rad."""
    mech, bar = spinning(angular_velocity=0.0)
    sides = (mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0))
    slow = mech.add(bd.Driver("slow", *sides, law=lambda t: 1.0 * t))
    gap = 7.0 if as_is else 0.0
    fast = mech.add(bd.Driver("fast", *sides, law=lambda t: 3.0 * t - 1.0 - gap))
    mech.deactivate(fast)
    actions = [bd.deactivate(slow), bd.activate(fast, as_is=as_is)]
    mech.when("bar.angle", 0.5, "up", actions, "shift")
    solution = bd.simulate(mech, integrator, 1.0)
    (shift,) = solution.event_records
    assert_allclose(shift.t, 0.5, atol=1e-7)
    angle, t = solution.columns["bar.angle [rad]"], solution.t
    assert_allclose(angle, np.where(t < 0.5, t, 3.0 * t - 1.0), atol=1e-6)
    assert_allclose(shift.energy_lost, 0.5 * INERTIA * (1.0 - 9.0), rtol=1e-6)
    assert solution.quality.energy_imbalance < 1e-6


def caught(t_end, angle=0.5, as_is=False, **more):
    mech, bar = spinning()
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=angle))
    mech.deactivate(lock)
    mech.when("bar.angle", 0.5, "up", bd.activate(lock, as_is=as_is), "caught")
    return bd.simulate(mech, bd.Radau(1e-7), t_end, **more)


def locked(t_end, **more):
    mech, _ = braked(
        lambda m, b: bd.Driver("brake", m.ground.at(0.0, 0.0), b.at(0.0, 0.0), law=0.0)
    )
    return bd.simulate(mech, bd.Radau(1e-7), t_end, **more)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize(
    ("run", "stop", "end"),
    [(caught, 0.5, 1.0), (locked, 1.5, 3.0), (lambda t, **x: cycled(CYCLES[0], t, **x), 0.9, 3.0)],
    ids=["switched part", "frozen gap", "changed law"],
)
def test_checkpoints_store_the_effects_of_events(run, stop, end, tmp_path):
    whole, first = run(end, output_step=0.02), run(stop, output_step=0.02)
    path = first.save(tmp_path / "end.json")
    for start in (first, path):
        both = first.followed_by(run(end, start=start, output_step=0.02))
        assert [x.name for x in both.event_records] == [x.name for x in whole.event_records]
        assert_allclose(both.q, whole.q, atol=2e-6)
        assert both.quality.energy_imbalance < 1e-6


@pytest.mark.slow(reason="a fifth of a second")
def test_failed_event_is_due_when_the_run_continues(tmp_path):
    """The lock is open in the first run; in the second one it keeps the gap."""
    with pytest.warns(bd.BeamdaeWarning, match="activate.*as_is=True"):
        first = caught(1.0, angle=0.7)
    path = first.save(tmp_path / "end.json")
    for start in (first, path):
        later = caught(1.0, angle=0.7, as_is=True, start=start)
        assert_allclose(later.columns["bar.angle [rad]"], 0.5, rtol=1e-6)
        (once,) = first.followed_by(later).event_records
        assert once.energy_lost > 0.5


@pytest.mark.slow(reason="a fifth of a second")
def test_checkpoints_of_other_events_are_rejected(tmp_path):
    frozen = locked(1.5).save(tmp_path / "frozen.json")
    changed = cycled(CYCLES[0], 0.9).save(tmp_path / "changed.json")

    mech, bar = spinning(angular_velocity=0.0)
    ends = mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)
    drive = mech.add(bd.Driver("drive", *ends, law=lambda t: 1.0 * t))
    with pytest.raises(bd.BeamdaeError, match="earlier run switched drive, but no event"):
        bd.simulate(mech, bd.Radau(), 2.0, start=changed)
    mech.when("bar.angle", 5.0, "up", bd.change_law(drive, 0.0), "held")
    with pytest.raises(bd.BeamdaeError, match="drive: the law of this driver was set by event"):
        bd.simulate(mech, bd.Radau(), 2.0, start=changed)
    mech, _ = spinning()
    clock = mech.add(bd.PointMass("clock", 1.0, at=(0.0, 0.0)))
    push = mech.add(bd.Force("brake", clock.point, (1.0, 0.0)))
    mech.when("bar.angle", 9.0, "up", bd.deactivate(push), "released")
    with pytest.raises(bd.BeamdaeError, match="brake: an earlier event froze this joint with"):
        bd.simulate(mech, bd.Radau(), 3.0, start=frozen, accept_changes=True)
