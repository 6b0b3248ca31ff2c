"""Derivatives of runs across events, impacts, switches and moving breakpoints."""

import casadi as ca
import numpy as np
import pytest
from leaf_spring_vehicle import leaf_spring_vehicle
from mechanisms import EARTH, driven, free_ball, hinged
from support import differences_of_runs

import beamdae as bd

GRAVITY = 9.81
INTEGRATORS = [
    bd.Radau(rtol=1e-8),
    bd.GeneralizedAlpha(step=2e-3),
    bd.GeneralizedAlpha(rtol=1e-5),
]


@bd.model(t_end=1.2)
def bounce(height=0.5, gravity=GRAVITY, restitution=0.8, floor=0.1, mark=0.3):
    """Ball that falls from rest and bounces on a floor."""
    mech, ball = free_ball((0.0, height), 1.3, gravity=gravity)
    gap = bd.LineSurface(mech.ground.at(0.0, floor), (1.0, 0.0)).gap(ball.point)
    mech.when(gap, 0.0, "down", bd.impact(gap, restitution), name="bounce")
    mech.when("ball.y", mark, "both", "record", name="mark")
    return mech


BOUNCE = {"height": 0.5, "gravity": GRAVITY, "restitution": 0.8, "floor": 0.1}


def bouncing_ball(t, height, gravity, restitution, floor):
    """Return the height and the velocity at the times `t`, and the times of all impacts."""
    impacts = [np.sqrt(2.0 * (height - floor) / gravity)]
    speeds = [restitution * gravity * impacts[0]]
    while impacts[-1].real < t[-1]:
        impacts.append(impacts[-1] + 2.0 * speeds[-1] / gravity)
        speeds.append(restitution * speeds[-1])
    flights = np.searchsorted(np.real(impacts), t) - 1
    times = t - np.where(flights < 0, 0.0, np.array(impacts)[flights])
    v = np.where(flights < 0, 0.0, np.array(speeds)[flights])
    y = np.where(flights < 0, height, floor) + v * times - 0.5 * gravity * times**2
    return y, v - gravity * times, impacts


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_bouncing_ball(integrator):
    result = bd.sensitivities(bounce, [*BOUNCE, "mark"], integrator)
    bounces = result.events.set_index("event").loc["bounce"]
    for name in BOUNCE:
        values = {key: complex(x, 1e-30 * (key == name)) for key, x in BOUNCE.items()}
        y, v, impacts = (np.imag(x) / 1e-30 for x in bouncing_ball(result.t, **values))
        for column, exact in (("ball.y", y), ("ball.y_dot", v)):
            # Parabolas are integrated exactly; errors are rounding errors.
            actual = result.sensitivity(column, name)
            np.testing.assert_allclose(actual, exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())
        np.testing.assert_allclose(
            bounces[f"d(t)/d({name}) [s per unit of {name}]"], impacts[:3], rtol=1e-9
        )
    # The first mark is passed in free fall: h - g t^2 / 2 = mark.
    mark = result.events.iloc[0]
    assert mark["event"] == "mark"
    slope = -1.0 / (GRAVITY * mark["t [s]"])
    assert mark["d(t)/d(mark) [s per unit of mark]"] == pytest.approx(slope, rel=1e-9)
    assert np.all(result.sensitivity("ball.y", "mark") == 0.0)


@bd.model(t_end=0.5)
def falling(height=0.5, target=0.2):
    mech, _ = free_ball((0.0, height), gravity=GRAVITY)
    mech.when("ball.y", crosses=target, do="stop", name="landed")
    return mech


def test_run_that_an_event_stops():
    result = bd.sensitivities(falling, ["height", "target"])
    time = np.sqrt(2.0 * 0.3 / GRAVITY)
    assert result.t[-1] == pytest.approx(time, rel=1e-9)
    np.testing.assert_allclose(result.sensitivity("ball.y", "height"), 1.0, rtol=1e-9)
    landed = result.events.iloc[0]
    assert landed["d(t)/d(height) [s per unit of height]"] == pytest.approx(
        1.0 / (GRAVITY * time), rel=1e-9
    )
    assert landed["d(t)/d(target) [s per unit of target]"] == pytest.approx(
        -1.0 / (GRAVITY * time), rel=1e-9
    )


