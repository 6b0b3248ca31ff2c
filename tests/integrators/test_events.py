"""Events: location on the dense output, records, and terminal events."""

from contextlib import suppress

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball, hinged_body, symbols
from numpy.testing import assert_allclose
from own_method import OwnMethod
from sample_parts import SAMPLES, SampleMechanism, find_public
from scipy.special import ellipk

import beamdae as bd

# Fall from a height of 2 m; quarter swing of a pendulum of 1 m from the horizontal.
FALL = np.sqrt(4.0 / 9.81)
QUARTER = np.sqrt(1.0 / 9.81) * ellipk(0.5)


def falling(*events, height=2.0, gravity=-9.81):
    mech = bd.Mechanism(gravity=(0.0, gravity))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, height), velocity=(1.0, 0.0)))
    mech.observe("ball", ball.point)
    for event in events:
        mech.when(*event[:1], **event[1])
    return mech


def particle(force, q0, v0, *events, observe=None, breakpoints=()):
    """Return a system of one coordinate x under force(t, x, v)."""
    t, q, v = (ca.SX.sym(name) for name in "tqv")
    observe = {} if observe is None else {k: f(t, q, v) for k, f in observe.items()}
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0], force=force(t, q, v), q0=[q0], v0=[v0], names=("x",),
        units=("m",), observe=observe, events=events, breakpoints=breakpoints,
    )  # fmt: skip


def pendulum(*events):
    t, q, v = symbols(2)
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0, 1.0], force=ca.vertcat(0.0, -9.81),
        constraints=ca.dot(q, q) - 1.0, q0=[1.0, 0.0], v0=[0.0, 0.0], names=("x", "y"),
        units=("m", "m"), events=events,
    )  # fmt: skip


ALL = integrators(1e-6, 1e-3, {"own": OwnMethod(0.05)})
RUNS = integrators(1e-6, 1e-3)
HIT = ("ball.y", {"direction": "down", "name": "impact"})


@ALL
def test_a_fall_stops_at_the_impact(integrator):
    solution = bd.simulate(falling(HIT), integrator, 5.0)
    # Error rtol times the motion of 2 m at 6 m/s; the other integrators are exact.
    assert_allclose(solution.t[-1], FALL, atol=1e-6)
    assert solution.status.kind == "ok"
    assert solution.status.sentence == f"stopped by event impact at t = {solution.t[-1]:.6g} s"
    assert_allclose(solution.q[-1, 1], 0.0, atol=1e-12)
    assert solution.trajectory.end == solution.t[-1]
    assert np.all(np.diff(solution.t) > 0.0)
    assert solution.quality.energy_imbalance < 1e-6


@ALL
def test_events_at_a_time_release_a_body_that_rests(integrator):
    mech, ball = free_ball(gravity=9.81)
    rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 1.0), ball.point))
    mech.when("t", crosses=0.05, do=bd.deactivate(rod))
    solution = bd.simulate(mech, integrator, 0.2, start="equilibrium")
    assert_allclose(solution.events["t [s]"], [0.05], rtol=1e-14)
    # 10 rtol of the motion of 0.1 m at 1.5 m/s, over the rest of the run.
    assert_allclose(solution["ball.y"].iloc[-1], -9.81 * 0.15**2 / 2.0, atol=1e-6)


def test_regression_resumed_runs_at_rest_have_no_given_velocities():
    """A ball that hung at rest had "given velocities" of 1e-57 m/s, which its rod did not allow."""
    mech, ball = free_ball(gravity=9.81)
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 1.0), ball.point))
    for integrator in (bd.Radau(), bd.GeneralizedAlpha(1e-3)):
        hanging = bd.simulate(mech, integrator, 0.03, start="equilibrium")
        assert bd.simulate(mech, integrator, 0.06, start=hanging).warnings == ()


@pytest.mark.slow(reason="a fifth of a second")
@RUNS
def test_a_pendulum_passes_its_bottom_at_times_of_the_elliptic_integral(integrator):
    every = QUARTER * np.array([1.0, 3.0, 5.0])
    times = {"up": every[1:2], "down": every[::2], "both": every}
    bottoms = [bd.Event("x", 0.0, direction, "record", name=direction) for direction in times]
    solution = bd.simulate(pendulum(*bottoms), integrator, 6.5 * QUARTER)
    for direction, expected in times.items():
        rows = solution.events[solution.events["event"] == direction]
        # 100 rtol of the motion of 2 m at 4.4 m/s; 2e-6 each quarter with the fixed step.
        assert_allclose(rows["t [s]"], expected, atol=1e-4)
        assert_allclose(rows["x [m]"], 0.0, atol=1e-12)
        assert_allclose(rows["y [m]"], -1.0, atol=1e-4)
        assert set(rows["direction"]) == ({"up", "down"} if direction == "both" else {direction})
    assert solution.status.sentence == "reached the end"
    assert {one["event"] for one in solution.metadata()["events"]} == set(times)


