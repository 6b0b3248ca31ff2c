"""Warnings of runs with fixed steps whose errors, estimated by a second run, are large."""

import re
from dataclasses import replace

import numpy as np
import pytest

import beamdae as bd
from beamdae import verification
from beamdae.interrupts import Interrupted
from beamdae.results.run_checks import skip_error_estimates

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")

OMEGA = 20.0


def oscillator():
    """Mass of 1 kg on a spring with 20 rad/s."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0), velocity=(0.5, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point))
    spring = mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, OMEGA**2))
    mech.observe("mass", mass.point)
    mech.observe("spring", spring.force)
    return mech


def double_pendulum():
    """Two bars that swing freely from a horizontal position."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    end = mech.ground.at(0.0, 0.0)
    for k in range(2):
        bar = mech.add(bd.RigidBody.rod(f"bar {k}", (k, 0.0), (k + 1.0, 0.0), mass=1.0))
        joint = mech.add(bd.Revolute(f"joint {k}", end, bar.at(k, 0.0)))
        mech.observe(f"joint {k}", joint.reaction)
        end = bar.at(k + 1.0, 0.0)
    mech.observe("end", end)
    return mech


def leaf():
    """Clamped leaf of steel whose end a sinusoidal force bends at half its natural frequency."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.006, damping=1e-5)
    beam = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.3, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, bd.sine(amplitude=50.0, frequency=27.0))))
    mech.observe("tip", beam.end)
    mech.observe("stress", beam.stress(0.02, "top"))
    return mech


def ball():
    """Ball that falls on a stiff floor."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    point = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.1))).point
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    contact = mech.add(bd.Contact("floor", point, floor, 1e5, restitution=0.7, impact_speed=1.4))
    mech.observe("ball", point)
    mech.observe("floor", contact.force)
    return mech


def servo(law=lambda sample: -4.0 * sample.reads[1]):
    """The oscillator with a sampled damper."""
    mech = oscillator()
    mass, command = mech.parts["mass"], mech.input("command")
    mech.add(bd.Force("actuator", mass.point, (command, 0.0)))
    reads = [mech.sensor(x, mass.point, x) for x in ("x", "x_dot")]
    mech.add(bd.Controller("servo", 0.05, reads, [command], law, state=[0.0]))
    return mech


def step_errors_of(run):
    return [x for x in run.warnings if "the error with fixed steps" in x]


def errors_of(run, reference):
    """Return the largest error of each column relative to half its range."""
    columns = zip(run.columns.values(), reference.columns.values(), strict=True)
    ranges = [(np.abs(x - exact).max(), 0.5 * np.ptp(exact)) for x, exact in columns]
    largest = max(half_range for _, half_range in ranges)
    return [error / half for error, half in ranges if half > 1e-9 * largest]


def count_runs(monkeypatch):
    """Return a list to which each run by fixed steps appends its step [s]."""
    steps, integrate = [], bd.GeneralizedAlpha.integrate

    def count(method, *arguments, **settings):
        steps.append(method.step)
        return integrate(method, *arguments, **settings)

    monkeypatch.setattr(bd.GeneralizedAlpha, "integrate", count)
    return steps


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("divisor", [1, 16])
@pytest.mark.parametrize(
    ("build", "t_end", "step"),
    [
        (oscillator, 2.0, 0.01),  # six periods of 31 steps
        (oscillator, 10.0, 5e-3),  # 32 periods of 63 steps
        (double_pendulum, 2.0, 0.03),
        (leaf, 0.1, 2e-3),
        (ball, 0.5, 2e-3),
        (servo, 1.0, 0.025),
    ],
)
def test_regression_large_errors_of_fixed_steps_have_a_warning(build, t_end, step, divisor):
    """Errors of 10 to 30 % were silent, among them those of reactions, stresses and impacts."""
    mech = build()
    run = bd.simulate(mech, bd.GeneralizedAlpha(step / divisor), t_end, output_step=t_end / 200)
    exact = bd.simulate(mech, bd.Radau(1e-6), t_end, output_step=t_end / 200)
    error = max(errors_of(run, exact))
    assert error > 0.1 if divisor == 1 else error < 0.1 / 3.0
    assert bool(step_errors_of(run)) == (divisor == 1)