@bd.model(t_end=0.5)
def moving(end=0.2, force=2.0):
    """Mass of 1 kg that is pulled from 0.1 s to `end`."""
    mech, mass = free_ball(name="mass")
    mech.add(bd.Force("pull", mass.point, (bd.piecewise((0.1, 0.0), (end, force), 0.0), 0.0)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_breakpoint_that_moves(integrator):
    result = bd.sensitivities(moving, "end", integrator)
    exact = np.where(result.t > 0.2, 2.0 * (result.t - 0.2), 0.0)
    np.testing.assert_allclose(result.sensitivity("mass.x", "end"), exact, rtol=0.0, atol=1e-12)


def double_pendulum(length=0.5, mass=2.0, law=None):
    """Return a double pendulum and its rods; a law, if any, drives the upper one."""
    upper = bd.RigidBody.rod("upper", (0.0, 0.0), (length, 0.0), mass=mass)
    mech, upper = hinged(upper, GRAVITY) if law is None else driven(upper, law, GRAVITY)
    lower = mech.add(bd.RigidBody.rod("lower", (length, 0.0), (length + 0.4, 0.0), mass=1.0))
    elbow = mech.add(bd.Revolute("elbow", upper.at(length, 0.0), lower.at(length, 0.0)))
    mech.observe("upper", upper.at(0.0, 0.0))
    mech.observe("end", lower.at(length + 0.4, 0.0))
    mech.observe("elbow", elbow.reaction)
    return mech, upper, lower


@bd.model(t_end=0.4)
def caught(angle=-0.6, length=0.5, time=0.1, torque=3.0):
    """A lock catches the upper rod; before that, a torque changes."""
    mech, upper, _ = double_pendulum(length, law=lambda t: angle + 0.0 * t)
    law = bd.piecewise((time, torque), 0.5 * torque)
    mech.add(bd.Moment("drive", on=upper.at(0.0, 0.0), law=law))
    lock = mech.part("motor")
    mech.deactivate(lock)
    mech.when("upper.angle", angle, "down", bd.activate(lock), name="caught")
    return mech


@bd.model(t_end=0.4)
def held(angle=-0.6, mass=2.0, rate=2.0):
    """A driver takes over the upper rod where it is, and releases it."""
    mech, *_ = double_pendulum(mass=mass, law=lambda t: rate * t**2)
    driver = mech.part("motor")
    mech.deactivate(driver)
    mech.when("upper.angle", angle, "down", bd.activate(driver, as_is=True), name="held")
    mech.when("end.y", -0.5, "down", bd.deactivate(driver), name="released")
    return mech


@bd.model(t_end=0.6)
def redirected(angle=0.3, length=0.5, rate=2.0, later=3.0):
    """A driver follows a new law, with a breakpoint, from an event on."""
    mech, *_ = double_pendulum(length, law=lambda t: -rate * t**2)
    law = bd.piecewise((0.1, lambda t: -later * t**2), lambda t: -later * (0.01 + 0.2 * (t - 0.1)))
    mech.when(
        "upper.angle", -angle, "down", bd.change_law(mech.part("motor"), law), name="redirected"
    )
    return mech


@bd.model(t_end=0.4)
def struck(wall=0.3, length=0.5, restitution=0.6, tilt=0.1):
    """The end of a double pendulum hits an inclined wall; joints transmit the impact."""
    mech, _, lower = double_pendulum(length)
    surface = bd.LineSurface(mech.ground.at(0.0, -wall), (1.0, tilt))
    gap = surface.gap(lower.at(length + 0.4, 0.0))
    mech.when(gap, 0.0, "down", bd.impact(gap, restitution), name="struck")
    return mech


@bd.model(t_end=0.2)
def struck_driven(wall=0.2, length=0.5, restitution=0.6, rate=2.0):
    """As `struck`, with a driver whose law depends on time.

    At rate = 2, CasADi removes the factor 0.5 rate, so that neighboring models have other numbers.
    """
    mech, _, lower = double_pendulum(length, law=lambda t: -0.5 * rate * t**2)
    surface = bd.LineSurface(mech.ground.at(0.0, -wall), (1.0, 0.1))
    gap = surface.gap(lower.at(length + 0.4, 0.0))
    mech.when(gap, 0.0, "down", bd.impact(gap, restitution), name="struck")
    return mech


@bd.model(t_end=0.5)
def broken(limit=25.0, mass=2.0):
    """A joint breaks when its reaction reaches a limit."""
    mech, _, _ = double_pendulum(mass=mass)
    mech.when("elbow.Fy", limit, "both", bd.deactivate(mech.part("elbow")), name="broken")
    return mech


@bd.model(t_end=0.4)
def relieved(angle=-0.3, rate=2.0, mark=0.1):
    """A driver follows a new law that contains two numbers, which are equal for mark = 0.1."""
    mech, *_ = double_pendulum(law=lambda t: -rate * t**2 - 3.0 * t**3)
    later = bd.change_law(mech.part("motor"), lambda t: mark * t + 0.1 * t**2)
    mech.when("upper.angle", angle, "down", later, name="relieved")
    return mech


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(step=1e-3), bd.Radau()])
def test_regression_parameters_whose_equations_differ_after_an_event(method):
    # Such parameters were differentiated together, and arrays of different lengths combined.
    names = ["angle", "rate", "mark"]
    together = bd.sensitivities(relieved, names, method, estimate_error=False)
    gradient = bd.gradient(
        relieved, bd.quantities.EndValue("end.y"), names, method, estimate_error=False
    )
    for name in names:
        alone = bd.sensitivities(relieved, name, method, estimate_error=False)
        actual, expected = (x.sensitivity("end.y", name) for x in (together, alone))
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-14)
        assert gradient.derivatives[name] == pytest.approx(expected.iloc[-1], rel=1e-9)


