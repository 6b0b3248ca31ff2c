"""Sampled inputs: methods continue across the jumps, with consistent accelerations."""

from itertools import pairwise

import numpy as np
import pytest
from benchmarks.cases import pendulum, pendulum_motion
from conformance import integrators
from mechanisms import driven, free_ball, hinged_body, rectangle
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

import beamdae as bd
from beamdae.equations import measures
from beamdae.integrators.radau import stepper as radau_stepper

EVERY = 0.02
METHODS = {
    "Ida": bd.Ida(1e-7),
    "Radau": bd.Radau(1e-7),
    "fixed steps": bd.GeneralizedAlpha(5e-4),
    "stabilized": bd.GeneralizedAlpha(5e-4, formulation="stabilized-index2"),
    "adaptive steps": bd.GeneralizedAlpha(rtol=1e-6),
}


def crank(friction=0.0, law=None, every=EVERY, delay=0):
    """Return a bar that a sampled motor swings up, with a filtered angle."""
    mech, bar = hinged_body(2.0, 0.3, (0.5, 0.0), name="bar", gravity=9.81)
    pin = mech.part("hinge")
    if friction:
        mech.add(bd.Friction("bearing", pin, friction, 0.1, radius=0.05))
    torque = mech.input("torque", unit="N m")
    mech.add(bd.Moment("motor", bar.at(0.0, 0.0), torque))
    angle, rate = (mech.sensor(x, bar.at(0.0, 0.0), x) for x in ("angle", "angle_dot"))
    slow = mech.state("slow", lambda slow, t: (angle + 0.01 * torque - slow) / 0.05)
    law = law or (lambda sample: 30.0 * (0.5 - sample.reads[0]) - 4.0 * sample.reads[1])
    mech.add(bd.Controller("servo", every, [angle, rate, slow], [torque], law, delay=delay))
    mech.observe("center", bar.at(0.5, 0.0))
    mech.observe("pin", pin.reaction)
    return mech


def with_two_rates(**options):
    """Return the crank with a side force that grows by .1 N every .01 s."""
    mech = crank(**options)
    push = mech.input("side force", unit="N")
    mech.add(bd.Force("push", mech.parts["bar"].at(1.0, 0.0), (push, 0.0)))
    mech.add(bd.Controller("second", 0.01, [], [push], lambda sample: 0.1 * sample.index))
    return mech


def integrate_two_rates(times, every=EVERY, delay=0):
    """Return the angle, its rate and the filtered angle at `times` without friction by SciPy."""
    torques, state = [0.0] * delay, np.zeros(3)
    rows = [state]
    samples = [{round(x * k, 9) for k in range(round(times[-1] / x) + 1)} for x in (every, 0.01)]
    points = sorted({round(t, 9) for t in times} | samples[0] | samples[1])
    for begin, end in pairwise(x for x in points if x <= times[-1]):
        if begin in samples[0]:
            torques.append(30.0 * (0.5 - state[0]) - 4.0 * state[1])
        torque, push = torques[-1 - delay], 0.1 * np.floor(begin / 0.01 + 1e-6)

        def rates(_, y, torque=torque, push=push):
            moment = torque - 9.81 * np.cos(y[0]) - push * np.sin(y[0])
            return y[1], moment / 0.8, (y[0] + 0.01 * torque - y[2]) / 0.05

        state = solve_ivp(rates, (begin, end), state, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        if any(abs(end - t) < 1e-9 for t in times):
            rows.append(state)
    return np.array(rows)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    "options",
    [{}, {"delay": 2}, {"every": 0.0005}, {"every": 0.0371}, {"friction": 0.2}],
    ids=["plain", "delay", "one step per sample", "remainder", "friction"],
)
@pytest.mark.parametrize("method", METHODS)
def test_methods_continue_across_samples(method, options):
    run = bd.simulate(with_two_rates(**options), METHODS[method], 0.33, output_step=0.03)
    exact = bd.simulate(with_two_rates(**options), bd.Radau(1e-9), 0.33, output_step=0.03)
    columns = ("center.angle", "center.angle_dot", "slow")
    if "friction" not in options:
        expected = integrate_two_rates(run.t, **options)
        for k, name in enumerate(columns):
            # Second order: (h w)^2 / 12 is 1e-5 of fixed steps of .5 ms for the pole at 5/s.
            atol = 2e-5 * np.ptp(expected[:, k])
            assert_allclose(run[name], expected[:, k], rtol=0.0, atol=atol)
    # In the index-3 form, multipliers approach their values over several steps after each jump.
    is_index3 = method in ("fixed steps", "adaptive steps")
    for name in ("q", "v") if is_index3 else ("q", "v", "lam"):
        values = getattr(exact, name)
        assert_allclose(getattr(run, name), values, atol=2e-5 * np.max(np.abs(values)))
    assert run.quality.energy_imbalance < 1e-5
    # The equations of motion hold on both sides of each jump.
    assert run.quality.max_residual < 1e-4
    # Steps that do not divide the time between samples restart.
    restarts = "every" in options and options["every"] > EVERY and not METHODS[method].rtol
    assert (len(run.trajectory.intervals) > 1) == restarts