@pytest.mark.slow(reason="half a second")
def test_events_of_generalized_alpha_are_of_order_two():
    bottom = bd.Event("x", 0.0, do="record", name="bottom")
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        solution = bd.simulate(pendulum(bottom), bd.GeneralizedAlpha(step=step), 6.5 * QUARTER)
        errors.append(solution.event_records[2].t - 5.0 * QUARTER)
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


def test_events_within_one_step_are_recorded_in_order():
    levels = {f"at {y}": y for y in (0.55, 0.6, 0.5, 0.45, 0.65)}
    events = [("ball.y", {"crosses": y, "name": n, "do": "record"}) for n, y in levels.items()]
    events.insert(1, ("ball.y", {"crosses": 0.42, "name": "stop"}))
    solution = bd.simulate(falling(*events), bd.GeneralizedAlpha(step=0.4), 5.0)
    assert [one.name for one in solution.event_records] == [
        "at 0.65", "at 0.6", "at 0.55", "at 0.5", "at 0.45", "stop",
    ]  # fmt: skip
    times = [one.t for one in solution.event_records]
    assert_allclose(
        times, np.sqrt(2.0 * (2.0 - np.array([0.65, 0.6, 0.55, 0.5, 0.45, 0.42])) / 9.81)
    )
    assert solution.t[-1] == times[-1]


def test_two_crossings_within_a_step_are_detected():
    ball = particle(lambda t, x, v: -9.81, 0.0, 1.0, bd.Event("x", 0.04, do="record"))
    # Above 0.04 m for 94 ms about the top at 102 ms: inside the step from 0 to 200 ms.
    solution = bd.simulate(ball, bd.GeneralizedAlpha(step=0.2), 0.4)
    expected = (1.0 + np.array([-1.0, 1.0]) * np.sqrt(1.0 - 0.08 * 9.81)) / 9.81
    assert_allclose([one.t for one in solution.event_records], expected, rtol=1e-9)
    assert [one.direction for one in solution.event_records] == ["up", "down"]
    assert solution.event_records[0].name == "x crosses 0.04"


@ALL
def test_quantity_starting_on_its_value_crosses_on_return(integrator):
    ball = particle(lambda t, x, v: -9.81, 0.0, 1.0, bd.Event("x", 0.0))
    solution = bd.simulate(ball, integrator, 1.0)
    assert_allclose(solution.t[-1], 2.0 / 9.81, atol=1e-6)
    assert [one.direction for one in solution.event_records] == ["down"]


@RUNS
def test_constant_or_tangent_quantity_does_not_cross(integrator):
    events = (
        bd.Event("still", 3.0, do="stop"),
        bd.Event("x", 0.5, do="stop", name="over the top"),
    )
    ball = particle(
        lambda t, x, v: -1.0,
        0.0,
        1.0 - 1e-4,
        *events,
        observe={"still": lambda t, x, v: 3.0 + 0.0 * x},
    )
    solution = bd.simulate(ball, integrator, 2.0)
    assert solution.event_records == ()
    assert solution.status.sentence == "reached the end"


@RUNS
@pytest.mark.parametrize("at", [0.5, 0.5 + 1e-9])
def test_event_at_a_breakpoint_happens_once(integrator, at):
    # x = t.
    moving = particle(
        lambda t, x, v: 0.0, 0.0, 1.0, bd.Event("x", at, do="record"), breakpoints=(0.5,)
    )
    solution = bd.simulate(moving, integrator, 1.0)
    assert_allclose([one.t for one in solution.event_records], [at], atol=1e-12)
    moving = particle(lambda t, x, v: 0.0, 0.0, 1.0, bd.Event("x", at), breakpoints=(0.5,))
    solution = bd.simulate(moving, integrator, 1.0)
    assert_allclose(solution.t[-1], at, atol=1e-12)
    assert np.isfinite(solution.table().to_numpy(float)).all()