CASES = {
    "caught": (caught, ["angle", "time"]),
    "held": (held, ["angle", "rate"]),
    "redirected": (redirected, ["angle", "later"]),
    "struck": (struck, ["wall", "tilt"]),
    "driven": (struck_driven, ["restitution", "rate"]),
    "broken": (broken, ["limit", "mass"]),
}


@pytest.mark.slow(reason="five runs of a mechanism per parameter")
@pytest.mark.parametrize("case", CASES)
def test_events_agree_with_differences_of_runs(case):
    model, names = CASES[case]
    result = bd.sensitivities(model, names, bd.Radau(rtol=1e-9), estimate_error=False)
    for name in names:
        # At the end, which is a step of all runs.
        for column, expected in differences_of_runs(model, name, 1e-11).items():
            values = result.solution.columns[column]
            actual = result.sensitivity(column, name).iloc[-1]
            # Events are located on the dense output, whose errors decrease with rtol. Reactions are
            # of order 3.
            size = max(abs(expected), np.abs(values).max(), 0.1)
            tolerance = 2e-4 if column.startswith("elbow") else 1e-6
            assert actual == pytest.approx(expected, abs=tolerance * size), (column, name)


@bd.model(t_end=0.8)
def deflected(offset=3e-3, stiffness=1e5, radius=0.01):
    """Ball that hits a stiff peg, which it touches for less than a step."""
    mech, ball = free_ball((-1.0, offset), velocity=(2.0, 0.0), mass=0.1)
    surface = bd.CircleSurface(mech.ground.at(0.0, 0.0), radius, "outside")
    mech.add(bd.Contact("peg", ball.point, surface, stiffness))
    return mech


@pytest.mark.slow(reason="five runs per parameter")
@pytest.mark.parametrize("name", ["offset", "stiffness", "radius"])
def test_run_that_restarts_at_a_contact(name):
    expected = differences_of_runs(deflected, name, 1e-10)["ball.y [m]"]
    # The force has kinks within steps: errors are 1e-3 at the default rtol, where the run restarts
    # at the onset, and 2e-6 at rtol = 1e-8.
    for rtol, restarts, tolerance in ((1e-5, 2, 5e-3), (1e-8, 0, 1e-5)):
        result = bd.sensitivities(deflected, name, bd.Radau(rtol=rtol))
        assert len(result.solution.trajectory.intervals) == 1 + restarts
        actual = result.sensitivity("ball.y", name).iloc[-1]
        assert actual == pytest.approx(expected, rel=tolerance)


