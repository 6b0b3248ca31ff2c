"""Honest tolerance: the error of a whole run stays within a known factor of rtol.

References: Radau at a tight tolerance, confirmed by Richardson extrapolation of generalized-alpha
(validation/tolerances/run.py --references), agreement 4e-6 of the amplitude or better.
"""

import numpy as np
import pytest
from hub_beam import hub_beam
from slider_crank import slider_crank
from tolerance_cases import every_case, every_case_in_its_time
from tolerances.cases import CASES

import beamdae as bd

adaptive = pytest.mark.parametrize("integrator", [bd.Ida, bd.Radau])


@adaptive
@every_case_in_its_time
def test_error_falls_with_rtol_and_stays_in_bounds(case, integrator):
    rtols = (1e-3, 1e-4)
    solutions = [case.run(integrator(rtol)) for rtol in rtols]
    assert all(s.status.success for s in solutions)
    errors = np.array([case.errors(s).max() for s in solutions])
    assert np.all(np.diff(errors) < 0.0)
    assert np.all(errors <= case.bound * np.array(rtols))


@pytest.mark.slow(reason="undamped beams at 1e-7 take hundreds of thousands of steps of order 2")
@adaptive
@every_case
def test_error_keeps_falling_at_tight_tolerances(case, integrator):
    # The test above has the first one in common.
    rtols = (1e-4, 1e-5, 1e-6, 1e-7)
    errors = np.array([case.errors(case.run(integrator(rtol))).max() for rtol in rtols])
    assert np.all(np.diff(errors) < 0.0)
    assert np.all(errors <= case.bound * np.array(rtols))


def test_auto_order_follows_damping():
    by_name = {case.name: case for case in CASES}
    damped, undamped = (
        bd.simulate(by_name[name].model(**by_name[name].parameters), bd.Ida(1e-3), t_end=0.01)
        for name in ("pendulum_damped", "pendulum_undamped")
    )
    assert (damped.integrator["max_order"], undamped.integrator["max_order"]) == (5, 2)
    assert damped.integrator["error_control"] == undamped.integrator["error_control"] == "positions"
    assert "overdamped" in damped.integrator["auto"]
    assert "undamped" in undamped.integrator["auto"]


@pytest.mark.parametrize(
    ("damping", "order", "words"),
    [(0.0, 2, "undamped"), (1e-5, 2, "lightly damped"), (1e-4, 5, "overdamped")],
)
def test_auto_order_is_two_where_modes_below_the_fastest_are_lightly_damped(damping, order, words):
    """Order 5 took 3 to 13 times the steps of order 2 at 1e-5 s, and half of them at 1e-4 s."""
    for model in (slider_crank, hub_beam):
        told = bd.simulate(model(damping=damping), bd.Ida(max_steps=1), t_end=2.0).integrator
        assert told["max_order"] == order
        assert words in told["auto"]


@adaptive
def test_auto_tests_velocities_too_where_no_mode_is_fast(integrator):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    told = bd.simulate(mech, integrator(1e-6), t_end=0.1).integrator
    assert told["error_control"] == "velocities"
    assert told.get("max_order", 5) == 5


def test_pendulum_of_five_seconds_in_one_go():
    from pendulum import pendulum

    solution = bd.simulate(pendulum, bd.Ida(1e-5))
    assert solution.status.success
    assert solution.t[-1] == pendulum.t_end
    # Kelvin-Voigt dissipation included: the books close to a small multiple of rtol.
    assert solution.quality.energy_imbalance < 1e-4
