"""Settings, failures, breakpoints and statistics of every integrator."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from benchmarks.cases import PENDULUM, SLIDER_CRANK
from conformance import IDA_FORMS, integrators
from mechanisms import driven, free_ball, hinged_beam, rectangle, symbols
from numpy.testing import assert_allclose

import beamdae as bd

# Limits turn endless runs into failures.
IDA = bd.Ida(rtol=1e-6, max_steps=20_000)
ALPHA = bd.GeneralizedAlpha(step=1e-3)
RADAU = bd.Radau(rtol=1e-6, max_steps=20_000)
every_integrator = integrators(rtol=1e-6, step=1e-3, also=IDA_FORMS, max_steps=20_000)
# Tests in which the form of the equations hardly matters: further forms of Ida are slow.
every_integrator_in_its_form = integrators(
    rtol=1e-6, step=1e-3, also=IDA_FORMS, slow=IDA_FORMS, max_steps=20_000
)


def pushed_particle(law, velocity=0.0):
    """Free particle of 2 kg under a force in x."""
    mech, particle = free_ball(mass=2.0, name="particle", velocity=(velocity, 0.0))
    mech.add(bd.Force("push", particle.point, (law, 0.0)))
    return mech


def guided_particle(law):
    """The same particle on a rail."""
    mech = pushed_particle(law)
    particle = mech.part("particle")
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), particle.point))
    return mech


# Settings -------------------------------------------------------------------------------------


def test_invalid_model_is_rejected():
    """Every public call that takes a model rejects it."""
    calls = {
        "simulate": lambda model: bd.simulate(model, ALPHA, 1.0),
        "equilibrium": bd.equilibrium,
        "modes": bd.modes,
        "linearize": lambda model: bd.linearize(model, inputs=["push"]),
        "periodic": lambda model: bd.periodic(model, 1.0),
        "check": bd.check,
    }
    for name, call in calls.items():
        expected = f"^{name}: expected a model or a mechanism, got 'pendulum'"
        with pytest.raises(bd.BeamdaeError, match=expected):
            call("pendulum")


# Failures -------------------------------------------------------------------------------------


@every_integrator
def test_singular_law_ends_the_run_and_keeps_the_steps(integrator):
    solution = bd.simulate(guided_particle(lambda t: np.sqrt(0.5 - t)), integrator, 1.0, 1e-3)
    assert not solution.status.success
    assert solution.status.kind == "failed"
    assert f"stopped at t = {solution.trajectory.end:.6g} s: " in solution.status.sentence
    # Every integrator stops within one of its steps, 1 ms if they are fixed.
    assert 0.498 < solution.t[-1] <= 0.5
    # v = 1/2 int sqrt(1/2 - t) dt to a percent of its final value: the error test contains only
    # positions.
    exact = (0.5**1.5 - (0.5 - solution.t) ** 1.5) / 3.0
    assert_allclose(solution.v[:, 0], exact, rtol=0.0, atol=1e-3)


@every_integrator_in_its_form
def test_nonreal_law_is_named_as_the_cause(integrator):
    """Regression: the reason was that IDA's steps become too small to advance time."""
    solution = bd.simulate(pushed_particle(lambda t: (0.2 - t) ** 1.5), integrator, 0.4)
    assert solution.status.kind == "failed"
    assert "the residual is not finite" in solution.status.sentence


@pytest.mark.parametrize("integrator", [IDA, RADAU], ids=["ida", "radau"])
def test_max_steps_limits_the_run(integrator):
    solution = bd.simulate(SLIDER_CRANK.equations, replace(integrator, max_steps=50), 10.0)
    assert not solution.status.success
    assert solution.status.kind == "limited"
    assert "max_steps = 50" in solution.status.sentence
    assert 50 <= solution.statistics.steps < 100
    assert 0.0 < solution.t[-1] < 10.0
    assert f"t = {solution.trajectory.end:.6g} s" in solution.status.sentence