@bd.model(t_end=0.5)
def thrown(speed=1.0, first=0.0, second=0.0, breakpoint=0.25, top=0.0):
    """Ball that is thrown up; events switch off a force at the times `first` and `second`."""
    mech, ball = free_ball(velocity=(1.0, speed), gravity=GRAVITY)
    clock = mech.add(bd.PointMass("clock", 1.0, at=(0.0, 10.0), velocity=(1.0, 0.0)))
    law = bd.piecewise((breakpoint, 1.0), 0.0)
    side = mech.add(bd.Force("side", ball.point, (law, 0.0)))
    mech.observe("clock", clock.point)
    for name, time in (("first", first), ("second", second)):
        if time:
            mech.when("clock.x", time, "up", bd.deactivate(side), name=name)
    if top:
        mech.when("ball.y", top, "up", bd.deactivate(side), name="top")
    return mech


@pytest.mark.parametrize(
    ("by", "values", "message"),
    [
        ("speed", {"first": 0.2, "second": 0.2}, "events first and second act at the same time"),
        ("speed", {"first": 0.25}, "event first acts at a breakpoint of a law"),
        # The speed there is 1e-5 m/s.
        ("speed", {"top": 0.5 / GRAVITY * (1.0 - 1e-10)}, "event top only touches its value at"),
        ("breakpoint", {"breakpoint": 0.5}, "moves the breakpoint of a law at t = 0.5 s across"),
        ("breakpoint", {"breakpoint": 0.0}, "moves the breakpoint of a law at t = 0 s across"),
    ],
)
@pytest.mark.slow(reason="half a second and more")
def test_times_without_derivatives_are_rejected(by, values, message):
    with pytest.raises(bd.BeamdaeError, match=f"sensitivities: .*{message}"):
        bd.sensitivities(thrown, by, parameters=values)


@bd.model(t_end=0.19)
def damped_bounce(gap=0.1, damping=1e3, shaking=0.0):
    """Two masses, connected by a spring and a damper; the lower one bounces once."""
    mech, lower = free_ball((0.0, 0.2), name="lower", gravity=GRAVITY)
    upper = mech.add(bd.PointMass("upper", 0.1, at=(0.0, 0.7)))
    mech.add(bd.Spring("spring", lower.point, upper.point, 50.0, damping))
    mech.add(bd.Force("shaker", upper.point, (0.0, lambda t: shaking * ca.sin(60.0 * t))))
    mech.observe("upper", upper.point)
    distance = bd.LineSurface(mech.ground.at(0.0, 0.2 - gap)).gap(lower.point)
    mech.when(distance, 0.0, "down", bd.impact(distance, 0.5), name="bounce")
    return mech


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_regression_alpha_after_impact_with_stiff_damper(step):
    # The damper relaxes within 90 microseconds, which these steps do not resolve.
    method = bd.GeneralizedAlpha(step=step)
    actual = bd.sensitivities(damped_bounce, "gap", method).sensitivity("upper.y", "gap").iloc[-1]
    exact = bd.sensitivities(damped_bounce, "gap").sensitivity("upper.y", "gap").iloc[-1]
    # The upper mass moves at once with the lower one, after at most a few steps.
    assert actual == pytest.approx(exact, rel=2.0 * step)


@pytest.mark.slow(reason="half a second")
def test_derivatives_of_a_run_that_violates_the_balance_of_energy_are_reported():
    """With this damper, steps of 1 ms miss the position by 0.6 m: the run is wrong."""
    arguments = (damped_bounce, "gap", bd.GeneralizedAlpha(step=1e-3))
    with pytest.warns(bd.BeamdaeWarning, match="energy: the energy imbalance is") as record:
        bd.sensitivities(*arguments, parameters={"damping": 1e7})
    assert any("d(upper.y)/d(gap) more than 100 %" in str(x.message) for x in record)


@pytest.mark.slow(reason="half a second")
def test_alpha_after_impact_with_law_of_time():
    values = {"damping": 1.0, "shaking": 2.0}
    errors = []
    exact = bd.sensitivities(damped_bounce, "gap", bd.Radau(rtol=1e-9), parameters=values)
    for step in (2e-3, 5e-4):
        method = bd.GeneralizedAlpha(step=step)
        actual = bd.sensitivities(damped_bounce, "gap", method, parameters=values)
        columns = [x.sensitivity("upper.y_dot", "gap").iloc[-1] for x in (actual, exact)]
        errors.append(abs(columns[0] / columns[1] - 1.0))
    assert errors[1] < 0.1 * errors[0]
    assert errors[1] < 1e-4


