"""Warnings of runs with fixed steps that are too long for the changes of columns."""

import re
from dataclasses import replace

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.diagnostics.resolution import missed_peaks
from beamdae.results.diagnostics.resolution.long_steps import long_step_warnings

OMEGA = 20.0


def oscillator():
    """Mass of 1 kg on a spring with 20 rad/s."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0), velocity=(0.5, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, OMEGA**2))
    mech.observe("mass", mass.point)
    return mech


def crank():
    """Crank that turns at 10 rad/s and determines all positions."""
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.3, 0.0), mass=1.0))
    center = (mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0))
    mech.add(bd.Revolute("pin", *center))
    mech.add(bd.Driver("motor", *center, lambda t: 10.0 * t))
    mech.observe("tip", rod.at(0.3, 0.0))
    return mech


def warnings_of(run):
    return [x for x in run.warnings if "fixed steps" in x]


def test_regression_coarse_fixed_steps_of_a_vibration_have_a_warning():
    """A velocity was 54 % of its amplitude off without a word."""
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(0.02), 2.0)
    exact = 0.5 * np.cos(OMEGA * run.t)
    assert np.abs(run["mass.x_dot"] - exact).max() > 0.2 * 0.5
    (message,) = warnings_of(run)
    assert re.match(
        r"mass.x\S* \(also mass.x\S*\): fixed steps of 0.02 s change the period", message
    )
    fine = bd.simulate(oscillator(), bd.GeneralizedAlpha(2e-3), 2.0, output_step=0.02)
    assert np.abs(fine["mass.x_dot"] - 0.5 * np.cos(OMEGA * fine.t)).max() < 0.02 * 0.5
    assert not warnings_of(fine)


@pytest.mark.parametrize("every", [0.1, 0.2, 0.5])
def test_regression_samples_of_controllers_are_no_steps(every):
    """Rows before and after each sample were counted: "fixed steps of 0.0182 s"."""
    mech = oscillator()
    command = mech.input("command")
    position = mech.sensor("position", mech.parts["mass"].point, "x")
    law = lambda sample: 1e-3 * sample.reads[0]  # noqa: E731
    mech.add(bd.Controller("reader", every, [position], [command], law))
    run = bd.simulate(mech, bd.GeneralizedAlpha(0.02), 2.0)
    (message,) = warnings_of(run)
    assert "fixed steps of 0.02 s change the period" in message


def test_jumps_are_no_vibrations():
    # A stick-slip force, whose sign changes within a step.
    signs = np.repeat([1.0, -1.0], 5)
    columns = np.tile(signs, 20)[:, None]
    differences = missed_peaks._StepDifferences(1)
    differences.extend(0.01 * np.arange(len(columns)), columns)
    roughness, _ = differences.finish()
    assert roughness == 0.0


def test_prescribed_motions_have_no_warning():
    # 25 steps per revolution.
    run = bd.simulate(crank(), bd.GeneralizedAlpha(0.025), 2.0)
    assert np.abs(run["tip.x_dot"] + 3.0 * np.sin(10.0 * run.t)).max() < 0.01 * 3.0
    assert not warnings_of(run)


@pytest.mark.parametrize("step", [0.006, 0.012])
@pytest.mark.parametrize(
    ("family", "rho_inf"),
    [("generalized-alpha", 0.8), ("generalized-alpha", 0.0), ("hht", 0.6), ("newmark", 1.0)],
)
def test_regression_phase_errors_of_many_periods_are_estimated(family, rho_inf, step):
    """After 16 periods of 52 steps, a velocity was 13 % of its amplitude off without a word."""
    method = bd.GeneralizedAlpha(step=step, family=family, rho_inf=rho_inf)
    run = bd.simulate(oscillator(), method, 5.0)
    error = np.abs(run["mass.x_dot"] / 0.5 - np.cos(OMEGA * run.t)).max()
    assert error > 0.1
    (message,) = warnings_of(run)
    (estimate,) = re.findall(r"accumulates is (?:about|more than) (\S+) % of", message)
    assert float(estimate) == pytest.approx(100.0 * min(error, 1.0), rel=0.25)
    (recommended,) = re.findall(r"use a step of (\S+) s", message)
    fine = bd.simulate(oscillator(), replace(method, step=float(recommended)), 5.0)
    assert np.abs(fine["mass.x_dot"] / 0.5 - np.cos(OMEGA * fine.t)).max() < 0.02
    assert not warnings_of(fine)


def test_phase_errors_of_damped_and_driven_vibrations_do_not_accumulate():
    """The error stays at 1 % of the amplitude, which 30 periods would multiply by 10."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point))
    anchor = mech.ground.at(-1.0, 0.0)
    mech.add(bd.SpringDamper("spring", anchor, mass.point, OMEGA**2, OMEGA))
    mech.add(bd.Force("load", mass.point, (bd.sine(100.0, OMEGA / (2.0 * np.pi)), 0.0)))
    mech.observe("mass", mass.point)
    step = 2.0 * np.pi / OMEGA / 40.0
    run = bd.simulate(mech, bd.GeneralizedAlpha(step), 10.0, output_step=0.01)
    exact = bd.simulate(mech, bd.Radau(1e-7), 10.0, output_step=0.01)
    scale = np.abs(exact["mass.x_dot"]).max()
    assert np.abs(run["mass.x_dot"] - exact["mass.x_dot"]).max() < 0.02 * scale
    assert not warnings_of(run)


def test_short_runs_have_no_warning():
    # Half a period in 10 steps: half a wave is no vibration.
    run = bd.simulate(oscillator(), bd.GeneralizedAlpha(np.pi / OMEGA / 10.0), np.pi / OMEGA)
    assert not warnings_of(run)


def test_regression_rounding_errors_of_velocities_have_no_warning():
    """Rounding errors of the bearing of a gear set, 4e-22 m/s, had "errors of several percent"."""
    noise = missed_peaks.StepExtremes(-4e-22, 0.0, 4e-22, 0.5, 1e-22, roughness=1e-22)
    columns = {"car.x_dot [m/s]": noise, "car.angle_dot [rad/s]": replace(noise, max=70.0)}
    assert not list(long_step_warnings(columns, n_steps=1000, duration=1.0, length=0.1))
    motion = {"car.x_dot [m/s]": replace(noise, max=4e-2, roughness=1e-2)}
    assert len(list(long_step_warnings(motion, n_steps=1000, duration=1.0, length=0.1))) == 1