@pytest.mark.slow(reason="half a second")
def test_regression_samples_without_a_change_do_not_restart():
    """IDA began at order 1 at each sample, although a saturated law held the same value."""
    held, changing = (
        bd.simulate(crank(law=law), METHODS["Ida"], 0.3).statistics.steps
        for law in (lambda sample: 40.0, lambda sample: 40.0 + sample.index % 2)
    )
    assert held < 0.5 * changing


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("form", ["index3", "stabilized-index2"])
def test_generalized_alpha_remains_of_second_order(form):
    def law(sample):
        return 5.0 * np.sin(40.0 * sample.t)

    exact = bd.simulate(crank(law=law), bd.Radau(1e-9), 0.1, output_step=0.05)
    errors = []
    for steps in (8, 32):
        method = bd.GeneralizedAlpha(EVERY / steps, newton_tolerance=1e-10, formulation=form)
        run = bd.simulate(crank(law=law), method, 0.1, output_step=0.05)
        differences = (np.abs(getattr(run, x) - getattr(exact, x))[1:] for x in ("q", "v", "lam"))
        errors.append([np.max(x) for x in differences])
    assert (np.log2(np.divide(*errors)) > 3.6).all()


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "method", [bd.GeneralizedAlpha(0.1), bd.Radau(1e-6), bd.Ida(1e-6)], ids=type
)
@pytest.mark.parametrize("distance", [6e-13, 2e-12])
def test_regression_impacts_just_before_a_sample_are_kept(method, distance):
    """The method continued with the velocity before the impact."""
    mech, ball = free_ball((0.0, 1.0 - distance), velocity=(0.0, 9.0), gravity=20.0)
    push = mech.input("push", unit="N")
    mech.add(bd.Force("load", ball.point, (push, 0.0)))
    height = mech.sensor("height", ball.point, "y")
    mech.add(bd.Controller("servo", 1.0, [height], [push], lambda sample: 0.0))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    gap = floor.gap(ball.point)
    mech.when(gap, 0.0, "down", bd.impact(gap, 1.0), name="bounce")
    run = bd.simulate(mech, method, 1.2)
    assert run.status.success, run.status.sentence
    # After the impact at 1 s: 11 m/s upward.
    assert_allclose(run["ball.y"].iloc[-1], 11.0 * 0.2 - 10.0 * 0.04, atol=0.02)


def bumper(law, every, outside="hold"):
    """Return a driven mass that passes a narrow peak of a force, a table, after 0.4 m."""
    mech, mass = free_ball(velocity=(1.0, 0.0), name="mass")
    place, speed = (mech.sensor(x, mass.point, x) for x in ("x", "x_dot"))
    push = mech.input("push", unit="N")
    mech.add(bd.Force("motor", mass.point, (push, 0.0)))
    mech.add(bd.Controller("servo", every, [place, speed], [push], law, state=[0.0]))
    peak = bd.table([0.0, 0.4, 0.4003, 0.4006, 0.8], [0.0, 0.0, 2e3, 0.0, 0.0], "pchip", outside)
    mech.add(bd.ForceLaw("bump", mass.point, lambda mass, t: (-peak(mass.position[0]), 0.0)))
    return mech


@pytest.mark.parametrize("every", [1e-3, 0.07])
@pytest.mark.parametrize(
    "method", [bd.Radau(1e-5), bd.GeneralizedAlpha(rtol=1e-5)], ids=["Radau", "adaptive steps"]
)
def test_regression_peaks_between_samples_keep_the_states_of_laws(method, every):
    """The restart before a peak changed numbers of samples by rounding errors."""

    def law(sample):
        sample.state[0] += 1.0
        return 2.0 * (1.0 + 0.3 * sample.t - sample.reads[1])

    run = bd.simulate(bumper(law, every), method, 1.0, output_step=0.1)
    fine = bd.simulate(bumper(law, every), bd.GeneralizedAlpha(2e-5), 1.0, output_step=0.1)
    assert run.status.success, run.status.sentence
    assert_allclose(run["mass.x"], fine["mass.x"], rtol=5e-3)
    counts = np.concatenate([interval.state.q[:, -1] for interval in run.trajectory.intervals])
    assert_array_equal(counts, np.round(counts))
    assert counts[-1] == np.ceil(1.0 / every - 1e-9)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_tables_end_runs_before_the_law_fails_outside():
    """Steps across several samples leave the table before they are checked."""

    def law(sample):
        if sample.reads[0] > 0.85:
            raise ValueError("too far")
        sample.state[0] += 1.0
        return 2000.0

    mech = bumper(law, 1e-3, outside="error")
    run = bd.simulate(mech, bd.Radau(1e-5), 1.0, output_step=1e-3)
    assert run.status.kind == "limited"
    assert "leaves the range 0 to 0.8" in run.status.sentence
    last = run.trajectory.intervals[-1].state.q[-1]
    assert last[0] == pytest.approx(0.8, abs=1e-9)
    assert last[-1] == np.ceil(run.trajectory.end / 1e-3)


