"""Breakpoints of laws: restarts, jumps, resolution and the energy balance."""

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from mechanisms import ALLOY, cantilever, hinged_body, rectangle, symbols
from numpy.testing import assert_allclose

import beamdae as bd

every_integrator = integrators(rtol=1e-7, step=1e-3)


def driven_bar(law):
    mech, bar = hinged_body(2.0, 0.1, (0.5, 0.0), name="bar", gravity=9.81)
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=law))
    return mech


@every_integrator
def test_driver_angle_jump_ends_the_run(integrator):
    solution = bd.simulate(driven_bar(bd.piecewise((0.3, 0.0), 0.8)), integrator, t_end=1.0)
    assert not solution.status.success
    assert "positions jump by 0.8 (m or rad) at t = 0.3 s" in solution.status.sentence
    assert_allclose(solution.t[-1], 0.3, rtol=1e-12)


@every_integrator
def test_driver_speed_jump_counts_as_work(integrator):
    law = bd.piecewise((0.3, 0.0), lambda t: 2.0 * (t - 0.3))
    solution = bd.simulate(driven_bar(law), integrator, t_end=1.0, output_step=0.1)
    assert solution.status.success
    # Inertia about the hinge 0.6 kg m^2 at 2 rad/s, and the weight lifted to sin(1.4 rad) / 2.
    expected = 0.5 * 0.6 * 2.0**2 + 2.0 * 9.81 * 0.5 * np.sin(1.4)
    # The work error of first-order steps equals their relative step length.
    first_order = integrator.accuracy.name == "step" and integrator.order == 1
    rtol = integrator.step if first_order else 1e-5
    assert_allclose(solution.energies["energy.work_of_drivers [J]"].iloc[-1], expected, rtol=rtol)
    assert solution.quality.energy_imbalance < rtol


@pytest.mark.parametrize(
    "timing", [{"breakpoints": (7.98, 8.02)}, {"time_scale": 0.04}], ids=["breakpoints", "scale"]
)
def test_constrained_system_has_breakpoints_and_time_scale(timing):
    t, q, v = symbols()
    push = ca.if_else(ca.logic_and(t > 7.98, t < 8.02), 100.0, 0.0)
    mass = bd.ConstrainedSystem(t=t, q=q, v=v, mass=1.0, force=push, q0=[0.0], v0=[0.0], **timing)
    solution = bd.simulate(mass, bd.Ida(1e-6), t_end=10.0)
    assert_allclose(solution.v[-1], 4.0, rtol=1e-3)


def test_strongly_damped_beam_dissipates_its_strain_energy():
    """Sign of the dissipation: all strain energy of a release is dissipated."""
    line, section = (
        bd.Line((0.0, 0.0), (0.5, 0.0)),
        rectangle(0.01, 0.03, material=ALLOY, damping=0.02),
    )
    mech = cantilever(2, line, section, load=(0.0, bd.piecewise((1.0, 50.0), 0.0)))
    solution = bd.simulate(mech, bd.Ida(1e-5), t_end=3.0)
    ledger = solution.energies.iloc[-1]
    work = ledger["energy.work_of_loads [J]"]
    # Work of the quasi-static push, F^2 L^3 / (3 EI), which is dissipated entirely.
    assert_allclose(work, 50.0**2 * 0.5**3 / (3.0 * 70e9 * 0.03 * 0.01**3 / 12.0), rtol=0.02)
    assert_allclose(ledger["energy.dissipated [J]"], work, rtol=1e-3)
    assert solution.quality.energy_imbalance < 1e-3


@pytest.mark.slow(reason="half a second")
def test_regression_drift_at_a_breakpoint_is_not_reported_as_a_jump():
    """The restart corrected a drift of 1.3e-3, which was reported as a jump of the run-up."""
    from slider_crank import slider_crank

    drifting = bd.Ida(1e-3, formulation="index1")
    solution = bd.simulate(slider_crank(frame="chord"), drifting, t_end=0.6)
    assert solution.status.success
    assert solution.quality.max_position_drift > 1e-4
