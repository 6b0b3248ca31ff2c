"""Newmark, HHT and generalized-alpha: parameters, orders, damping and adaptive steps."""

from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest
from benchmarks.cases import AREVALO, pendulum, pendulum_motion
from governor import governor
from mechanisms import STEEL, free_ball, hinged_body, mass_on_rail, rectangle, symbols
from numpy.testing import assert_allclose
from quick_return import quick_return

import beamdae as bd

FAMILIES = ("generalized-alpha", "hht", "newmark")
MEMBERS = [
    (family, rho)
    for family in FAMILIES
    for rho in ((0.5, 0.6, 0.8, 1.0) if family == "hht" else (0.0, 0.3, 0.8, 1.0))
]

ADAPTIVE = bd.GeneralizedAlpha(rtol=1e-4)
# Away from rest and from turning points, with reactions whose derivatives do not vanish.
SWING = pendulum(9.81, 0.4 * np.pi, 0.5).equations
SMOOTH = {
    "Arevalo": (AREVALO.equations, AREVALO.answer, 1.5),
    "pendulum": (SWING, partial(pendulum_motion, 9.81, 0.4 * np.pi, 0.5), 2.0),
}
# Each case and each form once; the other pairs are slow tests.
every_smooth_case = pytest.mark.parametrize(
    ("case", "formulation"),
    [
        ("Arevalo", "index3"),
        ("pendulum", "stabilized-index2"),
        pytest.param(
            "Arevalo", "stabilized-index2", marks=pytest.mark.slow(reason="half a second and more")
        ),
        pytest.param("pendulum", "index3", marks=pytest.mark.slow(reason="half a second and more")),
    ],
)


def oscillator(omega):
    """x'' + omega^2 x = 0 from x = 1."""
    t, q, v = symbols(1)
    return bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=-(omega**2) * q, q0=[1], v0=[0])


def pushed_particle(law):
    """Particle of 2 kg under a force along its rail."""
    mech, particle = mass_on_rail(2.0, name="particle")
    mech.add(bd.Force("push", particle.point, (law, 0.0)))
    return mech


def steps_of(solution):
    return np.concatenate([np.diff(segment.t) for segment in solution.trajectory.intervals])


def errors(solution, answer):
    """Return the largest errors of q, v and lam over the output times."""
    exact = answer(solution.t)
    return np.array(
        [np.max(np.abs(getattr(solution, name) - exact[name])) for name in ("q", "v", "lam")]
    )


# The family -----------------------------------------------------------------------------------


def test_labels_and_reports_contain_family_and_step_or_tolerance():
    assert bd.GeneralizedAlpha(step=1e-3).label == "GeneralizedAlpha(step=0.001)"
    newmark = bd.GeneralizedAlpha(family="newmark", rho_inf=1.0, rtol=1e-4)
    assert newmark.label == "GeneralizedAlpha(family=newmark, rtol=0.0001)"
    report = bd.simulate(pushed_particle(1.0), newmark, 0.1).integrator
    assert (report["family"], report["rtol"]) == ("newmark", 1e-4)
    assert 0.0 < report["local_tolerance"] < 1e-4


def amplification(method, z):
    """Return the map of (q, h v, h^2 q'', h^2 a) over one step of an oscillation, z = omega h.

    Arnold & Bruls 2007, equations (2) and (3).
    """
    # Rows of the unknowns (q1, v1, q1'', a1), and of the state before the step.
    after = [
        [1.0, 0.0, 0.0, -method.beta],
        [0.0, 1.0, 0.0, -method.gamma],
        [z**2, 0.0, 1.0, 0.0],
        [0.0, 0.0, method.alpha_f - 1.0, 1.0 - method.alpha_m],
    ]
    before = [
        [1.0, 1.0, 0.0, 0.5 - method.beta],
        [0.0, 1.0, 0.0, 1.0 - method.gamma],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, method.alpha_f, -method.alpha_m],
    ]
    return np.linalg.solve(after, before)


