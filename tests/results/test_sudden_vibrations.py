"""Warnings about fast vibrations after sudden loads."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.diagnostics.resolution import sudden_vibrations

_STEEL = bd.Material(E=210e9, nu=0.3, rho=7850.0)


def _suddenly_loaded(load=-2.0, damping=0.0, elements=4):
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.02, height=0.003, damping=damping)
    strip = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.6, 0.0)), section, elements))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Force("load", strip.end, (0.0, load)))
    mech.observe("tip", strip.end)
    mech.observe("clamp", clamp.reaction)
    return mech


def _stage(sides, top, height, mass):
    """Return a stage on two leaves from each of the heights `sides` to the height `top`."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.025, height=height, damping=1e-5)
    stage = mech.add(bd.RigidBody("stage", mass, 1e-3 * mass, (0.0, top)))
    for k, side in enumerate(sides):
        for name, x in ((f"left {k}", -0.04), (f"right {k}", 0.04)):
            line = bd.Line((x, side), (x, top))
            leaf = mech.add(bd.Beam(name, line, section, elements=2, formulation="exact"))
            mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, side), leaf.start))
            mech.add(bd.Weld(f"{name} top", leaf.end, stage.at(x, top)))
    mech.observe("stage", stage.at(0.0, top))
    return mech, stage.at(0.0, top)


def _run(mech, integrator=None, t_end=0.1):
    solution = bd.simulate(mech, integrator or bd.Auto(), t_end=t_end, output_step=1e-4)
    return solution, [x for x in solution.warnings if "begin suddenly" in x]


@pytest.mark.slow(reason="exact run")
def test_regression_rates_and_reactions_after_a_sudden_load_have_a_warning():
    solution, (warning,) = _run(_suddenly_loaded(), t_end=0.05)
    assert "tip.angle_dot" in warning
    assert "clamp.Fy" in warning
    assert "t = 0 s" in warning
    estimate = float(re.search(r"about ([\d.]+) %", warning)[1]) / 100.0
    exact, _ = _run(_suddenly_loaded(), bd.Radau(1e-7), t_end=0.05)
    errors = [
        np.max(np.abs(solution[x] - exact[x])) / (0.5 * np.ptp(exact[x]))
        for x in ("tip.angle_dot", "clamp.Fy")
    ]
    assert 0.5 < estimate / max(errors) < 2.0