@pytest.mark.slow(reason="references of four models")
@pytest.mark.parametrize(
    ("name", "step"),
    [("four_bar", 6e-3), ("shallow_arch", 3.3e-4), ("press", 2e-3), ("hub_beam", 4e-3)],
)
def test_regression_large_errors_in_example_models_have_a_warning(name, step):
    model = bd.load_model(f"example:{name}")
    exact = bd.simulate(model, bd.Radau(1e-7))
    run = bd.simulate(model, bd.GeneralizedAlpha(step))
    assert max(errors_of(run, exact)) > 0.1
    assert step_errors_of(run)
    fine = bd.simulate(model, bd.GeneralizedAlpha(step / 32.0))
    assert max(errors_of(fine, exact)) < 0.1 / 3.0
    assert not step_errors_of(fine)


@pytest.mark.parametrize(
    ("family", "rho_inf", "step"),
    [
        ("generalized-alpha", 0.8, 9e-3),
        ("generalized-alpha", 0.0, 6e-3),
        ("hht", 0.6, 9e-3),
        ("newmark", 1.0, 9e-3),
    ],
)
def test_warnings_name_a_sufficient_step(family, rho_inf, step):
    method = bd.GeneralizedAlpha(step, family=family, rho_inf=rho_inf)
    run = bd.simulate(oscillator(), method, 2.5)
    error = np.abs(run["mass.x_dot"] / 0.5 - np.cos(OMEGA * run.t)).max()
    (message,) = step_errors_of(run)
    assert re.match(rf"\S+ \(also \S+, \S+\): the error with fixed steps of {step} s is", message)
    (estimate,) = re.findall(r"estimated at up to (\S+) % of half its range", message)
    assert error < 0.01 * float(estimate) < 2.5 * error
    (recommended,) = re.findall(r"use a step of (\S+) s, or an integrator with rtol", message)
    fine = bd.simulate(oscillator(), replace(method, step=float(recommended)), 2.5)
    assert np.abs(fine["mass.x_dot"] / 0.5 - np.cos(OMEGA * fine.t)).max() < 0.01
    assert not step_errors_of(fine)


def test_no_step_follows_from_errors_above_the_range():
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.02), 10.0)
    (message,) = step_errors_of(run)
    assert "more than 100 % of half its range; use at first a step of 0.002 s" in message


def test_a_shorter_second_run_replaces_one_that_fails(monkeypatch):
    steps = count_runs(monkeypatch)
    run = bd.simulate(double_pendulum(), bd.GeneralizedAlpha(0.06), 2.0)
    assert steps == [0.06, 0.12, 0.03]
    assert step_errors_of(run)


def test_checks_and_estimates_share_the_second_run(monkeypatch):
    steps = count_runs(monkeypatch)
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.01), 2.0)
    # Half the step replaces an estimate that has a warning.
    assert steps == [0.01, 0.02, 0.005]
    table = bd.error_estimate(run)
    assert max(table["error over half the range"]) > 0.15
    run.warnings  # noqa: B018
    verification.estimate_errors(run)
    assert steps == [0.01, 0.02, 0.005]
    # Other columns need another comparison.
    other = run.observe("again", run.equations.mechanism.parts["mass"].point)
    assert "again.x" in step_errors_of(other)[0]
    assert steps == [0.01, 0.02, 0.005, 0.02, 0.005]


def test_regression_errors_that_only_twice_the_step_suggests_have_no_warning(monkeypatch):
    """Of an error of 20 %, 84 % were stated, and 37 % of one of 2 %."""
    steps = count_runs(monkeypatch)
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(6e-3), 2.5)
    error = np.abs(run["mass.x_dot"] / 0.5 - np.cos(OMEGA * run.t)).max()
    assert error < 0.1
    assert not step_errors_of(run)
    assert steps == [6e-3, 1.2e-2, 3e-3]
    assert (
        error
        < bd.error_estimate(run)["error over half the range"]["mass.x_dot [m/s]"]
        < 2.5 * error
    )


def test_long_runs_are_not_repeated_with_half_the_step(monkeypatch):
    steps = count_runs(monkeypatch)
    monkeypatch.setattr(verification, "_MAX_WORK", 0.0)
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.01), 2.0)
    assert step_errors_of(run)
    assert steps == [0.01, 0.02]