def test_nonfinite_observable_triggers_no_event():
    root = bd.Event("root", 0.0)
    falls = particle(
        lambda t, x, v: -1.0, 1.0, 0.0, root, bd.Event("x", -1.0, name="later"),
        observe={"root": lambda t, x, v: ca.sqrt(x) + 1.0},
    )  # fmt: skip
    with pytest.warns(bd.BeamdaeWarning, match="root"):
        solution = bd.simulate(falls, bd.Ida(1e-6), 5.0)
    assert [one.name for one in solution.event_records] == ["later"]
    assert_allclose(solution.t[-1], 2.0, atol=1e-5)


def test_event_before_nonfinite_states_stops_the_run():
    def breaks(t, state, k):
        return t, state if t < 0.6 else state._replace(q=state.q * np.nan)

    solution = bd.simulate(
        falling(("ball.y", {"crosses": 1.0})), OwnMethod(0.05, change=breaks), 5.0
    )
    assert_allclose(solution.t[-1], np.sqrt(2.0 / 9.81), rtol=1e-9)
    assert solution.status.kind == "ok"
    with pytest.warns(bd.BeamdaeWarning, match="not finite"):
        solution = bd.simulate(falling(HIT), OwnMethod(0.05, change=breaks), 5.0)
    assert solution.status.kind == "failed"
    assert solution.event_records == ()
    assert_allclose(solution.t[-1], 0.55, rtol=1e-9)


def test_an_event_of_a_rate():
    mech, bob = hinged_body(1.0, 1e-12, (1.0, 0.0), name="bob", gravity=9.81)
    mech.observe("bob", bob.at(1.0, 0.0))
    mech.when("bob.y_dot", 0.0, "down", "record", name="turns")
    solution = bd.simulate(mech, bd.Radau(1e-7), 2.5 * QUARTER)
    assert_allclose([one.t for one in solution.event_records], [2.0 * QUARTER], atol=1e-6)


def test_errors_end_at_the_earlier_event():
    solution = bd.simulate(falling(HIT), bd.Ida(1e-5), 5.0)
    for errors in (solution.errors, bd.verify(solution)):
        assert errors.table()["total"].max() < 1e-2


def test_table_ends_at_the_event(tmp_path):
    solution = bd.simulate(falling(HIT), bd.Radau(), 5.0)
    path = solution.to_csv(tmp_path / "fall.csv")
    lines = path.read_text().splitlines()
    assert "status" not in lines[0]
    assert float(lines[-1].split(",")[0]) == solution.trajectory.end


def test_regression_event_table_without_multipliers():
    """Tables of events without multipliers could not be built."""
    for height, count in ((2.0, 1), (200.0, 0)):
        mech = falling(("ball.y", {"do": "record", "name": "impact"}), height=height)
        events = bd.simulate(mech, bd.Radau(), 1.0).events
        assert len(events) == count
        assert "ball.y [m]" in events


@pytest.mark.parametrize("depth", [1e-1, 1e-3, 1e-4])
@pytest.mark.parametrize(
    "integrator", [bd.Auto(), bd.Radau(), bd.GeneralizedAlpha(step=0.0213)], ids=lambda x: x.method
)
def test_crossings_within_a_quarter_of_a_step_are_found(depth, integrator):
    # Steps are up to 0.15 s; below the highest point by 1e-4 m, the crossings are 9 ms apart.
    top = 4.0**2 / (2.0 * 9.81)
    mech, _ = free_ball(velocity=(1.0, 4.0), gravity=9.81)
    mech.when("ball.y", top - depth, "both", do="record", name="level")
    solution = bd.simulate(mech, integrator, t_end=3.0)
    times = solution.events["t [s]"].to_numpy()
    exact = 4.0 / 9.81 + np.array([-1.0, 1.0]) * np.sqrt(2.0 * depth / 9.81)
    assert times == pytest.approx(exact, abs=2e-3)


def test_quantity_that_turns_before_its_threshold_does_not_cross_it():
    mech, _ = free_ball(velocity=(1.0, 4.0), gravity=9.81)
    mech.when("ball.y", 4.0**2 / (2.0 * 9.81) + 1e-4, "both", do="record", name="level")
    assert bd.simulate(mech, t_end=3.0).events.empty


# Misuse of event actions: no part, foreign parts, inactive parts, the same instant twice.

