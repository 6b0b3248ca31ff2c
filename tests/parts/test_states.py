"""First-order states against closed forms, in all integrators and analyses."""

import warnings

import numpy as np
import pytest
from mechanisms import free_ball, mass_on_rail
from scipy.integrate import solve_ivp

import beamdae as bd

INTEGRATORS = (bd.Ida(1e-8), bd.Radau(1e-8), bd.GeneralizedAlpha(1e-3))
# The fixed steps of generalized-alpha are accurate to h^2 times a constant of order one.
TOLERANCE = 2e-6

KP, KI, KD, MASS, TARGET = 30.0, 20.0, 8.0, 2.0, 0.3


@bd.model(t_end=2.0)
def pid_stage(kp=KP, ki=KI, kd=KD, mass=MASS, target=TARGET, start=0.0):
    """Mass on a line under a PID controller."""
    mech, stage = mass_on_rail(mass, name="stage")
    x, v = mech.sensor("x", stage.point, "x"), mech.sensor("v", stage.point, "x_dot")
    goal = mech.input("target", target, "m")
    integral = mech.state("integral", goal - x, start=start, unit="m s")
    mech.add(bd.Force("act", stage.point, (kp * (goal - x) + ki * integral - kd * v, 0.0)))
    return mech


def build_lag(rate=2.0, scale=1.0, size=1.0, **settings):
    """Return a mechanism with a ball at 1 m/s and a state that lags its position by 1 / `rate`."""
    mech, ball = free_ball(velocity=(1.0, 0.0))
    x = mech.sensor("x", ball.point, "x")
    mech.state("lag", lambda lag, t: (size * x - lag) * rate, scale=scale, **settings)
    return mech


def lag_of(t, rate=2.0):
    return t - (1.0 - np.exp(-rate * t)) / rate


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
@pytest.mark.parametrize("rate", [0.2, 2.0, 200.0])
def test_first_order_lag(integrator, rate):
    run = bd.simulate(build_lag(rate), integrator, t_end=2.0, output_step=0.1)
    np.testing.assert_allclose(run["lag"], lag_of(run.t, rate), atol=TOLERANCE)


@pytest.mark.parametrize("method", [bd.Ida(1e-6), bd.Radau(1e-6)], ids=lambda x: x.method)
@pytest.mark.parametrize("rate", [1e4, 1e7])
def test_regression_transients_of_fast_states_take_few_steps(method, rate):
    """The rate of the state was tested, and taken for the rate of the motion: runs gave up."""
    run = bd.simulate(build_lag(rate, size=2.0, start=1.0), method, t_end=1.0, output_step=0.1)
    assert run.status.success, run.status.sentence
    assert run.statistics.steps < 1000
    np.testing.assert_allclose(run["lag"].iloc[1:], 2.0 * (run.t[1:] - 1.0 / rate), atol=1e-6)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_order_of_generalized_alpha_is_two(rho_inf):
    errors = []
    for h in (0.02, 0.01, 0.005):
        run = bd.simulate(build_lag(), bd.GeneralizedAlpha(h, rho_inf), t_end=1.0)
        errors.append(np.max(np.abs(run["lag"] - lag_of(run.t))))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders - 2.0) < 0.2)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_fast_lag_is_stable_with_long_steps(rho_inf):
    run = bd.simulate(build_lag(1e6, start=0.1), bd.GeneralizedAlpha(0.01, rho_inf), t_end=4.0)
    # The start decays, except for rho_inf = 1, for which it oscillates.
    error = np.abs(run["lag"] - run["x"])
    assert np.max(error) < 0.5
    if rho_inf < 1.0:
        assert error.iloc[-1] < 1e-5


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
def test_integrator_of_a_sine_and_two_states_against_a_spring(integrator):
    mech, mass = free_ball((1.0, 0.0), name="mass")
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), mass.point))
    x = mech.sensor("x", mass.point, "x")
    mech.add(bd.Force("spring", mass.point, (-9.0 * x, 0.0)))
    position = mech.state("position", start=1.0, unit="m")
    position.follows(mech.state("velocity", -9.0 * position, unit="m/s"))
    mech.state("area", bd.sine(1.0, frequency=0.5))
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.05)
    tolerance = 5.0 * TOLERANCE
    np.testing.assert_allclose(run["position"], np.cos(3.0 * run.t), atol=tolerance)
    np.testing.assert_allclose(run["position"], run["x"], atol=2.0 * tolerance)
    np.testing.assert_allclose(run["area"], (1.0 - np.cos(np.pi * run.t)) / np.pi, atol=tolerance)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
def test_closed_loop_motion(integrator):
    run = bd.simulate(pid_stage, integrator, output_step=0.05)

    def rate(t, s):
        force = KP * (TARGET - s[0]) + KI * s[2] - KD * s[1]
        return [s[1], force / MASS, TARGET - s[0]]

    expected = solve_ivp(rate, (0.0, 2.0), np.zeros(3), rtol=1e-11, atol=1e-13, t_eval=run.t)
    np.testing.assert_allclose(run["x"], expected.y[0], atol=TOLERANCE)
    np.testing.assert_allclose(run["integral"], expected.y[2], atol=TOLERANCE)
    # The force is a load; the state stores no energy.
    assert run.warnings == ()
    assert np.max(np.abs(run["energy.imbalance"])) < 1e-5