def test_members_are_stable_and_damp_infinite_frequencies_by_rho_inf():
    for family, rho in MEMBERS:
        method = bd.GeneralizedAlpha(family=family, rho_inf=rho)
        radii = [
            np.max(np.abs(np.linalg.eigvals(amplification(method, z))))
            for z in np.append(np.logspace(-2, 4, 25), 1e5)
        ]
        # Rounding errors of double and triple eigenvalues have the powers 1/2 and 1/3.
        assert max(radii) <= 1.0 + 1e-4
        assert_allclose(radii[-1], rho, rtol=0.0, atol=2e-3)


@pytest.mark.parametrize(("family", "rho_inf"), MEMBERS)
def test_steps_are_those_of_the_parameters(family, rho_inf):
    omega, h = 3.0, 0.2
    method = bd.GeneralizedAlpha(h, rho_inf, family=family, start="plain", newton_tolerance=1e-12)
    run = bd.simulate(oscillator(omega), method, 10.0 * h, h)
    matrix, acceleration = amplification(method, omega * h), -((omega * h) ** 2)
    state, states = np.array([1.0, 0.0, acceleration, acceleration]), []
    for _ in range(10):
        state = matrix @ state
        states.append(state)
    assert_allclose(run.q[1:, 0], np.array(states)[:, 0], rtol=0.0, atol=1e-10)
    assert_allclose(run.v[1:, 0], np.array(states)[:, 1] / h, rtol=0.0, atol=1e-9)


# Adaptive steps -------------------------------------------------------------------------------


@every_smooth_case
@pytest.mark.parametrize(("family", "rho_inf"), [("generalized-alpha", 0.8), ("hht", 0.6)])
def test_adaptive_steps_are_second_order(case, family, rho_inf, formulation):
    """Without the conversion of the accelerations when a step changes, multipliers are not."""
    equations, answer, t_end = SMOOTH[case]
    errors_by_rtol, steps = [], []
    for rtol in (1e-5, 1e-6):
        integrator = bd.GeneralizedAlpha(
            rho_inf=rho_inf, formulation=formulation, family=family, rtol=rtol,
            newton_tolerance=1e-10,
        )  # fmt: skip
        solution = bd.simulate(equations, integrator, t_end, t_end / 200)
        errors_by_rtol.append(errors(solution, answer))
        steps.append(solution.statistics.steps)
    # Multipliers of Arevalo's problem only: they are not in the error test, which lets the step
    # of a pendulum grow where the jerk passes zero, at the cost of their error there.
    components = slice(0, 3 if case == "Arevalo" else 2)
    ratio = (errors_by_rtol[0] / errors_by_rtol[1])[components]
    # Errors proportional to rtol with steps proportional to its root.
    assert_allclose(ratio, 10.0, rtol=0.15)
    assert_allclose(np.log(ratio) / np.log(steps[1] / steps[0]), 2.0, rtol=0.0, atol=0.2)
    assert np.all(errors_by_rtol[1] < errors_by_rtol[0])


def test_steps_follow_the_motion():
    # A push of 0.1 s in a run of 5 s, without a breakpoint.
    def push(t):
        return 100.0 * np.exp(-(((t - 1.0) / 0.1) ** 2))

    solution = bd.simulate(pushed_particle(push), bd.GeneralizedAlpha(rtol=1e-5), 5.0)
    (segment,) = solution.trajectory.intervals
    h, t = np.diff(segment.t), segment.t[1:]
    during = h[(t > 0.9) & (t < 1.1)]
    # The longest step is a twentieth of the run; the last steps are equal.
    assert_allclose(np.max(h[t > 2.0]), 0.25, rtol=0.1)
    assert np.max(during) < 0.01
    assert_allclose(solution.v[-1, 0], 5.0 * np.sqrt(np.pi), rtol=1e-3)
    # Short steps during the push only, not in the whole run.
    assert solution.statistics.steps < 0.2 * 5.0 / np.mean(during)


def test_steps_are_at_most_a_quarter_of_the_law_time_scale():
    solution = bd.simulate(pushed_particle(bd.sine(1.0, 2.0)), bd.GeneralizedAlpha(rtol=0.1), 5.0)
    longest = np.max(steps_of(solution)) / solution.equations.time_scale
    assert 0.2 < longest <= 0.25 * (1.0 + 1e-12)


