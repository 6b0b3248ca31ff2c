"""Events of the cases of studies: rows that end where they happen, and how well they are met."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console

import beamdae as bd
from beamdae.report.terminal import text_tables as terminal
from beamdae.studies.case_table import assemble_case_table, tabulate_case
from beamdae.studies.execution.tasks import Outcome
from beamdae.studies.references import build_reference, create_reference_tasks
from beamdae.studies.run_values import collect_run_values, tabulate_trajectory


@bd.model(t_end=1.0)
def pendulum(turn=2.6, length=1.0):
    """Passes its lowest point, and is stopped between two rows of its table."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", 1.0, inertia=0.01, center=(length, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(length, 0.0))
    mech.when("bob.x", 0.0, "down", "record", "bottom")
    mech.when("bob.angle", -turn, "down", "stop", "caught")
    return mech


FINE = bd.Radau(rtol=1e-9)
FIRST = "event bottom, first [s]"


def test_a_case_tells_its_events_and_how_far_they_are_off():
    cases = [bd.Case(pendulum, {}, bd.GeneralizedAlpha(step=h)) for h in (4e-3, 2e-3)]
    table = bd.compare(cases, reference=bd.Case(pendulum, {}, FINE))
    assert list(table["events"]) == ["bottom, caught"] * 2
    assert list(table["event bottom, times"]) == [1, 1]
    whole = bd.simulate(pendulum, FINE)
    off = np.abs(table[FIRST] - whole.event_records[0].t)
    assert_allclose(table[f"error of {FIRST}"], off, atol=1e-12)
    # Order 2, as the trajectory has it.
    assert_allclose(off[0] / off[1], 4.0, rtol=0.05)
    assert_allclose(table["error [-]"][0] / table["error [-]"][1], 4.0, rtol=0.05)
    assert (table["warnings"] == "").all()
    screen = Console(width=160, file=io.StringIO())
    screen.print(terminal.comparison_table(table))
    assert "bottom, caught" in screen.file.getvalue()


@pytest.mark.slow(reason="a study")
def test_a_case_with_other_events_than_the_reference_warns():
    case = bd.Case(pendulum, {"turn": 4.0}, FINE)
    table = bd.compare([case], reference=bd.Case(pendulum, {}, FINE))
    assert table["warnings"][0] == (
        "other events than in the reference: bottom; in the reference: bottom, caught."
    )
    # A longer reference tells of the time of the case alone.
    later = bd.compare([case], reference=bd.simulate(pendulum, FINE), t_end=0.6)
    assert later["warnings"][0] == ""
    # Of a shorter one it is not known what would happen later.
    early = bd.compare([case], reference=bd.simulate(pendulum, FINE, 0.5))
    assert early["warnings"][0] == ""


def test_references_that_events_end_are_extrapolated_and_agree():
    study = bd.Study(
        name="caught",
        cases=(bd.Case(pendulum),),
        references=(bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-10), FINE),
    )
    methods = create_reference_tasks(study, study.cases)
    outcomes = {}
    for task in (task for tasks in methods for task in tasks):
        solution = bd.simulate(pendulum, task.case.integrator, 1.0, 1e-3)
        outcomes[task.key] = Outcome(
            solution.status, collect_run_values(solution), tabulate_trajectory(solution)
        )
    ends = {outcome.table.index[-1] for outcome in outcomes.values()}
    assert len(ends) == 3
    reference = build_reference(study, methods, outcomes)
    truth = outcomes[methods[1][0].key]
    assert reference.uncertainty < 1e-6
    # Extrapolated, their times are much better than those of either run.
    coarse, fine = (outcomes[task.key].values[FIRST] for task in methods[0])
    off = abs(reference.events[FIRST] - truth.values[FIRST])
    assert off < 1e-2 * min(abs(x - truth.values[FIRST]) for x in (coarse, fine))
    told = assemble_case_table([tabulate_case(study.cases[0], "caught", truth, reference)])
    assert_allclose(told[f"error of {FIRST}"], off, rtol=1e-6)
    failed = replace(truth, status=replace(truth.status, kind="failed"), values={"steps": 3})
    told = assemble_case_table([tabulate_case(study.cases[0], "caught", failed, reference)])
    assert np.isnan(told[f"error of {FIRST}"][0])
