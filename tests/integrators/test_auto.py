"""Choice between Ida and Radau by Auto."""

from dataclasses import replace

import numpy as np
import pytest
from hub_beam import hub_beam
from mechanisms import EARTH, hinged
from numpy.testing import assert_allclose
from tolerances.cases import ALL

import beamdae as bd
from beamdae.integrators import pilot_run
from beamdae.integrators.ida.ida import IdaStepper
from beamdae.integrators.integrator import StepError


def block_on_belt(stiffness, stribeck):
    """Return a block of 1 kg on a belt with 0.1 m/s, held by a spring [N/m]."""
    mech = bd.Mechanism(gravity=EARTH)
    belt = mech.add(bd.RigidBody("belt", 5.0, 0.1))
    ends = mech.ground.at(0.0, 0.0), belt.at(0.0, 0.0)
    mech.add(bd.Prismatic("rollers", *ends))
    mech.add(bd.TranslationalDriver("motor", *ends, lambda t: 0.1 * t, (1.0, 0.0)))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.0, -9.81e-6)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, -9.81e-6), block.point, stiffness))
    law = {"friction": 0.3, "static": 0.5, "stribeck": stribeck}
    law |= {"exponent": 1.0, "restitution": 0.2, "impact_speed": 0.1}
    surface = bd.LineSurface(belt.at(0.0, 0.0))
    pad = mech.add(bd.Contact("pad", block.point, surface, 1e6, **law))
    mech.observe("block", block.point)
    mech.observe("pad", pad.force)
    return mech


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_auto_chooses_radau_if_modes_are_too_fast_to_be_resolved(damping, rtol):
    mech = hub_beam(damping=damping, elements=2)
    auto = bd.simulate(mech, bd.Auto(rtol, max_steps=20), t_end=0.5)
    assert auto.integrator["method"] == "Radau"
    assert auto.integrator["integrator"] == "Auto"
    assert auto.statistics.steps == 20


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_auto_chooses_ida_if_all_modes_are_resolved(rtol):
    auto = bd.simulate(swing(), bd.Auto(rtol, max_steps=20), t_end=0.5)
    assert auto.integrator["method"] == "Ida"
    assert auto.integrator["max_order"] == 5


def test_auto_chooses_radau_with_sampled_controllers():
    """Ida takes 5 to 12 steps after each sample, Radau one."""
    mech = swing()
    push = mech.input("push")
    mech.add(bd.Controller("idle", 0.1, [], [push], lambda sample: sample.index % 2))
    auto = bd.simulate(mech, bd.Auto(), t_end=0.5)
    assert auto.integrator["method"] == "Radau"
    assert bd.simulate(swing(), bd.Auto(), t_end=0.5).integrator["method"] == "Ida"


@pytest.mark.parametrize("rtol", [1e-4, 1e-5])
def test_regression_paths_of_skates_keep_the_bound(rtol):
    """Errors of velocities displace paths for good: Ida was wrong by 206 rtol in another case."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sledge", 1.0, 0.1, velocity=(0.5, 0.0), angular_velocity=2.0))
    mech.add(bd.Skate("skate", body.at(0.0, 0.0)))
    anchor = mech.ground.at(0.3, -1.0)
    mech.add(bd.Spring("spring", anchor, body.at(0.2, 0.0), 20.0, 0.1))
    mech.observe("sledge", body.at(0.2, 0.0))
    auto = bd.simulate(mech, bd.Auto(rtol), t_end=5.0)
    exact = bd.simulate(mech, bd.Radau(1e-9), t_end=5.0)
    assert auto.integrator["method"] == "Radau"
    errors = (auto.observed - exact.observed).abs().max()
    half_ranges = 0.5 * (exact.observed.max() - exact.observed.min())
    positions = ["sledge.x [m]", "sledge.y [m]", "sledge.angle [rad]"]
    assert np.all(errors[positions] < 30.0 * rtol * half_ranges[positions])


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("integrator", [bd.Auto, bd.Ida])
@pytest.mark.parametrize(("rtol", "pilot_steps"), [(1e-4, None), (1e-3, 1000)])
def test_regression_long_runs_keep_the_bound(integrator, rtol, pilot_steps, monkeypatch):
    """A pendulum was wrong by 273 rtol after 80 periods, and with short pilot runs by 2400 rtol."""
    if pilot_steps:
        monkeypatch.setattr(pilot_run, "_MAX_PILOT_STEPS", pilot_steps)
    (pendulum,) = (case for case in ALL if case.name == "period_two")
    case = replace(pendulum, duration=2.0 * 80, rows=4001)
    solution = case.run(integrator(rtol))
    assert not pilot_steps or "amplitudes" not in solution.integrator
    if integrator is bd.Auto:
        assert solution.integrator["method"] == "Radau"
    assert case.errors(solution, reference=case.exact(case.times)).max() < 30.0 * rtol


@pytest.mark.slow(reason="one second")
def test_auto_repeats_the_run_of_the_chosen_integrator():
    for model, chosen in ((hub_beam(elements=2), bd.Radau), (swing(), bd.Ida)):
        auto, same = (bd.simulate(model, one, t_end=0.5) for one in (bd.Auto(1e-4), chosen(1e-4)))
        assert_allclose(auto.q, same.q, rtol=0.0, atol=0.0)
        assert auto.integrator["amplitudes"] == same.integrator["amplitudes"]


@pytest.mark.slow(reason="one second")
def test_ida_notes_that_its_order_is_limited():
    mechs = hub_beam(elements=2), swing()
    notes = [
        bd.simulate(mech, bd.Ida(1e-4, max_steps=5), t_end=0.5).integrator.get("note", "")
        for mech in mechs
    ]
    assert "use Radau(rtol) or Auto(rtol)" in notes[0]
    assert "errors, mainly of deflections, may exceed the bound" in notes[0]
    assert notes[1] == ""


def fail(*_):
    raise StepError("no step is possible")


def swing():
    """A rigid pendulum."""
    mech, rod = hinged(
        bd.RigidBody.rod("rod", (0.0, 0.0), (1.0, 0.0), density=7850.0, area=1e-4), gravity=9.81
    )
    mech.observe("end", rod.at(1.0, 0.0))
    return mech


def test_radau_repeats_a_run_in_which_ida_fails(monkeypatch):
    monkeypatch.setattr(IdaStepper, "advance", fail)
    solution = bd.simulate(swing(), bd.Auto(1e-4), t_end=0.5)
    assert solution.status.success
    assert solution.integrator["method"] == "Radau"
    assert "Ida failed at t = 0 s" in solution.integrator["note"]


def test_auto_is_the_default_integrator():
    solution = bd.simulate(hub_beam, t_end=0.1)
    assert solution.made_by == bd.Auto()
    assert np.isfinite(solution.q).all()


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(("stribeck", "method"), [(2e-2, "Ida"), (2e-4, "Radau")])
def test_regression_friction_that_sticks_is_resolved(stribeck, method):
    """Ida held a block on a belt 8 % too long: its force exceeded the static friction."""
    mech = block_on_belt(100.0, stribeck)
    run = bd.simulate(mech, bd.Auto(1e-5), t_end=1.0)
    assert run.integrator["method"] == method
    exact = bd.simulate(mech, bd.Ida(1e-8), t_end=1.0)
    # The error of the displacement is a small multiple of the tolerance but for the time of the
    # first slip, which follows the peak of the friction.
    largest, expected = (x.step_extremes["block.x"].max for x in (run, exact))
    assert largest == pytest.approx(expected, rel=2e-3)