def test_breakpoints_are_hit_and_surrounded_by_first_and_equal_steps():
    # The remainder is split into two equal steps instead of a tiny one.
    for breakpoint in (0.1234567, 0.12345):
        law = bd.piecewise((breakpoint, 5.0), 0.0)
        solution = bd.simulate(pushed_particle(law), ADAPTIVE, 1.0)
        first, second = (segment.t for segment in solution.trajectory.intervals)
        assert (first[0], first[-1], second[0], second[-1]) == (0.0, breakpoint, breakpoint, 1.0)
        for t in (first, second):
            h = np.diff(t)
            assert_allclose(h[0], 1e-3, rtol=1e-9)
            assert_allclose(h[-1], h[-2], rtol=1e-6)
            assert np.min(h) > 0.9e-3
        assert_allclose(solution.v[-1, 0], 2.5 * breakpoint, rtol=1e-12)


def test_steps_begin_within_an_interval_shorter_than_the_first_step():
    law = bd.piecewise((0.5, 0.0), (0.5002, 5.0), 0.0)
    times = bd.simulate(pushed_particle(law), ADAPTIVE, 1.0).trajectory.intervals[1].t
    assert (times[0], times[-1]) == (0.5, 0.5002)
    assert len(times) > 2


# Failures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("force", "rtol", "kind", "words"),
    [
        (lambda t: ca.sqrt(0.5 - t), 1e-3, "failed", "not finite at a step of"),
        (lambda t: ca.sqrt(0.5 - t), 1e-6, "failed", "not finite at a step of"),
        # The velocity becomes infinite, too.
        (lambda t: 1.0 / (0.5 - t) ** 2, 1e-3, "limited", "steps have shrunk to"),
    ],
)
def test_adaptive_steps_approach_the_singularity_of_a_law(force, rtol, kind, words):
    t, q, v = (ca.SX.sym(name) for name in "tqv")
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1], force=force(t), q0=[0], v0=[0])
    solution = bd.simulate(system, replace(ADAPTIVE, rtol=rtol), 1.0, 1e-3)
    assert solution.status.kind == kind
    assert words in solution.status.sentence
    # Steps are at least 1e-12 of the run.
    assert_allclose(solution.trajectory.end, 0.5, rtol=0.0, atol=1e-5)
    assert np.all(np.isfinite(solution.q))


@pytest.mark.slow(reason="half a second")
def test_regression_reactions_with_friction_converge_in_driven_mechanisms():
    """The joints determine all positions; reactions were up to 9e-4 of their maximum off."""
    loose, tight = (
        bd.simulate(quick_return, bd.GeneralizedAlpha(1e-3, newton_tolerance=x), t_end=1.6).lam
        for x in (1e-6, 1e-10)
    )
    assert_allclose(loose, tight, rtol=0.0, atol=1e-5 * np.max(np.abs(tight)))


@pytest.mark.parametrize(("model", "tolerance"), [(governor, 1e-9), (quick_return, 1e-6)])
def test_regression_rounding_errors_of_short_steps_do_not_end_runs(model, tolerance):
    """Corrections stopped decreasing above the limit, and Newton's iteration failed."""
    method = bd.GeneralizedAlpha(1e-6, newton_tolerance=tolerance)
    run = bd.simulate(model, method, t_end=1e-3)
    assert run.status.success, run.status


def test_regression_tiny_reactions_with_friction_do_not_end_runs():
    """At the start of a Gaussian pulse, their reciprocals overflowed: "residual is not finite"."""
    mech, rod = hinged_body(1.0, 1.0 / 12.0, (0.5, 0.0))
    mech.add(bd.Friction("rubbing", mech.part("hinge"), 0.3, friction_speed=0.01, radius=0.01))

    def pulse(t):
        return 10.0 * np.exp(-(((t - 0.03) / 0.001) ** 2))

    mech.add(bd.Force("push", rod.at(1.0, 0.0), (0.0, pulse)))
    run = bd.simulate(mech, bd.GeneralizedAlpha(1e-4), t_end=0.04)
    assert run.status.success, run.status
    assert 4.0 < np.max(np.abs(run.lam)) < 6.0