@pytest.mark.slow(reason="a second")
def test_recommended_steps_are_sufficient():
    _, (warning,) = _run(_suddenly_loaded(), t_end=0.02)
    max_step = float(re.search(r"max_step=([\d.e-]+)", warning)[1])
    _, warnings = _run(_suddenly_loaded(), bd.Auto(max_step=max_step), t_end=0.02)
    assert not warnings


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("load", [-2.0, bd.piecewise((0.05, 0.0), -2.0)])
def test_damped_vibrations_have_no_warning(load):
    _, warnings = _run(_suddenly_loaded(load, damping=1e-5))
    assert not warnings


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("filter_time", [1e-4, 2e-3])
def test_regression_vibrations_that_filters_damp_have_no_warning(filter_time):
    """The derivative of a PID counted as a stiffness without damping: errors of "100 %"."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.025, height=4e-4, damping=1e-4)
    stage = mech.add(bd.RigidBody("stage", 0.8, 1e-3, (0.0, 0.06)))
    for name, x in (("left", -0.04), ("right", 0.04)):
        leaf = mech.add(bd.Beam(name, bd.Line((x, 0.0), (x, 0.06)), section, elements=2))
        mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, 0.0), leaf.start))
        mech.add(bd.Weld(f"{name} top", leaf.end, stage.at(x, 0.06)))
    center = stage.at(0.0, 0.06)
    error = 1e-3 - mech.sensor("x", center, "x")
    gains = {"kp": 3e4, "ki": 2e6, "kd": 260.0, "scale": 1e-4}
    force = bd.pid(mech, "pid", error, filter_time=filter_time, **gains)
    mech.add(bd.Force("coil", center, (force, 0.0)))
    mech.observe("stage", center)
    solution, warnings = _run(mech, t_end=0.05)
    assert not warnings
    exact, _ = _run(mech, bd.Radau(1e-8), t_end=0.05)
    speed, accurate = solution["stage.x_dot"], exact["stage.x_dot"]
    assert np.max(np.abs(speed - accurate)) < 1e-3 * np.max(np.abs(accurate))


@pytest.mark.slow(reason="one second")
def test_regression_controllers_that_are_saturated_at_the_start_damp_vibrations():
    """Errors of "100 %": damping was that of the start, at which the force has its limit."""
    mech, center = _stage(sides=[0.0], top=0.025, height=5e-4, mass=0.2)
    error = 2e-4 - mech.sensor("x", center, "x")
    gains = {"kp": 4e4, "ki": 2.5e6, "kd": 180.0, "filter_time": 3e-4, "scale": 1e-4}
    force = bd.pid(mech, "pid", error, **gains, limits=(-40.0, 40.0))
    mech.add(bd.Force("coil", center, (force, 0.0)))
    _, warnings = _run(mech)
    assert not warnings


@pytest.mark.slow(reason="one second")
def test_regression_controllers_of_stages_that_stiffen_damp_vibrations():
    """Errors of "3.8 %" (true: 1e-6): modes that would strain leaves later had no damping."""
    mech, center = _stage(sides=[-0.06, 0.06], top=0.0, height=4e-4, mass=1.2)
    error, rate = 2e-3 - mech.sensor("x", center, "x"), mech.sensor("v", center, "x_dot")
    gains = {"kp": 6e4, "ki": 4e6, "kd": 450.0, "rate": -rate, "scale": 1e-6}
    force = bd.pid(mech, "pid", error, **gains, limits=(-200.0, 200.0))
    mech.add(bd.Force("coil", center, (force, 0.0)))
    _, warnings = _run(mech, t_end=0.15)
    assert not warnings


@pytest.mark.slow(reason="one second")
def test_regression_stick_slip_is_no_vibration_of_the_start():
    """Errors of "100 % or more" (true: 1e-5): friction lets the vibration about rest grow."""
    mech, steel = bd.Mechanism(), bd.Material(E=206e9, nu=0.3, rho=7850.0)
    section = bd.Section.rectangle(steel, width=0.01, height=8e-4, damping=1e-4)
    holder = mech.add(bd.RigidBody.plate("holder", (0.0, 0.055), 0.02, 0.01, mass=0.01))
    mech.add(bd.Prismatic("slide", mech.ground.at(0.0, 0.055), holder.at(0.0, 0.055), (0, 1)))
    line = bd.Line((0.0, 0.05), (0.0, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements=1, formulation="exact"))
    mech.add(bd.Weld("clamp", holder.at(0.0, 0.05), blade.start))
    mech.add(bd.PointMass("lip", 0.05, on=blade.end))
    belt = mech.add(bd.RigidBody.plate("belt", (0.0, -0.005), 0.5, 0.01, mass=1.0))
    ends = mech.ground.at(0.0, -0.005), belt.at(0.0, -0.005)
    mech.add(bd.Prismatic("way", *ends, (1.0, 0.0)))
    mech.add(bd.TranslationalDriver("drive", *ends, lambda t: 0.02 * t))
    mech.add(bd.Force("press", holder.at(0.0, 0.055), (0.0, -40.0)))
    surface, friction = bd.LineSurface(belt.at(0.0, 0.0)), {"friction": 0.2, "static": 0.4}
    rubber = {"exponent": 1, "restitution": 0.3, "impact_speed": 0.05, "stribeck": 5e-3}
    mech.add(bd.Contact("lip on belt", blade.end, surface, 1e5, **friction, **rubber))
    mech.observe("tip", blade.end)
    mech.observe("sliding", mech.part("lip on belt").sliding)
    run = bd.simulate(mech, t_end=4.0, output_step=1e-4, start="equilibrium")
    assert not [x for x in run.warnings if "begin suddenly" in x]


@pytest.mark.slow(reason="half a second")
def test_regression_mechanisms_with_first_order_states_are_examined():
    """The equations of the states were missing, and no mechanism with a filter had a warning."""
    mech = _suddenly_loaded()
    height = mech.sensor("height", mech.parts["strip"].end, "y")
    bd.pid(mech, "unused", height, kp=1.0, kd=1.0, filter_time=1e-3, scale=0.01)
    _, warnings = _run(mech, t_end=0.02)
    assert len(warnings) == 1


@pytest.mark.slow(reason="exact run")
def test_regression_vibrations_that_contacts_damp_have_no_warning():
    """A contact that begins to touch has no damping yet: errors of "100 %" of the velocity."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.01, height=0.005, damping=1e-4)
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.4, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), arm.start))
    blade = mech.add(bd.PointMass("blade", 0.08, at=(0.4, 0.0)))
    mech.add(bd.PointOnLine("guide", arm.end, blade.point, direction=(1.0, 0.0)))
    mech.add(bd.Force("preload", blade.point, (10.0, 0.0)))
    glass = bd.CircleSurface(mech.ground.at(0.0, 0.0), 0.4, side="inside")
    contact = bd.Contact(
        "rub", blade.point, glass, 1e6, exponent=1, restitution=0.3, impact_speed=0.1
    )
    mech.add(contact)
    mech.observe("blade", blade.point)
    solution, warnings = _run(mech, t_end=0.2)
    assert not warnings
    exact, _ = _run(mech, bd.Radau(1e-7, max_step=3e-5), t_end=0.2)
    speed, accurate = solution["blade.x_dot"], exact["blade.x_dot"]
    assert np.max(np.abs(speed - accurate)) < 1e-3 * np.max(np.abs(accurate))


def test_smooth_loads_have_no_warning():
    _, warnings = _run(_suddenly_loaded(lambda t: -2.0 * np.sin(10.0 * t) ** 2))
    assert not warnings