def test_runs_that_belong_to_an_estimate_are_not_repeated(monkeypatch):
    steps = count_runs(monkeypatch)
    with skip_error_estimates():
        run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.01), 0.5)
    assert steps == [0.01]
    bd.verify(run)
    assert steps == [0.01]

    @bd.model(t_end=0.5)
    def swing(velocity=0.5):
        mech = bd.Mechanism()
        mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0), velocity=(velocity, 0.0)))
        mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, OMEGA**2))
        mech.observe("mass", mass.point)
        return mech

    steps.clear()
    bd.gradient(swing, bd.EndValue("mass.x"), ["velocity"], bd.GeneralizedAlpha(1e-3))
    # The run, its estimate, and the run with which gradients are compared.
    assert steps == [1e-3, 2e-3, 2e-3]


@pytest.mark.slow(reason="a fifth of a second")
def test_samples_of_controllers_are_repeated_from_the_start():
    taken = []

    def law(sample):
        taken.append((sample.index, sample.state[0]))
        sample.state[0] += 1.0
        return -4.0 * sample.reads[1]

    method = bd.GeneralizedAlpha(2e-3)
    with skip_error_estimates():
        alone = bd.simulate(servo(law), method, 1.0)
    count = len(taken)
    run = bd.simulate(servo(law), method, 1.0)
    assert run.status.success
    assert len(taken) == 3 * count
    assert all(index == state for index, state in taken)
    assert np.array_equal(run["mass.x"], alone["mass.x"])


def test_laws_with_memory_are_not_repeated(monkeypatch):
    steps, calls = count_runs(monkeypatch), []

    def law(sample):
        calls.append(sample.t)
        return 1e-3 * len(calls)

    run = bd.simulate(servo(law), bd.GeneralizedAlpha(2e-3), 1.0)
    assert not run.status.success
    assert steps == [2e-3]


def test_interrupts_of_the_second_run_keep_the_first_one(monkeypatch):
    def interrupt(*_, **options):
        raise Interrupted("interrupted at t = 0.1 s")

    monkeypatch.setattr(verification, "run_again", interrupt)
    with pytest.raises(Interrupted, match="while the run was checked") as caught:
        bd.simulate(oscillator(), bd.GeneralizedAlpha(0.01), 1.0)
    assert caught.value.solution.t[-1] == 1.0


def test_progress_follows_the_first_run_alone():
    times = []
    bd.simulate(oscillator(), bd.GeneralizedAlpha(1e-3), 1.0, progress=times.append)
    assert times == sorted(times)


def test_incomplete_and_adaptive_runs_are_not_repeated(monkeypatch):
    steps = count_runs(monkeypatch)
    mech = oscillator()
    stopped = bd.simulate(mech, bd.GeneralizedAlpha(0.01), 9.0, progress=lambda t: t and "enough")
    assert not stopped.status.success
    assert steps == [0.01]
    bd.simulate(mech, bd.GeneralizedAlpha(rtol=1e-3), 0.5)
    assert len(steps) == 2


def test_regression_columns_that_are_constant_or_noise_have_no_warning():
    """A wheel at constant speed, whose motion steps reproduce, had a warning of its vibration."""
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.5, angular_velocity=20.0))
    pin = mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    mech.observe("rim", wheel.at(0.1, 0.0))
    mech.observe("center", wheel.at(0.0, 0.0))
    mech.observe("pin", pin.reaction)
    run = bd.simulate(mech, bd.GeneralizedAlpha(0.02), 2.0)
    assert np.abs(run["rim.y"] - 0.1 * np.sin(20.0 * run.t)).max() < 1e-9
    assert not step_errors_of(run)


@pytest.mark.slow(reason="half a second")
def test_regression_rounding_errors_have_no_estimate():
    """Velocities of 1e-14 m/s of a beam that stays in equilibrium had errors of 190 %."""
    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.004, damping=1e-5)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=4))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    mech.observe("clamp", clamp.reaction)
    run = bd.simulate(mech, bd.GeneralizedAlpha(1e-3), 0.1, output_step=1e-3)
    assert max(bd.error_estimate(run)["error over half the range"]) == 0.0
    assert not step_errors_of(run)


def test_loaded_runs_have_no_integrator(tmp_path):
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.01), 1.0)
    loaded = bd.load(run.save(tmp_path / "run.beamdae"), oscillator())
    assert [*step_errors_of(run), *loaded.warnings] == list(run.warnings)