def pushed(every, law):
    """Return a mass on a spring that a sampled force pushes."""
    mech, mass = free_ball(name="mass")
    push = mech.input("push", unit="N")
    place = mech.sensor("place", mass.point, "x")
    mech.add(bd.Force("motor", mass.point, (push - 400.0 * place, 0.0)))
    mech.add(bd.Controller("servo", every, [place], [push], lambda sample: law(sample.t)))
    return mech


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("start", [0.0, 0.6], ids=["moves", "rests at first"])
def test_frequent_samples_keep_the_tolerance(start, rtol):
    mech = pushed(1e-3, lambda t: 4.0 * (t >= start - 1e-9))
    run = bd.simulate(mech, bd.Radau(rtol), 1.0, output_step=0.01)
    exact = 0.01 * (1.0 - np.cos(20.0 * np.clip(run.t - start, 0.0, None)))
    assert_allclose(run["mass.x"], exact, atol=0.2 * rtol)
    assert run.integrator["amplitudes"]["mass"] > 0.0


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("options", "reason"),
    [({"max_steps": 100}, "max_steps = 100"), ({"time_limit": 1e-9}, "time limit")],
)
def test_limits_hold_with_frequent_samples(options, reason):
    mech = pushed(1e-3, lambda t: 4.0)
    run = bd.simulate(mech, bd.Radau(**options), 1.0)
    assert run.status.kind == "limited"
    assert reason in run.status.sentence
    stopped = bd.simulate(mech, bd.Radau(), 1.0, progress=lambda t: "enough" if t > 0.3 else None)
    assert stopped.status.sentence.endswith("enough")
    assert 0.3 < stopped.trajectory.end < 0.4


@pytest.mark.parametrize("angle", [1.0, 2.2])
def test_jumps_of_inputs_do_not_restart_runs_with_friction_without_reactions(angle):
    """Reactions of rounding errors beside accelerations of 1 m/s^2 counted as not converged."""
    mech, direction = bd.Mechanism(), np.array([np.cos(angle), np.sin(angle)])
    slider = mech.add(bd.RigidBody("slider", mass=1.0, inertia=0.1))
    center = slider.at(0.0, 0.0)
    guide = bd.Prismatic("guide", mech.ground.at(0.0, 0.0), center, direction=tuple(direction))
    mech.add(bd.Friction("friction", mech.add(guide), 0.3, 0.01, radius=0.05))
    force = mech.input("force", unit="N")
    mech.add(bd.Force("push", center, tuple(force * direction)))
    travel = mech.sensor("travel", center, "x")
    law = lambda sample: np.sin(20.0 * sample.t)  # noqa: E731
    mech.add(bd.Controller("servo", 0.01, [travel], [force], law))
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=1.5)
    assert run.status.success
    assert len(run.trajectory.intervals) == 1


# Dense output is as accurate as the steps, for every method.

ANGLE, SPEED, GRAVITY = 0.4 * np.pi, 0.5, 9.81
SWING = pendulum(GRAVITY, ANGLE, SPEED).equations
NAMES = ("q", "v", "lam")


def errors(state, t):
    exact = pendulum_motion(GRAVITY, ANGLE, SPEED, t)
    return np.array([np.max(np.abs(getattr(state, x) - exact[x])) for x in NAMES])


def between(interval):
    """Return times at tenths of all steps."""
    inside = np.linspace(0.1, 0.9, 9) * np.diff(interval.t)[:, None]
    return (interval.t[:-1, None] + inside).ravel()