@pytest.mark.parametrize("integrator", [IDA, RADAU], ids=["ida", "radau"])
def test_max_steps_counts_all_segments(integrator):
    law = bd.piecewise(*((0.1 * k, float(k)) for k in range(1, 10)), 0.0)
    whole = bd.simulate(guided_particle(law), integrator, 1.0)
    assert whole.status.success
    half = replace(integrator, max_steps=whole.statistics.steps // 2)
    assert not bd.simulate(guided_particle(law), half, 1.0).status.success


@pytest.mark.parametrize(
    "integrator",
    [
        replace(IDA, rtol=1e-9, max_steps=None),
        replace(ALPHA, step=1e-4),
        replace(RADAU, rtol=1e-10, max_steps=None),
    ],
    ids=["ida", "alpha", "radau"],
)
def test_time_limit_limits_the_run(integrator):
    limited = replace(integrator, time_limit=0.05)
    solution = bd.simulate(PENDULUM.equations, limited, 100.0, 0.1)
    assert not solution.status.success
    assert "time limit of 0.05 s" in solution.status.sentence
    assert 0.0 < solution.trajectory.end < 100.0
    # The clock is checked every 64 steps; the rest is slack for a busy machine.
    assert solution.statistics.wall_time < 1.0


def test_index_3_with_all_components_tested_fails():
    # Multipliers have errors of the order of the local tolerance over h^2.
    settings = bd.Ida(rtol=1e-8, formulation="index3", error_control="all", max_steps=5_000)
    solution = bd.simulate(PENDULUM.equations, settings, 4.0)
    assert not solution.status.success
    assert "t = " in solution.status.sentence
    assert len(solution.t) >= 1
    assert np.all(np.isfinite(solution.q))


@every_integrator_in_its_form
def test_constraints_that_cannot_be_satisfied_end_the_run(integrator):
    """The joint cannot be closed once the center has moved a radius away, at 1 s."""
    if integrator.accuracy.name == "step":
        integrator = replace(integrator, step=2.0)
    t, q, v = symbols(2)
    reach = ca.vertcat(ca.dot(q, q) - 1.0, q[0] - t)
    torn = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1, 1], force=[0, 0], constraints=reach, q0=[0, 1], v0=[1, 0]
    )
    solution = bd.simulate(torn, integrator, 10.0)
    assert not solution.status.success
    assert f"t = {solution.trajectory.end:.6g} s" in solution.status.sentence
    assert ("use a smaller step" in solution.status.sentence) == (
        integrator.accuracy.name == "step"
    )
    assert solution.trajectory.end < 1.0 + 1e-3
    assert np.all(np.isfinite(solution.q))


@every_integrator_in_its_form
def test_interrupted_run_keeps_its_steps(integrator):
    def interrupt(t):
        if t > 0.3:
            raise KeyboardInterrupt

    # Enough steps for several calls of progress.
    if integrator.accuracy.name == "rtol":
        integrator = replace(integrator, rtol=1e-7)
    with pytest.raises(bd.Interrupted) as caught:
        bd.simulate(PENDULUM.equations, integrator, 4.0, 0.01, progress=interrupt)
    solution = caught.value.solution
    assert solution is caught.value.partial
    assert solution.status.kind == "interrupted"
    assert f"interrupted at t = {solution.trajectory.end:.6g} s" in solution.status.sentence
    assert 0.3 < solution.trajectory.end < 4.0
    assert solution.t[-1] <= solution.trajectory.end


@every_integrator_in_its_form
def test_progress_gets_ascending_times(integrator):
    times = []
    bd.simulate(PENDULUM.equations, integrator, 2.0, progress=times.append)
    assert len(times) > 3
    assert all(isinstance(t, float) for t in times)
    # A pilot run reports the start time repeatedly; then times ascend.
    assert np.all(np.diff([t for t in times if t > 0.0]) > 0.0)
    assert times[-1] <= 2.0


# Breakpoints ----------------------------------------------------------------------------------


@every_integrator_in_its_form
def test_switched_force_is_integrated_accurately(integrator):
    times = {"t_end": 1.0, "output_step": 0.05}
    stays = bd.simulate(guided_particle(5.0), integrator, **times)
    jumps = bd.simulate(guided_particle(bd.piecewise((0.3, 5.0), 0.0)), integrator, **times)
    t = jumps.t
    inside = np.minimum(t, 0.3)
    v_exact = 2.5 * inside
    x_exact = 1.25 * inside**2 + 0.75 * (t - inside)
    # Ida restarts once more; with a constant force generalized-alpha has only rounding errors,
    # and first-order steps an error of half a step times the velocity.
    usual = 1e-12 if isinstance(integrator, bd.GeneralizedAlpha) else 3e-6
    if integrator.accuracy.name == "step" and integrator.order == 1:
        usual = 0.51 * 2.5 * integrator.step
    assert np.max(np.abs(stays.q[:, 0] - 1.25 * t**2)) < usual
    assert_allclose(jumps.q[:, 0], x_exact, rtol=0.0, atol=2.0 * usual)
    assert_allclose(jumps.v[:, 0], v_exact, rtol=0.0, atol=20.0 * usual)
    assert [s.t[0] for s in jumps.trajectory.intervals] == [0.0, 0.3]
    assert jumps.trajectory.intervals[0].t[-1] == 0.3