@pytest.mark.slow(reason="one second")
def test_loads_that_jump_later_are_named():
    _, (warning,) = _run(_suddenly_loaded(bd.piecewise((0.05, 0.0), -2.0)))
    assert "t = 0.05 s" in warning


@pytest.mark.slow(reason="half a second")
def test_ida_is_advised_to_choose_radau():
    _, (warning,) = _run(_suddenly_loaded(), bd.Ida(1e-3), t_end=0.02)
    assert "use Radau(max_step=" in warning


def _driven(law, damping=1e-4):
    """Return a strip with a mass at its end that a driver turns."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(_STEEL, width=0.02, height=0.005, damping=damping)
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.0, 0.5)), section, elements=2))
    pivot = mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), arm.start))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), arm.start, law))
    mech.add(bd.PointMass("tip", 0.3, on=arm.end))
    mech.observe("pivot", pivot.reaction)
    mech.observe("tip", arm.end)
    return mech


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("rate", [2.4, 8.0])
def test_regression_motions_of_drivers_are_no_sudden_vibrations(rate):
    """The velocity of the driver at the start was said to cause errors of over 100 %."""

    def law(t):
        return 0.8 * np.sin(rate * t)

    solution, warnings = _run(_driven(law), bd.Radau(), t_end=0.3)
    assert not warnings
    exact, _ = _run(_driven(law), bd.Radau(1e-6, max_step=1e-4), t_end=0.3)
    for name in ("pivot.Fx", "pivot.Fy"):
        errors = np.abs(solution[name] - exact[name])
        assert np.max(errors) < 0.01 * 0.5 * np.ptp(exact[name])


def _jump(random, columns):
    steps, counts = np.sort(random.exponential(1e-3, 20)), np.ones(20)
    rates, decays = 10.0 ** random.uniform(1.0, 6.0, 40), np.zeros((20, 40))
    return sudden_vibrations._Jump(0.0, steps, counts, rates, decays, columns)


def test_regression_weak_modes_are_not_followed_through_the_steps(monkeypatch):
    """All modes were, in half of the time of this check of a pendulum."""
    random, followed = np.random.default_rng(5), []
    estimate = sudden_vibrations._estimate_changes

    def estimate_and_record(jump, *arguments):
        followed.append(len(jump.rates))
        return estimate(jump, *arguments)

    monkeypatch.setattr(sudden_vibrations, "_estimate_changes", estimate_and_record)
    amplify = sudden_vibrations.amplify_by_radau
    jump = _jump(random, 10.0 ** random.uniform(-9.0, -3.0, (40, 3)))
    expected = sudden_vibrations._estimate_errors(jump, amplify)
    assert followed.pop() == 40
    limits = 0.9 * expected
    found = sudden_vibrations._find_large_errors(jump, amplify, limits)
    np.testing.assert_array_equal(found, expected)
    assert sum(followed) == 40
    followed.clear()
    assert sudden_vibrations._find_large_errors(jump, amplify, 1.5 * expected) is None
    assert 0 < sum(followed) < 40


@pytest.mark.slow(reason="half a second")
def test_regression_modes_that_grow_about_rest_are_left_out():
    """A force that is unstable about rest overflowed an exponential: NumPy warned."""
    mech = _suddenly_loaded(damping=1e-5)
    tip = mech.parts["strip"].end

    def slip(point, t):
        v = point.velocity[1]
        return 0.0, 2e3 * v / (1.0 + (v / 1e-4) ** 2)

    mech.add(bd.ForceLaw("slip", tip, slip))
    solution, _ = _run(mech, bd.Radau(1e-3), t_end=0.5)
    assert solution.warnings == ()


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("t_end", [0.6, 1.5])
def test_regression_vibrations_that_a_contact_stops_are_no_errors(t_end):
    """The modes were those without the contact, which touches only just: 100 and 72 % were said."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(_STEEL, width=0.01, height=0.0015, damping=1e-4)
    line = bd.Line((0.0, 0.0), (0.3, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements=3, strain="exact"))
    hub = mech.add(bd.RigidBody("hub", 0.1, 2e-5))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.0, 0.0), arm.start))
    law = bd.piecewise(
        (0.5, lambda t: -0.05 * (10 * (2 * t) ** 3 - 15 * (2 * t) ** 4 + 6 * (2 * t) ** 5)), -0.05
    )
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    mech.add(bd.Contact("contact", arm.end, floor, 1e7, restitution=0.5, impact_speed=0.1))
    mech.observe("tip", arm.end)
    run = bd.simulate(mech, t_end=t_end)
    accurate = bd.simulate(mech, bd.Radau(1e-6, max_step=2e-4), t_end=t_end)
    errors = (run["tip.y_dot"] - accurate["tip.y_dot"]).abs()
    # Stated were 100 and 72 % of half the range.
    assert errors.max() < 0.02 * run.step_extremes["tip.y_dot"].half_range
    assert not any("vibrations that begin suddenly" in x for x in run.warnings)
