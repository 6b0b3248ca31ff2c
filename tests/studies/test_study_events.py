"""Events in studies: their columns in the case table, and errors of their times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from study_runs import SerialPool, run_study

import beamdae as bd


@bd.model(t_end=1.0)
def pendulum(turn=2.6, length=1.0):
    """It passes its lowest point, and stops between two output times."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", 1.0, inertia=0.01, center=(length, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(length, 0.0))
    mech.when("bob.x", 0.0, "down", "record", "bottom")
    mech.when("bob.angle", -turn, "down", "stop", "caught")
    return mech


FINE = bd.Radau(rtol=1e-9)
FIRST_TIME = "event bottom, first [s]"


@pytest.mark.slow(reason="half a second")
def test_rows_contain_events_and_the_errors_of_their_times():
    cases = [bd.Case(pendulum, {}, bd.GeneralizedAlpha(step=h)) for h in (4e-3, 2e-3)]
    table = bd.compare(cases, reference=bd.Case(pendulum, {}, FINE))
    assert list(table["events"]) == ["bottom, caught"] * 2
    assert list(table["event bottom, times"]) == [1, 1]
    exact = bd.simulate(pendulum, FINE)
    errors = np.abs(table[FIRST_TIME] - exact.event_records[0].t)
    assert_allclose(table[f"error of {FIRST_TIME}"], errors, atol=1e-12)
    # Order 2, as for the trajectory.
    assert_allclose(errors[0] / errors[1], 4.0, rtol=0.05)
    assert_allclose(table["error [-]"][0] / table["error [-]"][1], 4.0, rtol=0.05)
    assert (table["warnings"] == "").all()


@pytest.mark.slow(reason="a study")
def test_a_case_with_other_events_than_the_reference_warns():
    case = bd.Case(pendulum, {"turn": 4.0}, FINE)
    table = bd.compare([case], reference=bd.Case(pendulum, {}, FINE))
    assert table["warnings"][0] == (
        "events differ from the reference: bottom instead of bottom, caught."
    )
    # Events of a longer reference count up to the end of the case.
    later = bd.compare([case], reference=bd.simulate(pendulum, FINE), t_end=0.6)
    assert later["warnings"][0] == ""
    # A shorter reference lacks the events after its end.
    early = bd.compare([case], reference=bd.simulate(pendulum, FINE, 0.5))
    assert early["warnings"][0] == ""


@pytest.mark.slow(reason="half a second")
def test_references_that_end_at_an_event_have_its_time(tmp_path):
    coarse = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-10)
    study = bd.results.Study("caught", (bd.Case(pendulum),), references=(coarse, FINE))
    results = run_study(study, tmp_path, SerialPool())
    (reference,) = results.references.values()
    assert reference.uncertainty < 1e-6
    halved = bd.simulate(pendulum, replace(coarse, step=1e-3))
    assert reference.events[FIRST_TIME] == halved.event_records[0].t
    times = results.table[FIRST_TIME], results.table[f"error of {FIRST_TIME}"]
    assert_allclose(times[1], abs(times[0] - reference.events[FIRST_TIME]), atol=1e-12)


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
