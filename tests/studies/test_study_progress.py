"""Progress of studies: counts of runs, and the estimate of the remaining time."""

from __future__ import annotations

from dataclasses import replace

import pytest

import beamdae as bd
from beamdae.results.outcome import Status
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import SerialPool
from beamdae.studies.execution.study_progress import TimeEstimator
from beamdae.studies.tasks import Outcome

ALPHA = bd.GeneralizedAlpha(step=5e-3)
REFERENCES = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))


@bd.model(t_end=0.1)
def swing(mass=2.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


def create_study(*cases):
    return bd.Study("progress", cases, references=REFERENCES)


def test_remaining_time_follows_the_cost_of_finished_runs():
    steps, masses = (4e-3, 2e-3, 1e-3, 5e-4), (1.0, 2.0)
    cases = [bd.Case(swing, {"mass": m}, bd.GeneralizedAlpha(h)) for m in masses for h in steps]
    tasks = [create_study(*cases).task(case) for case in cases]
    estimator = TimeEstimator(tasks, 2)
    assert estimator.remaining_time is None

    def create_outcome(task):
        wall_time = 0.002 / task.case.integrator.step * task.case.parameters["mass"]
        times = {"setup time [s]": 0.0, "measuring time [s]": 0.0, "wall time [s]": wall_time}
        return Outcome(Status("ok", ""), times)

    costs = [create_outcome(task).values["wall time [s]"] for task in tasks]
    estimator.add(tasks[0], create_outcome(tasks[0]))
    assert 0.4 < estimator.remaining_time / (sum(costs[1:]) / 2) < 1.5
    for k in (1, 4):
        estimator.add(tasks[k], create_outcome(tasks[k]))
    missing = [cost for k, cost in enumerate(costs) if k not in (0, 1, 4)]
    assert 0.7 < estimator.remaining_time / max(sum(missing) / 2, max(missing)) < 1.3
    for k in (2, 3, 5, 6, 7):
        estimator.add(tasks[k], create_outcome(tasks[k]))
    assert estimator.remaining_time == 0.0


@pytest.mark.slow(reason="half a second")
def test_progress_reports_the_remaining_time(tmp_path):
    reports = []
    study = create_study(bd.Case(swing, {}, ALPHA), bd.Case(swing, {}, bd.Ida(rtol=1e-3)))
    study_run.run_study(study, tmp_path, SerialPool(), reports.append)
    assert reports[0].remaining_time is None
    assert all(report.remaining_time >= 0.0 for report in reports[1:])
    assert reports[-1].remaining_time == 0.0
    more = replace(study, cases=(*study.cases, bd.Case(swing, {}, bd.Radau(rtol=1e-3))))
    again = []
    study_run.run_study(more, tmp_path, SerialPool(), again.append)
    assert again[0].remaining_time > 0.0, "stored runs count"