@integrators(rtol=1e-5, step=2e-3)
def test_dense_output_is_as_accurate_as_the_steps(integrator):
    solution = bd.simulate(SWING, integrator, 2.0)
    (interval,) = solution.trajectory.intervals
    t = between(interval)
    ratio = errors(interval.at(t), t) / errors(interval.state, interval.t)
    bounds = np.array([1.5, 1.5, 1.5])
    if integrator.method == "Radau":
        # Velocities of Radau are of order 5 at the steps and of order 4 between them.
        bounds[1] = 10.0
    if integrator.method == "Ida":
        # Accelerations are derivatives of the interpolation polynomial, of one order less (1.76
        # with the tolerance of two periods).
        bounds[2] = 2.0
    assert (ratio < bounds).all(), ratio


def test_radau_dense_output_orders_are_five_four_and_three(monkeypatch):
    # As in test_integrator_orders: the longest steps allowed, and no Newton error.
    monkeypatch.setattr(radau_stepper, "_MAX_ITERATION_FRACTION", 1e-12)
    errors_by_step = []
    for count in (80, 160):
        solution = bd.simulate(SWING, bd.Radau(0.02, max_step=2.0 / count), 2.0)
        (interval,) = solution.trajectory.intervals
        t = between(interval)
        errors_by_step.append(errors(interval.at(t), t))
    assert_allclose(np.log2(np.divide(*errors_by_step)), [5.0, 4.0, 3.0], rtol=0.0, atol=0.2)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_axial_force_of_a_slow_rod_between_the_steps(rtol):
    # Corrections of positions by the joints must not stretch the rod.
    radius, length, speed, force = 0.06, 0.28, 1.2, 100.0
    section = rectangle(0.03, damping=2e-5)
    mech, crank = driven(
        bd.RigidBody("crank", mass=1.0, inertia=0.01, center=(0.0, 0.0)), lambda t: speed * t
    )
    line = bd.Line((radius, 0.0), (radius + length, 0.0))
    rod = mech.add(bd.Beam("rod", line, section, elements=8))
    ram = mech.add(bd.PointMass("ram", 0.1, at=(radius + length, 0.0)))
    mech.add(bd.Revolute("crank pin", crank.at(radius, 0.0), rod.start))
    mech.add(bd.Revolute("wrist pin", rod.end, ram.point))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), ram.point, direction=(1.0, 0.0)))
    mech.add(bd.Force("load", ram.point, (-force, 0.0)))
    mech.observe("end", rod.section_forces(0.99 * length))
    solution = bd.simulate(mech, bd.Radau(rtol), t_end=5.0)
    end = solution["end.N"][1.0:]
    angle = np.arcsin(radius / length * np.sin(speed * end.index))
    # The inertia of the rod and of the ram is less than 0.2 % of the load.
    assert_allclose(end, -force / np.cos(angle), rtol=5e-3)


def four_bar():
    """Four-bar with a damped coupler, run up in 0.02 s."""
    alloy = bd.Material(E=70e9, nu=0.3, rho=2700.0)
    strip = rectangle(0.004, damping=1e-3, material=alloy)
    mech, crank = driven(
        bd.RigidBody("crank", 0.3, inertia=0.003, center=(0.0, 0.1)), bd.run_up(1.0, 0.02)
    )
    coupler = mech.add(bd.Beam("coupler", bd.Line((0.0, 0.2), (0.5, 0.4)), strip, elements=2))
    rocker = mech.add(bd.RigidBody("rocker", 0.5, inertia=0.01, center=(0.5, 0.2)))
    mech.add(bd.Revolute("B", crank.at(0.0, 0.2), coupler.start))
    mech.add(bd.Revolute("C", coupler.end, rocker.at(0.5, 0.4)))
    mech.add(bd.Revolute("D", mech.ground.at(0.5, 0.0), rocker.at(0.5, 0.0)))
    mech.observe("section", coupler.section_forces(0.2))
    return bd.equations_of_motion(mech)


FOUR_BAR = four_bar()


@integrators(rtol=1e-4, step=1e-3, slow=("alpha adaptive",))
def test_regression_damped_section_forces_do_not_spike_between_steps(integrator):
    """Forces of 100 N at the steps were thousands of N between them, around the run-up."""
    solution = bd.simulate(FOUR_BAR, integrator, 0.04)
    assert solution.status.success, solution.status.sentence
    observed = measures.ObservedRows(FOUR_BAR)
    for interval in solution.trajectory.intervals:
        t = between(interval)
        inside, at_steps = (
            np.abs(observed(np.stack([x, 0.0 * x + interval.branch], -1), *y))
            for x, y in ((t, interval.at(t)), (interval.t, interval.state))
        )
        # A polynomial of degree 4 exceeds the values of its last steps by 2.2 at most if these
        # are equally long; the factor was in the hundreds.
        assert (inside.max(axis=0) < 2.3 * at_steps.max(axis=0)).all()