PARTS = {
    name: arguments
    for name, arguments in SAMPLES.items()
    if isinstance(find_public(name), type) and issubclass(find_public(name), bd.Part)
}
ACTIONS = {
    "activate": bd.activate,
    "activate as it is": lambda *parts: bd.activate(*parts, as_is=True),
    "deactivate": bd.deactivate,
    "change_law": lambda *parts: bd.change_law(*parts, lambda t: t),
    "impact": lambda *parts: bd.impact(*parts),
}
EVENT_TIME, END = 0.005, 0.01  # s


def sample(kind):
    """Return a mechanism with a sample part, and a ball that crosses x = 5 mm at 5 ms."""
    source = SampleMechanism()
    part = find_public(kind)(**PARTS[kind](source))
    mech = source.mechanism
    mech.add(part)
    clock = mech.add(bd.PointMass("clock", 1.0, at=(0.0, 9.0), velocity=(1.0, 0.0)))
    mech.observe("clock", clock.point)
    return mech, part


def create_action(name, part):
    """Return the action on a part; None if the action rejects parts of this kind."""
    with suppress(bd.BeamdaeError):
        return ACTIONS[name](part)
    return None


def add_events(mech, *actions):
    for k, action in enumerate(actions):
        mech.when("clock.x", EVENT_TIME, "up", action, f"event {k}")


def run(mech):
    """Return the solution, or the message of the error that assembly raises."""
    try:
        return bd.simulate(mech, bd.Radau(1e-4, max_steps=2000), END)
    except bd.BeamdaeError as error:
        return str(error)


@pytest.mark.parametrize("kind", PARTS)
@pytest.mark.parametrize("name", ACTIONS)
def test_parts_of_other_mechanisms_are_rejected(name, kind):
    """The other part has the name and the numbers of a part of this mechanism."""
    mech, part = sample(kind)
    _, foreign_part = sample(kind)
    if create_action(name, part) is None:
        return
    with pytest.raises(bd.BeamdaeError, match=f"event 0: '{part.name}' is not part of this"):
        add_events(mech, create_action(name, foreign_part))


def test_foreign_parts_are_rejected_if_the_part_of_this_name_is_added_later():
    empty = bd.Mechanism()
    disk = empty.add(bd.RigidBody("disk", 1.0, 0.1, (0.5, 0.4)))
    empty.observe("disk", disk.at(0.5, 0.4))
    part = bd.Revolute("joint", empty.ground.at(0.1, 0.2), disk.at(0.1, 0.2))
    other, foreign_part = sample("Revolute")
    assert other.part(part.name) is foreign_part
    empty.when("disk.x", 0.0, do=bd.deactivate(foreign_part), name="late")
    empty.add(part)
    with pytest.raises(bd.BeamdaeError, match=f"late: '{part.name}' is not part of this mechanism"):
        bd.equations_of_motion(empty)


@pytest.mark.slow(reason="compiles and runs every part of the catalog several times")
@pytest.mark.parametrize("kind", PARTS)
def test_actions_on_active_and_inactive_parts_end_with_a_result_or_a_reason(kind):
    for name in ACTIONS:
        for starts_inactive in (False, True):
            for count in (1, 2):
                mech, part = sample(kind)
                action = create_action(name, part)
                if action is None:
                    continue
                if starts_inactive:
                    mech.deactivate(part)
                add_events(mech, *(action,) * count)
                outcome = run(mech)
                if isinstance(outcome, str):
                    assert outcome.endswith("."), outcome
                    assert part.name in outcome
                    continue
                assert outcome.status.sentence
                if outcome.status.kind == "ok":
                    assert len(outcome.event_records) == count


@pytest.mark.slow(reason="compiles and runs every part of the catalog")
@pytest.mark.parametrize("kind", PARTS)
def test_opposite_events_at_the_same_instant_occur_in_the_order_of_their_definition(kind):
    for first, second, is_inactive in (
        ("activate", "deactivate", True),
        ("deactivate", "activate", False),
    ):
        mech, part = sample(kind)
        add_events(mech, create_action(first, part), create_action(second, part))
        outcome = run(mech)
        if isinstance(outcome, str):
            assert part.name in outcome
            continue
        if outcome.status.kind == "ok":
            assert [record.name for record in outcome.event_records] == ["event 0", "event 1"]
            configuration = outcome.trajectory.intervals[-1].configuration
            assert (part.name in configuration.inactive) == is_inactive
