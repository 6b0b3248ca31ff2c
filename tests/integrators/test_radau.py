"""Radau IIA: coefficients, single steps, error estimate and step control."""

import casadi as ca
import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd
from beamdae.integrators.error_control import MotionScales
from beamdae.integrators.radau import stages, step_loop
from beamdae.integrators.radau.coefficients import COMPLEX_EIGENVALUE, REAL_EIGENVALUE, A, C, T
from beamdae.integrators.radau.stages import estimate_error, solve_stages
from beamdae.integrators.radau.stepper import StepTolerance
from beamdae.integrators.run_plan import plan_run
from beamdae.native import loop_functions, loops
from beamdae.native.llvm import MachineCodeError
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR


def oscillator(omega, damping=0.0):
    """q'' + 2 damping omega q' + omega^2 q = 0 from q = 0.3, q' = 0.7 omega."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q"), ca.SX.sym("v")
    force = -(omega**2) * q - 2.0 * damping * omega * v
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=1.0, force=force, q0=[0.3], v0=[0.7 * omega]
    ).equations


def pushed_particle(law):
    mech = bd.Mechanism()
    particle = mech.add(bd.PointMass("particle", 2.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", particle.point, (law, 0.0)))
    return mech


@pytest.fixture
def interpreted(monkeypatch):
    """Run loops in plain Python."""

    def raise_unavailable(*_, **__):
        raise MachineCodeError("it is not wanted")

    monkeypatch.setattr(loops, "CompiledLoop", raise_unavailable)


def one_step(equations, h):
    """Solve the stages of one step from the start to rounding and return the workspace."""
    plan = plan_run(equations, np.array([0.0, h]))
    method = bd.Radau(linear_solver="dense").method_on(plan)
    method.begin(0.0, h, 0.5 * h, plan.state)
    run = method._run
    rates = run.yp[: 2 * equations.n]
    run.iteration_weights[:] = 1e13 / np.maximum(np.abs(rates) * h, 1.0)
    run.velocity_weights[:] = run.iteration_weights[equations.n :]
    run.velocity_rounding_weights[:] = np.inf
    assert solve_stages(run, h, True) == DONE
    return run


# The method --------------------------------------------------------------------------------------


def test_the_coefficients_are_those_of_radau_iia():
    b = A[2]
    for k in range(1, 6):
        assert_allclose(b @ C ** (k - 1), 1.0 / k, rtol=1e-14)
    for k in range(1, 4):
        assert_allclose(A @ C ** (k - 1), C**k / k, rtol=1e-14)
    # radau5.f: U1, ALPH and BETA before they are inverted.
    u = (6.0 + 81.0 ** (1 / 3) - 9.0 ** (1 / 3)) / 30.0
    alpha = (12.0 - 81.0 ** (1 / 3) + 9.0 ** (1 / 3)) / 60.0
    beta = (81.0 ** (1 / 3) + 9.0 ** (1 / 3)) * np.sqrt(3.0) / 60.0
    assert_allclose(REAL_EIGENVALUE, 1.0 / u, rtol=1e-13)
    assert_allclose(COMPLEX_EIGENVALUE, 1.0 / complex(alpha, -beta), rtol=1e-13)


def test_the_transformation_decouples_the_stages():
    blocks = np.zeros((3, 3))
    blocks[0, 0] = REAL_EIGENVALUE
    blocks[1:, 1:] = [
        [COMPLEX_EIGENVALUE.real, -COMPLEX_EIGENVALUE.imag],
        [COMPLEX_EIGENVALUE.imag, COMPLEX_EIGENVALUE.real],
    ]
    assert_allclose(np.linalg.solve(A, T), T @ blocks, rtol=0.0, atol=1e-13)
    assert_allclose(T[2], [1.0, 1.0, 0.0], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("z", [0.1, 1.0, 10.0, 1e3, 1e6])
def test_a_step_multiplies_an_oscillation_by_the_stability_function(z, interpreted):
    omega = 50.0
    run = one_step(oscillator(omega), z / omega)
    y = run.y + T[2] @ run.w
    # v + i omega q is proportional to exp(i omega t). Hairer & Wanner, section IV.3: R(z) of the
    # method, which is L-stable.
    x = 1j * z
    factor = (1.0 + 0.4 * x + 0.05 * x**2) / (1.0 - 0.6 * x + 0.15 * x**2 - x**3 / 60.0)
    expected = factor * omega * (0.7 + 0.3j)
    assert_allclose(y[1] + 1j * omega * y[0], expected, rtol=0.0, atol=1e-12 * omega)


@pytest.mark.parametrize("damping", [0.0, 0.4])
@pytest.mark.parametrize("z", [0.1, 3.0, 1e4])
def test_the_error_estimate_is_that_of_radau5(z, damping, interpreted):
    omega = 50.0
    h = z / omega
    run = one_step(oscillator(omega, damping), h)
    y = run.y
    jacobian = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])
    stage_changes = np.linalg.solve(
        np.eye(6) - h * np.kron(A, jacobian), np.kron(A, h * jacobian) @ np.tile(y, 3)
    ).reshape(3, 2)
    # Hairer & Wanner, section IV.8, up to (8.19).
    root = np.sqrt(6.0)
    e = np.array([-13.0 - 7.0 * root, -13.0 + 7.0 * root, -1.0]) / (3.0 * REAL_EIGENVALUE)
    matrix = REAL_EIGENVALUE / h * np.eye(2) - jacobian
    expected = np.linalg.solve(matrix, jacobian @ y + REAL_EIGENVALUE / h * e @ stage_changes)
    estimate_error(run, h)
    assert_allclose(run.error, expected, rtol=1e-8, atol=1e-12 * np.abs(y).max())


@pytest.mark.slow(reason="half a second")
def test_cubic_force_is_integrated_exactly():
    # v by quadrature of degree 4, q by the condition b A c^3 = 1/20 of order 5.
    mech = pushed_particle(lambda t: 2.0 * (1.0 + t**3))
    solution = bd.simulate(mech, bd.Radau(0.1, max_step=1.0), 1.0, 1.0)
    assert_allclose(solution.v[-1, 0], 1.25, rtol=1e-12)
    assert_allclose(solution.q[-1, 0], 0.55, rtol=1e-12)


# Newton's iteration ------------------------------------------------------------------------------


def test_factors_are_reused_while_the_step_is_constant():
    # A linear system with equal steps after the first few.
    steps = bd.simulate(pushed_particle(3.0), bd.Radau(1e-6, max_step=1e-3), 1.0).statistics
    assert steps.steps > 1000
    # Real and complex factorizations.
    assert steps.factorizations <= 12
    assert steps.newton_failures == steps.rejected_steps == 0
    # One iteration on three stages in each step, two in the first step.
    assert steps.residual_calls == 3 * (steps.steps + 1)


def test_factors_are_reused_while_the_step_changes_little():
    steps = bd.simulate(oscillator(5.0), bd.Radau(1e-8), 5.0).statistics
    # New factors in every step would require at least two factorizations per step.
    assert steps.factorizations < steps.steps


@pytest.mark.parametrize("tested", [(True, True), (True, False), (False, False)])
def test_iteration_weights_include_velocities(tested):
    """Over a short step a negligible position error is a velocity error of 100 m/s."""
    scales = MotionScales(np.array([2.0, 1.0]), np.array([4.0, 1.0]), 5.0, 1.0)
    tolerance = StepTolerance(1e-4, scales, np.array(tested))
    assert_allclose(1.0 / tolerance.weights, 1e-4 * np.array([2.0, 1.0, 10.0, 5.0]), rtol=1e-14)
    expected = tolerance.weights * np.array([True, True, *tested])
    assert_allclose(tolerance.test_weights, expected, rtol=0.0)
    bounds = np.concatenate(tolerance.iteration_weights)
    assert_allclose(bounds, tolerance.weights / 0.03, rtol=1e-14)


def test_rounding_bounds_the_iteration_in_short_steps(interpreted):
    run = one_step(oscillator(50.0), 1e-3)
    run.velocity_weights[:], run.velocity_rounding_weights[:] = 7.0, 1e10
    for h, expected in ((1e-3, 7.0), (1e-11, 0.1)):
        solve_stages(run, h, True)
        assert_allclose(run.iteration_weights[1:], expected, rtol=1e-14)


def test_tolerances_are_at_least_position_rounding():
    tolerance = StepTolerance(
        1e-9, MotionScales(np.array([1e-6, 1.0]), np.ones(2), 1.0, 1.0), np.zeros(2, bool)
    )
    assert_allclose(1.0 / tolerance.weights[:2], [1e-14, 1e-9], rtol=1e-14)
    assert_allclose(tolerance.rounding_weights, 1e14, rtol=1e-14)
    assert np.all(1.0 / tolerance.iteration_weights[0] >= 1e-14 * (1.0 - 1e-12))


@pytest.mark.slow(reason="thousands of steps")
def test_newton_failures_halve_the_step_and_are_counted(interpreted, monkeypatch):
    usual = bd.simulate(pendulum, bd.Radau(1e-4), t_end=0.5)
    for module in (step_loop, stages):
        monkeypatch.setattr(module, "MAX_ITERATIONS", 3)
    impatient = bd.simulate(pendulum, bd.Radau(1e-4), t_end=0.5)
    assert impatient.status.success
    assert impatient.statistics.newton_failures > usual.statistics.newton_failures > 0
    assert impatient.statistics.steps > usual.statistics.steps
    assert_allclose(impatient.q, usual.q, rtol=0.0, atol=1e-4)


@pytest.mark.slow(reason="a fifth of a second")
def test_permanent_newton_failure_fails_the_run(interpreted, monkeypatch):
    monkeypatch.setattr(stages, "MAX_ITERATIONS", 1)
    monkeypatch.setattr(stages, "FIRST_RATE", 1.0)
    solution = bd.simulate(pendulum, bd.Radau(1e-4), t_end=1.0)
    assert not solution.status.success
    assert "t = 0 s: Newton's iteration did not converge" in solution.status.sentence
    assert_allclose(solution.t, [0.0], rtol=0.0, atol=0.0)


# Pivots ------------------------------------------------------------------------------------------


def eight_steps(of, rtol=1e-4):
    """Return the rows of eight steps, the workspace, and the number of calls of the loop."""
    equations = bd.equations_of_motion(of())
    plan = plan_run(equations, np.array([0.0, 1.0]))
    method = bd.Radau(rtol).method_on(plan)
    method.begin(0.0, 1.0, 0.5, plan.state)
    run = method._run
    run.most = 8
    entered = 1
    while step_loop.take_radau_steps(run) == NEW_PIVOTS:
        entered += 1
    return run.rows.copy(), run, entered


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("of_pair", [False, True])
def test_step_is_repeated_exactly_after_new_pivots(of_pair, interpreted, monkeypatch):
    rows, run, entered = eight_steps(pendulum)
    assert entered == 1
    requests = []

    def factorize(linear, nonzeros):
        requests.append(linear)
        if len(requests) % 10 == (4 if of_pair else 5):
            return NEW_PIVOTS
        return loop_functions.factorize(linear, nonzeros)

    monkeypatch.setattr(stages, "factorize", factorize)
    again, other, entered = eight_steps(pendulum)
    assert entered > 2
    assert_allclose(again, rows, rtol=0.0, atol=0.0)
    for count in ("residuals", "jacobians", "failures", "rejections", "filled"):
        assert getattr(other, count) == getattr(run, count)


def test_singular_matrix_rejects_only_its_step(interpreted, monkeypatch):
    _, usual, _ = eight_steps(pendulum)
    failures = iter(range(3))

    def factorize(linear, nonzeros):
        if next(failures, None) is not None:
            linear.singular = 1
        return SINGULAR if linear.singular else loop_functions.factorize(linear, nonzeros)

    monkeypatch.setattr(stages, "factorize", factorize)
    _, run, _ = eight_steps(pendulum)
    assert run.filled == 24
    assert run.real_solver.singular == run.complex_solver.singular == 0
    assert run.failures == usual.failures + 2
    assert run.failures == usual.failures + 2
    assert run.t < usual.t


# Steps -------------------------------------------------------------------------------------------


def test_step_length_scales_with_the_order_of_the_estimate():
    steps, tolerances = [], []
    for rtol in (1e-5, 1e-8):
        solution = bd.simulate(oscillator(5.0), bd.Radau(rtol), 5.0)
        steps.append(solution.statistics.steps)
        tolerances.append(solution.integrator["local_tolerance"])
    growth = np.log(steps[1] / steps[0]) / np.log(tolerances[0] / tolerances[1])
    assert_allclose(growth, 0.25, rtol=0.05)


def test_undamped_fast_modes_are_not_resolved():
    solution = bd.simulate(hub_beam, bd.Radau(1e-4))
    assert solution.status.success
    assert solution.integrator["error_control"] == "positions"
    # Axial vibrations at 2.5e5 rad/s, in a run of 2 s.
    assert np.median(np.diff(solution.trajectory.intervals[0].t)) * 2.5e5 > 1000.0
    assert solution.statistics.steps < 500


def test_fully_driven_motion_meets_the_tolerance():
    """Constraints determine it at any step: only the unfiltered error estimates its error."""
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8):
        mech = bd.Mechanism()
        bar = mech.add(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=(0.5, 0.0)))
        origin = mech.ground.at(0.0, 0.0)
        mech.add(bd.Revolute("hinge", origin, bar.at(0.0, 0.0)))
        law = lambda t: 1.0 - np.cos(3.0 * t)  # noqa: E731
        motor = mech.add(bd.Driver("motor", origin, bar.at(0.0, 0.0), law=law))
        mech.observe("motor", motor.reaction)
        solution = bd.simulate(mech, bd.Radau(rtol), 2.0, 0.05)
        exact = 7.2 * np.cos(3.0 * solution.t)
        errors.append(np.max(np.abs(solution.observed["motor.M [N m]"] - exact)) / 7.2)
        assert_allclose(solution.q[:, 2], 1.0 - np.cos(3.0 * solution.t), rtol=0.0, atol=rtol)
    # Multipliers are of order 3: the error falls as rtol^(0.9 * 3/4).
    assert errors[2] < 1e-5
    assert errors[2] < errors[0] / 100.0


@pytest.mark.slow(reason="velocities of an undamped beam are resolved")
def test_error_control_of_positions_allows_longer_steps():
    solutions = [
        bd.simulate(hub_beam, bd.Radau(1e-5, error_control=control))
        for control in ("positions", "velocities")
    ]
    assert all(s.status.success for s in solutions)
    assert solutions[0].statistics.steps < solutions[1].statistics.steps / 3


@pytest.mark.parametrize("moment", [pytest.param(1e-3, marks=pytest.mark.slow), 0.1])
def test_a_sudden_moment_on_a_light_section_starts(moment):
    """Initial accelerations of 2e6 rad/s^2 do not determine the step."""
    mech = bd.Mechanism()
    alloy = bd.Material(E=7e10, nu=0.3, rho=2700.0)
    strip = bd.Section.rectangle(alloy, width=0.02, height=0.005)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, elements=1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Moment("torque", on=beam.end, law=moment))
    mech.observe("tip", beam.end)
    loose, tight = (
        bd.simulate(mech, bd.Radau(rtol), t_end=1e-3, output_step=1e-3) for rtol in (1e-3, 1e-5)
    )
    assert loose.status.success
    assert tight.status.success
    assert loose.statistics.steps < tight.statistics.steps / 2
    tips = [s.observed["tip.angle [rad]"].iloc[-1] for s in (loose, tight)]
    # The section hardly rotates in this time; rtol is relative to its amplitude.
    assert_allclose(tips[0], tips[1], rtol=3e-2, atol=0.0)


def test_newton_failure_fails_the_run():
    # The joint cannot be closed once the line has moved a radius away.
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    reach = ca.vertcat(ca.sumsqr(q) - 1.0, q[0] - t)
    torn = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1, 1], force=[0, 0], constraints=reach, q0=[0, 1], v0=[1, 0]
    )
    solution = bd.simulate(torn, bd.Radau(1e-5, max_steps=5000), 10.0)
    assert not solution.status.success
    assert "stopped at t = 1 s" in solution.status.sentence
    assert np.all(np.isfinite(solution.q))


def test_breakpoints_closer_than_the_smallest_step_are_skipped():
    law = bd.piecewise((1.0, 2.0), (1.0 + 1e-15, 5.0), 2.0)
    solution = bd.simulate(pushed_particle(law), bd.Radau(1e-6), 2.0)
    assert solution.status.success
    assert_allclose(solution.v[-1, 0], 2.0, rtol=1e-9)


def test_a_tight_tolerance_ends_at_rounding():
    solution = bd.simulate(oscillator(3.0), bd.Radau(1e-12, max_steps=20_000), 2.0)
    assert solution.status.success
    exact = 0.3 * np.cos(3.0 * solution.t) + 0.7 * np.sin(3.0 * solution.t)
    assert_allclose(solution.q[:, 0], exact, rtol=0.0, atol=1e-10)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("rtol", [1e-8, 3e-9])
def test_regression_rounding_of_velocities_does_not_collapse_the_step(rtol):
    """Newton's iteration stalled above its bound; steps fell from 3e-3 to 1e-5 s and stayed there.

    At 3e-9, 20 000 steps and 3157 failures of the iteration did not reach the end.
    """
    model = slider_crank(formulation="exact", elements=16)
    solution = bd.simulate(model, bd.Radau(rtol, max_steps=2000), t_end=0.6)
    assert solution.status.success
    # Order 5: from 1e-8 to 3e-9, the number of steps grows by 1.3.
    assert solution.statistics.steps < 600
    assert solution.statistics.newton_failures < 10


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_motion_near_rounding_does_not_reduce_the_step():
    """Velocities in the error test are rounding errors of positions divided by the step.

    The stage moves by 0.3 um, 1e-5 of its size. Steps were 6 times as many, with 478 rejected, or
    the run failed.
    """
    step = 3e-7
    steel = bd.Material.of("steel")
    leaf = bd.Section.rectangle(steel, width=0.02, height=0.3e-3, damping=1e-4)
    mech = bd.Mechanism()
    platform = mech.add(bd.RigidBody.plate("platform", (0.0, 0.05), 0.08, 0.02, mass=0.5))
    for name, x in (("left", -0.03), ("right", 0.03)):
        line = bd.Line((x, 0.0), (x, 0.04))
        beam = mech.add(bd.Beam(name, line, leaf, elements=1, formulation="exact"))
        mech.add(bd.Weld(f"{name} clamp", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Weld(f"{name} screw", beam.end, platform.at(x, 0.04)))
    middle = platform.at(0.0, 0.05)
    x, v = (mech.sensor(name, middle, name) for name in ("x", "x_dot"))
    mech.add(bd.Force("coil", middle, (25e3 * (step - x) - 200.0 * v, 0.0)))
    tight = bd.simulate(mech, bd.Radau(1e-9), 0.05, output_step=5e-3)
    loose = bd.simulate(mech, bd.Radau(1e-6), 0.05, output_step=5e-3)
    assert tight.statistics.steps < 800
    assert tight.statistics.rejected_steps < 50
    assert_allclose(tight["x"], loose["x"], atol=1e-5 * step)


def spinning_strip():
    """Return an undamped strip on a hinge, which a driver turns once per second."""
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=1e-3)
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=4, formulation="exact"))
    origin = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", origin, beam.start))
    mech.add(bd.Driver("motor", origin, beam.start, law=lambda t: 2.0 * np.pi * t))
    return mech


@pytest.mark.parametrize("rtol", [1e-4, 1e-5])
def test_regression_rounding_errors_of_thin_beams_do_not_reduce_the_step(rtol):
    """Newton's iteration stalled at rounding errors that exceeded its bound for velocities.

    In 0.3 s, 239 (1e-4) and 315 (1e-5) of its attempts failed; in 1 s, more than 10 000 steps were
    taken. Now about 30 attempts fail, because the step turns the strip too far.
    """
    start = bd.rotation(2.0 * np.pi)
    solution = bd.simulate(spinning_strip(), bd.Radau(rtol), t_end=0.3, start=start)
    assert solution.status.success
    assert solution.statistics.newton_failures < 100
    assert solution.statistics.steps < 450


@pytest.mark.slow(reason="axial vibrations of an undamped beam are resolved")
def test_regression_a_looser_tolerance_does_not_need_more_steps():
    """Once axial vibrations had decayed, steps at 1e-4 stayed at 1e-6 s: 393 000, now 8600."""
    loose, tight = (
        bd.simulate(spinning_strip(), bd.Radau(rtol, max_steps=50_000), t_end=1.0)
        for rtol in (1e-4, 1e-5)
    )
    assert loose.status.success
    assert tight.status.success
    assert loose.statistics.steps < 1.2 * tight.statistics.steps