@every_integrator
def test_accelerations_jump_with_the_force(integrator):
    solution = bd.simulate(guided_particle(bd.piecewise((0.3, 5.0), 0.0)), integrator, 1.0, 0.1)
    before, after = solution.trajectory.intervals
    assert_allclose(before.state.a[-1, 0], 2.5, rtol=0.0, atol=1e-4)
    assert_allclose(after.state.a[0, 0], 0.0, rtol=0.0, atol=1e-12)


@every_integrator
def test_driver_with_acceleration_jump_is_followed(integrator):
    law = bd.piecewise((0.4, lambda t: t**2), lambda t: 0.16 + 0.8 * (t - 0.4))
    mech, _ = driven(bd.RigidBody("bar", mass=2.0, inertia=0.3, center=(0.5, 0.0)), law)
    mech.observe("motor", mech.part("motor").reaction)
    solution = bd.simulate(mech, integrator, 1.0, 0.1)
    assert solution.status.success
    angle = np.where(solution.t < 0.4, solution.t**2, 0.16 + 0.8 * (solution.t - 0.4))
    # In the index-1 form, no equation prescribes the angle, only its acceleration.
    assert_allclose(solution.q[:, 2], angle, rtol=0.0, atol=1e-5)
    if isinstance(integrator, bd.Ida) and integrator.formulation.startswith("index"):
        # If only positions are tested, errors of the multipliers are not controlled.
        return
    torque = solution.observed["motor.M [N m]"]
    # 0.8 kg m^2 about the hinge at 2 rad/s^2, then zero; the breakpoint itself belongs to the
    # interval before it.
    assert_allclose(torque, np.where(solution.t < 0.41, 1.6, 0.0), rtol=0.0, atol=2e-2)


WIDTH, PULSE_RATE, OMEGA = 0.01, 50.0 * np.pi, 10.0 * np.pi
# Forces on 2 kg, end of the run [s], exact velocity, and error relative to the largest velocity.
LAWS = {
    # Half a sine, long after the start and far shorter than the run: (rate h)^2 / 12 is 2e-3 for
    # generalized-alpha, and during the pulse IDA remains at low orders.
    "pulse": (
        bd.piecewise((4.0, 0.0), (4.02, lambda t: 100.0 * np.sin(PULSE_RATE * (t - 4.0))), 0.0),
        5.0,
        lambda t: 100.0 / PULSE_RATE * (t > 4.01),
        1e-2,
    ),
    # No breakpoint near it; a twentieth of the run is 25 times its width. Low orders at steps of a
    # quarter of the time scale cause an error of 1 % in IDA.
    "bell": (
        bd.results.Law((lambda t: 100.0 * np.exp(-(((t - 4.15) / WIDTH) ** 2)),), (), 4.0 * WIDTH),
        5.0,
        lambda t: 50.0 * WIDTH * np.sqrt(np.pi) * (t > 4.15),
        2e-2,
    ),
    # Zero at the start, at the end and halfway: steps of these lengths would miss it.
    "sine": (
        bd.sine(100.0, 5.0),
        2.0,
        lambda t: 50.0 / OMEGA * (1.0 - np.cos(OMEGA * t)),
        1e-2,
    ),
    # By default the longest step is a twentieth of the run.
    "without a time scale": (
        lambda t: 2.0 * np.sin(2.0 * np.pi * t),
        2.0,
        lambda t: (1.0 - np.cos(2.0 * np.pi * t)) / (2.0 * np.pi),
        3e-3,
    ),
}


@every_integrator_in_its_form
@pytest.mark.parametrize("law", LAWS)
def test_laws_are_resolved(integrator, law):
    force, t_end, velocity, tolerance = LAWS[law]
    solution = bd.simulate(guided_particle(force), integrator, t_end, 0.1)
    assert solution.status.success, solution.status.sentence
    exact = velocity(solution.t)
    assert_allclose(solution.v[:, 0], exact, rtol=0.0, atol=tolerance * np.max(exact))


@pytest.mark.parametrize("integrator", [IDA, RADAU], ids=["ida", "radau"])
def test_max_step_is_respected(integrator):
    solution = bd.simulate(guided_particle(1.0), replace(integrator, max_step=0.01), 1.0)
    assert np.max(np.diff(solution.trajectory.intervals[0].t)) <= 0.01 * (1.0 + 1e-9)


# Statistics and settings of a run ---------------------------------------------------------------