def test_poles_of_the_closed_loop():
    poles = np.sort_complex(np.roots([MASS, KD, KP, KI]))
    linear = bd.linearize(pid_stage, inputs=["target"])
    assert [x.name for x in linear.states] == ["stage.x", "integral.value", "stage.x_dot"]
    np.testing.assert_allclose(np.sort_complex(linear.poles), poles, rtol=1e-12)
    np.testing.assert_allclose(linear.B.ravel(), [0.0, 1.0, KP / MASS], rtol=1e-12)
    modes = bd.modes(pid_stage)
    upper = poles[poles.imag >= 0.0]
    np.testing.assert_allclose(np.sort_complex(modes.eigenvalues), upper, rtol=1e-12)
    assert set(modes.kinds) == {"decay", "vibration"}


@pytest.mark.slow(reason="compiles static equations of three models")
def test_equilibrium_has_zero_rates():
    mech = pid_stage(start=0.7)
    mech.add(bd.Force("weight", mech.parts["stage"].point, (6.0, 0.0)))
    equilibrium = bd.equilibrium(mech)
    names = bd.equations_of_motion(mech).q_names
    values = dict(zip(names, equilibrium.q[-1], strict=True))
    assert values["stage.x"] == pytest.approx(TARGET, rel=1e-9)
    assert values["integral.value"] == pytest.approx(-6.0 / KI, rel=1e-9)
    assert equilibrium.stable
    unstable = bd.equilibrium(pid_stage(ki=200.0))
    assert not unstable.stable
    run = bd.simulate(mech, bd.Radau(), t_end=0.5, start="equilibrium")
    assert np.ptp(run["x"]) < 1e-8


@bd.model(t_end=5.0)
def forced(stiffness=9.0, damping=0.4):
    """Vibrating mass and a state that lags its position, under a harmonic force."""
    mech, mass = mass_on_rail()
    x, v = mech.sensor("x", mass.point, "x"), mech.sensor("v", mass.point, "x_dot")
    mech.add(bd.Force("spring", mass.point, (-stiffness * x - damping * v, 0.0)))
    mech.add(bd.Force("drive", mass.point, (bd.sine(1.0, frequency=0.4), 0.0)))
    mech.state("lag", lambda lag, t: 2.0 * (x - lag))
    return mech


@pytest.mark.slow(reason="shooting")
def test_periodic_motion_and_its_multipliers():
    motion = bd.periodic(forced, period=2.5)
    omega = 0.8 * np.pi
    amplitude = abs(2.0 / (2.0 + 1j * omega) / (9.0 - omega**2 + 0.4j * omega))
    assert np.max(np.abs(motion.solution["lag"])) == pytest.approx(amplitude, rel=1e-4)
    poles = np.exp(2.5 * np.append(np.roots([1.0, 0.4, 9.0]), -2.0))
    found = motion.multipliers[:3]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(poles), rtol=1e-5)


@pytest.mark.slow(reason="compiles static equations")
def test_loads_are_scaled_but_not_the_forces_of_controllers():
    mech = pid_stage()
    mech.add(bd.Force("weight", mech.parts["stage"].point, (6.0, 0.0)))
    path = bd.equilibrium(mech)
    assert path.loads == (("weight",),)
    names = bd.equations_of_motion(mech).q_names
    np.testing.assert_allclose(path.q[:, names.index("stage.x")], TARGET, rtol=1e-9)
    values = path.q[:, names.index("integral.value")]
    np.testing.assert_allclose(values, -6.0 * path.factors.ravel() / KI, atol=1e-12)


def test_free_motions_of_models_with_states():
    mech = build_lag()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        modes = bd.modes(mech)
    values = np.sort(modes.eigenvalues.real)
    # The ball moves freely along two axes.
    np.testing.assert_allclose(values, [-2.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("amplitude", [1.0, 1e7])
def test_regression_states_of_large_values_do_not_loosen_the_tolerance_of_bodies(amplitude):
    """Beside a pressure of 1e7 Pa, a mass that moved 0.1 m had an amplitude of 3300 m."""
    mech = bd.Mechanism()
    mass = mech.add(bd.RigidBody("mass", 1.0, 1.0, velocity=(1.0, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), mass.at(0.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.at(0.0, 0.0), stiffness=100.0))
    mech.state("pressure", rate=lambda x, t: amplitude * np.cos(3.0 * t), unit="Pa")
    mech.observe("mass", mass.at(0.0, 0.0))
    run = bd.simulate(mech, bd.Radau(1e-5), t_end=1.0)
    assert run.integrator["amplitudes"]["mass"] == pytest.approx(0.1, rel=0.02)
    assert np.abs(run["mass.x"] - 0.1 * np.sin(10.0 * run.t)).max() < 1e-7
    assert not run.warnings


@pytest.mark.parametrize(
    ("analysis", "sentence"),
    [
        (lambda: bd.modes(pid_stage, damping=False), "undamped modes are not supported with stat"),
    ],
)
def test_analyses_that_exclude_states_are_refused(analysis, sentence):
    with pytest.raises(bd.BeamdaeError, match=sentence):
        analysis()
