"""Events in studies: their columns in the case table, and errors of their times."""

import numpy as np
import pytest
from mechanisms import hinged_body
from numpy.testing import assert_allclose

import beamdae as bd


@bd.model(t_end=1.0)
def pendulum(turn=2.6, length=1.0):
    """It passes its lowest point, and stops between two output times."""
    mech, bob = hinged_body(1.0, 0.01, (length, 0.0), name="bob", gravity=9.81)
    mech.observe("bob", bob.at(length, 0.0))
    mech.when("bob.x", 0.0, "down", "record", "bottom")
    mech.when("bob.angle", -turn, "down", "stop", "caught")
    return mech


FINE = bd.Radau(rtol=1e-9)


def test_rows_contain_events():
    cases = [bd.Case(pendulum, {"turn": turn}, FINE) for turn in (2.6, 4.0)]
    assert list(bd.compare(cases)["events"]) == ["bottom, caught", "bottom"]


@pytest.mark.slow(reason="half a second")
def test_regression_summaries_of_sweeps_name_the_runs_that_events_stopped():
    """A sweep whose runs were stopped by events said that they "reached the end time"."""
    results = bd.sweep(pendulum, {"turn": [2.6, 4.0]}, of="bob.x", integrator=FINE)
    assert "2 cases, 1 reached the end time, 1 stopped by an event" in repr(results)
    results = bd.sweep(pendulum, {"turn": [2.5, 2.6]}, of="bob.x", integrator=FINE)
    assert repr(results).endswith("2 cases, 2 stopped by an event>")


@pytest.mark.slow(reason="two seconds")
def test_sweeps_and_cases_start_from_a_state():
    start = {"bob.angle": -1.0}
    results = bd.sweep(pendulum, {"length": [0.5, 1.0]}, of="bob.x", integrator=FINE, start=start)
    for length in (0.5, 1.0):
        case = bd.Case(pendulum, {"length": length}, FINE, start)
        exact = bd.simulate(pendulum(length=length), FINE, 1.0, 2.5e-3, start=start)
        assert_allclose(results.run(length=length)["bob.x"], exact["bob.x"], atol=1e-8)
        assert_allclose(case.solve(1.0, 2.5e-3)["bob.x"], exact["bob.x"], atol=1e-8)
    assert results.run(length=1.0)["bob.x"].iloc[0] == pytest.approx(np.cos(1.0))
    with pytest.raises(bd.BeamdaeError, match="start is an option of runs"):
        bd.sweep(pendulum, {"length": [1.0]}, start=start, measure={"zero": lambda model: 0.0})


def test_cases_with_different_starts_have_different_references_and_names():
    drawn, lifted = bd.Case(pendulum), bd.Case(pendulum, start={"bob.angle": 0.5})
    again = bd.Case(pendulum, start={"bob.angle": 0.5})
    assert lifted.group == "pendulum from {'bob.angle': 0.5}"
    assert bd.Case(pendulum, start="equilibrium").group == "pendulum from equilibrium"
    assert bd.Case(pendulum, start=bd.rotation(3.0)).group.startswith("pendulum from Rotation(")
    assert lifted.mechanism_fingerprint() == again.mechanism_fingerprint()
    assert lifted.mechanism_fingerprint() != drawn.mechanism_fingerprint()