@pytest.mark.slow(reason="three runs of a vehicle")
def test_moving_breakpoint_in_a_model_with_stiff_beams():
    # The run passes the end of the bump, t = 0.35 s. Velocities of generalized-alpha violate the
    # constraints slightly; damping of fast modes must not amplify these errors, by a factor of 3.
    method, t_end, delta = bd.GeneralizedAlpha(step=1e-3, newton_tolerance=1e-12), 0.36, 1.5e-4
    times = np.linspace(0.3, t_end, 13)
    result = bd.sensitivities(
        leaf_spring_vehicle, "duration", method, t_end, parameters={"elements": 2}
    )
    actual = result.trajectories["duration"].at(times)[1].q
    ahead, behind = (
        bd.simulate(leaf_spring_vehicle(elements=2, duration=0.15 + x), method, t_end)
        .trajectory.at(times)[1]
        .q
        for x in (delta, -delta)
    )
    expected = (ahead - behind) / (2.0 * delta)
    # The steps of the runs move with the breakpoint. The derivatives and the differences deviate
    # from those of converged runs by 2 to 3 per cent.
    assert np.abs(actual - expected).max() <= 0.05 * np.abs(expected).max()


@bd.model(t_end=0.15)
def stop_force(stiffness=1e4):
    """Ball that falls on a stop whose force is observed."""
    mech, ball = free_ball((0.0, 0.01), gravity=GRAVITY)
    surface = bd.LineSurface(mech.ground.at(0.0, 0.0))
    stop = mech.add(bd.Contact("stop", ball.point, surface, stiffness))
    mech.observe("stop", stop.force)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_regression_contact_forces_have_derivatives_while_the_contact_is_open():
    # Fixed steps, so that differences of runs have no noise beyond Newton's tolerance.
    method = bd.GeneralizedAlpha(step=1e-3, newton_tolerance=1e-12)
    exact = bd.sensitivities(stop_force, "stiffness", method).sensitivity("stop.N", "stiffness")
    runs = [bd.simulate(stop_force(stiffness=1e4 * (1 + e)), method) for e in (-1e-4, 1e-4)]
    low, high = (run["stop.N"].to_numpy() for run in runs)
    is_open = (low == 0.0) & (high == 0.0)
    assert 0 < np.sum(is_open) < len(exact)
    assert np.all(exact[is_open] == 0.0)
    # Second-order differences at a relative step of 1e-4, except where the contact opens.
    scale = np.abs(exact).max()
    np.testing.assert_allclose(exact, (high - low) / 2.0, rtol=0.0, atol=1e-3 * scale)
    # The contact is closed at 0.06 s, and open at 0.04 s.
    for t_end in (0.06, 0.04):
        end = bd.sensitivities(stop_force, "stiffness", method, t_end=t_end)
        force = bd.quantities.EndValue("stop.N")
        result = bd.gradient(stop_force, force, by="stiffness", integrator=method, t_end=t_end)
        expected = end.sensitivity("stop.N", "stiffness").iloc[-1]
        assert result.derivatives["stiffness"] == pytest.approx(expected, rel=1e-10, abs=1e-15)


@bd.model(t_end=0.5)
def flat_rod(mass=1.0):
    """Rod that falls flat onto both ends, which hit the floor one after the other."""
    mech = bd.Mechanism(gravity=EARTH)
    rod = mech.add(bd.RigidBody("rod", mass, 1.0 / 12.0, center=(0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), (1.0, 0.0))
    for name, x in (("left", -0.5), ("right", 0.5)):
        end = rod.at(x, 1.0)
        mech.observe(name, end)
        gap = floor.gap(end)
        mech.when(gap, crosses=0.0, direction="down", do=bd.impact(gap), name=f"hit {name}")
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_events_that_repeat_at_one_time_are_named_once():
    """Impacts that close each other's gaps were listed up to a hundred times."""
    with pytest.raises(bd.BeamdaeError, match="events hit left and hit right act at the same time"):
        bd.sensitivities(flat_rod, ["mass"], bd.GeneralizedAlpha(0.05))