# Starts of generalized-alpha in which stiff parts turn: forces from the first step on.

SPEED, STEP = 10.0, 1e-3
STIFFNESS, STRETCH = 1e8, 1e-6


def turning_beam(law=None):
    """Return a beam of exact formulation on a pin, turned by a driver if there is a law."""
    section = rectangle(0.02, damping=1e-4)
    mech = bd.Mechanism()
    axis = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", axis, section, elements=2, formulation="exact"))
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", root, beam.start))
    if law is not None:
        mech.add(bd.Driver("motor", root, beam.start, law))
    mech.observe("middle", beam.section_forces(s=0.5))
    return mech


def centrifugal_force(section_area=4e-4):
    return STEEL.rho * section_area * SPEED**2 * (1.0 - 0.5**2) / 2.0


@bd.model(t_end=0.02)
def slinger(speed=SPEED, length=1.0, gap=0.1, filling=2.0):
    """Ball on a stiff spring that turns towards a stiff wall, and a filter of its height."""
    mech, ball = free_ball((length, 0.0), velocity=(0.0, speed))
    pivot = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("arm", pivot, ball.point, STIFFNESS, free_length=length - STRETCH))
    wall = bd.LineSurface(mech.ground.at(0.0, gap), direction=(-1.0, 0.0))
    mech.add(bd.Contact("wall", ball.point, wall, 1e5))
    height = mech.sensor("height", ball.point, "y")
    mech.state("level", lambda level, t: filling * (height - level), start=0.1)
    return mech


@pytest.mark.parametrize("rho_inf", [0.0, 0.8, 1.0])
def test_regression_steady_rotation_has_no_axial_vibrations(rho_inf):
    # 84 % (rho_inf = 0.8) of the force at this step.
    method = bd.GeneralizedAlpha(STEP, rho_inf)
    run = bd.simulate(turning_beam(), method, 0.1, output_step=STEP, start=bd.rotation(SPEED))
    np.testing.assert_allclose(run["middle.N"], centrifugal_force(), rtol=1e-3)


def test_regression_rotation_after_a_breakpoint_has_no_axial_vibrations():
    # 91 % of the force from the end of the run-up on.
    law = bd.run_up(SPEED, 0.2)
    run = bd.simulate(turning_beam(law), bd.GeneralizedAlpha(STEP), 0.3, output_step=STEP)
    late = run.t > 0.2  # the beam still bends, which changes the force by 1.5 %
    np.testing.assert_allclose(run["middle.N"][late], centrifugal_force(), rtol=0.02)


@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_regression_stiff_spring_turns_without_vibrations(step):
    # 187 N and 109 N at these steps, instead of 100 N.
    run = bd.simulate(slinger(gap=9.0), bd.GeneralizedAlpha(step), output_step=step)
    force = STIFFNESS * (np.hypot(run["ball.x"], run["ball.y"]) - 1.0 + STRETCH)
    np.testing.assert_allclose(force, SPEED**2, rtol=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_derivatives_agree_with_runs():
    names, method = (
        ["speed", "length", "filling"],
        bd.GeneralizedAlpha(STEP, newton_tolerance=1e-12),
    )
    forward = bd.sensitivities(slinger, names, method, output_step=STEP, estimate_error=False)
    columns = ("ball.x", "level")
    for name in names:
        value = slinger.parameters[name]
        delta = 1e-4 * value
        above, below = (
            bd.simulate(slinger(**{name: value + d}), method, output_step=STEP)
            for d in (delta, -delta)
        )
        for column in columns:
            expected = (above[column] - below[column]) / (2.0 * delta)
            actual = forward.sensitivity(column, name)
            np.testing.assert_allclose(
                actual, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max()
            )
    for column in columns:
        objective = bd.quantities.EndValue(column)
        adjoint = bd.gradient(slinger, objective, names, method, estimate_error=False)
        for name in names:
            expected = forward.sensitivity(column, name).iloc[-1]
            assert adjoint.derivatives[name] == pytest.approx(expected, rel=1e-9)