def count_step_changes(t):
    """Return how many steps differ from the step before by more than rounding."""
    steps = np.diff(t)
    return np.count_nonzero(~np.isclose(steps[1:], steps[:-1], rtol=1e-9, atol=0.0))


@every_integrator_in_its_form
def test_statistics_count_calls(integrator):
    solution = bd.simulate(SLIDER_CRANK.equations, integrator, 1.0)
    s = solution.statistics
    assert s.steps == sum(len(segment.t) - 1 for segment in solution.trajectory.intervals)
    assert s.residual_calls >= s.steps
    assert 1 <= s.jacobian_calls <= s.residual_calls
    if integrator.method == "GeneralizedAlpha" and integrator.rtol is not None:
        # The equations of the jerk are factorized whenever a step differs from the accepted one.
        changes = sum(count_step_changes(x.t) for x in solution.trajectory.intervals)
        assert changes <= s.factorizations - s.jacobian_calls <= changes + s.rejected_steps
        assert changes > 0
    else:
        # Radau factorizes a real and a complex matrix.
        assert s.factorizations == s.jacobian_calls * (2 if integrator.method == "Radau" else 1)
    assert s.solves >= s.steps
    assert s.rejected_steps >= 0
    assert s.newton_failures >= 0
    assert s.setup_time > 0.0
    assert s.wall_time > 0.0


def test_resolved_settings_are_reported():
    solution = bd.simulate(guided_particle(1.0), bd.Ida(rtol=1e-4), 0.1)
    settings = solution.integrator
    assert settings["integrator"] == "Ida"
    assert settings["rtol"] == 1e-4
    assert settings["error_control"] in ("positions", "velocities", "all")
    assert settings["max_order"] in range(1, 6)
    settings = bd.simulate(guided_particle(1.0), bd.Radau(rtol=1e-4), 0.1).integrator
    assert settings["integrator"] == "Radau"
    assert settings["rtol"] == 1e-4
    assert settings["error_control"] == "velocities"
    assert "no mode is much faster" in settings["auto"]
    assert 0.0 < settings["local_tolerance"] < 1e-3
    settings = bd.simulate(guided_particle(1.0), ALPHA, 0.1).integrator
    assert settings["integrator"] == "GeneralizedAlpha"
    assert (settings["step"], settings["rho_inf"], settings["formulation"]) == (1e-3, 0.8, "index3")


@every_integrator_in_its_form
def test_reactions_scale_with_mass(integrator):
    t, q, v = symbols(2)
    runs = []
    if isinstance(integrator, bd.GeneralizedAlpha):
        # The iteration error of multipliers does not depend on masses.
        integrator = replace(integrator, newton_tolerance=1e-8)
    for mass in (1.0, 1e6):
        model = bd.ConstrainedSystem(
            t=t,
            q=q,
            v=v,
            mass=[mass, mass],
            force=ca.vertcat(0.0, -9.81 * mass),
            constraints=0.5 * (ca.sumsqr(q) - 1.0),
            q0=[1.0, 0.0],
            v0=[0.0, 0.0],
        )
        runs.append(bd.simulate(model, integrator, 1.0, 0.05))
    light, heavy = runs
    # The same steps up to rounding: two such runs differ by the error of a run.
    assert_allclose(light.statistics.steps, heavy.statistics.steps, rtol=0.1)
    assert_allclose(heavy.q, light.q, rtol=0.0, atol=3e-5)
    if not (isinstance(integrator, bd.Ida) and integrator.error_control == "positions"):
        # If only positions are tested, errors of multipliers are not controlled.
        assert_allclose(heavy.lam / 1e6, light.lam, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("step", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("moment", [1e-3, 0.1])
def test_regression_a_sudden_moment_on_a_light_section_starts(moment, step):
    """The rotary inertia of the section causes 2e6 rad/s^2; Newton's iteration diverged."""
    alloy = bd.Material(E=7e10, nu=0.3, rho=2700.0)
    strip = rectangle(0.005, material=alloy)
    mech, beam = hinged_beam(strip, 1)
    mech.add(bd.Moment("torque", on=beam.end, law=moment))
    mech.observe("tip", beam.end)
    solution = bd.simulate(mech, bd.GeneralizedAlpha(step=step), t_end=4e-3, output_step=4e-3)
    assert solution.status.success
    # Ida gives 0.0210 rad/(N m) after 4 ms; undamped fast modes, which these steps do not resolve,
    # oscillate about this value by a tenth of it.
    assert_allclose(solution.observed["tip.angle [rad]"].iloc[-1] / moment, 0.0210, rtol=0.2)
