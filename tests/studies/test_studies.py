"""Studies: execution, case tables, failures, resumption and definitions."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from slow_study import slow_study
from typer.testing import CliRunner

import beamdae as bd
from beamdae.cli.app import app
from beamdae.cli.model_files.model_file import ModelFile
from beamdae.studies.case_summaries import summarize_cases, summarize_mesh_study
from beamdae.studies.case_table import assemble_case_table, tabulate_case
from beamdae.studies.execution import case_run, study_run
from beamdae.studies.execution.executors import LocalPool, SerialPool
from beamdae.studies.references import REFERENCE_NOT_RUN
from beamdae.studies.store.store import Store
from beamdae.studies.study_page import create_study_page
from beamdae.studies.tasks import Limits, Outcome

ALPHA = bd.GeneralizedAlpha(step=2e-3)
REFERENCES = (bd.Ida(rtol=1e-7), bd.GeneralizedAlpha(step=5e-4, newton_tolerance=1e-10))
# For tests that do not check errors.
COARSE = (bd.Ida(rtol=1e-5), bd.GeneralizedAlpha(step=5e-3, newton_tolerance=1e-10))


@bd.model(t_end=0.4)
def swing(mass=2.0, torque=0.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.add(bd.Moment("torque", on=bob.at(1.0, 0.0), law=torque))
    mech.observe("end", bob.at(2.0, 0.0))
    mech.observe("hinge", hinge.reaction)
    return mech


@bd.model(t_end=0.4)
def singular_torque(limit=0.2):
    """Its moment becomes complex at t = limit."""
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 2.0, inertia=0.1))
    mech.add(bd.Moment("torque", on=bob.at(0.0, 0.0), law=lambda t: (limit - t) ** 1.5))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


@bd.model(t_end=0.1)
def zero_division(mass=0.0):
    return 1.0 / mass


@bd.model(t_end=0.1)
def self_killing(marker="", tries=1):
    """It kills its process until the file `marker` has `tries` characters."""
    with open(marker, "a+") as file:
        file.seek(0)
        if len(file.read()) < tries:
            file.write("x")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    return swing()


def create_study(cases, references=COARSE, **settings):
    return bd.Study("made", tuple(cases), references=references, **settings)


def run(study, folder, executor=None, progress=None):
    return study_run.run_study(study, folder, executor or SerialPool(), progress)


STEPS = (0.02, 0.01, 0.005)
SWINGS = [
    bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
    for mass in (1.0, 3.0)
    for h in STEPS
]


@pytest.fixture(scope="module")
def swings(tmp_path_factory):
    return run(create_study(SWINGS, REFERENCES), tmp_path_factory.mktemp("swings"))


# Executors ------------------------------------------------------------------------------------

TIME_AND_MEMORY_COLUMNS = [
    "wall time [s]",
    "setup time [s]",
    "measuring time [s]",
    "peak memory [GB]",
]


@pytest.mark.slow(reason="starts processes for a whole study")
def test_processes_and_serial_runs_give_the_same_table(tmp_path):
    study = create_study(
        [*SWINGS[:2], bd.Case(singular_torque, {}, ALPHA), bd.Case(zero_division, {}, ALPHA)]
    )
    executors = {"serial": SerialPool(), "processes": LocalPool(2)}
    results = [run(study, tmp_path / name, pool) for name, pool in executors.items()]
    serial, parallel = (x.table.drop(columns=TIME_AND_MEMORY_COLUMNS) for x in results)
    assert list(serial["status"][:2]) == ["ok", "ok"]
    assert serial["reason"][2].startswith("stopped at t = 0.2 s")
    assert "ZeroDivisionError" in serial["reason"][3]
    pd.testing.assert_frame_equal(parallel, serial)


@bd.model(t_end=0.1)
def logging(file="", name=""):
    """It appends its name and process to a file."""
    with open(file, "a") as log:
        log.write(f"{name} {os.getpid()}\n")
    return swing()


def test_serial_runs_are_executed_in_this_process_in_order(tmp_path):
    file = tmp_path / "log"
    cases = [bd.Case(logging, {"file": str(file), "name": name}, ALPHA) for name in "abc"]
    study = create_study(cases)
    results = list(SerialPool().run_tasks([study.task(case) for case in cases]))
    assert [task.case for task, _, _ in results] == cases
    assert [(outcome.status.kind, is_new) for _, outcome, is_new in results] == [("ok", True)] * 3
    assert file.read_text().splitlines() == [f"{name} {os.getpid()}" for name in "abc"]


@pytest.mark.slow(reason="a study")
def test_an_interrupted_serial_run_ends_the_study_and_is_repeated(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    # Enough steps for a call of the progress function, which follows 256 fixed steps.
    fine = bd.GeneralizedAlpha(5e-4)
    study = create_study(
        [bd.Case(swing, {"mass": mass}, fine) for mass in (1.0, 2.0)], (COARSE[0], fine)
    )
    with monkeypatch.context() as patch:
        patch.setattr(case_run._LimitMonitor, "__call__", interrupt)
        results = run(study, tmp_path)
    assert results.interrupted
    # Ida may take too few steps for one.
    *completed, outcome = results.outcomes.values()
    assert all(one.status.success for one in completed)
    assert len(completed) < 2
    assert outcome.status.sentence.startswith("interrupted at t = ")
    assert set(results.table["status"]) == {"interrupted"}
    assert set(run(study, tmp_path).table["status"]) == {"ok"}


# Tables ---------------------------------------------------------------------------------------


def test_each_case_is_a_row_in_order(swings):
    table = pd.read_csv(swings.folder / "cases.csv")
    assert list(table["label"]) == [case.label for case in SWINGS]
    assert list(table["mass"]) == [1.0, 1.0, 1.0, 3.0, 3.0, 3.0]
    assert set(table["status"]) == {"ok"}
    assert list(table["group"].unique()) == ["swing(mass=1.0)", "swing(mass=3.0)"]
    for column in ("wall time [s]", "setup time [s]", "steps", "residual calls", "solves"):
        assert (table[column] > 0).all()
    assert (table["peak memory [GB]"] > 0.01).all()
    # Rounding.
    assert (table["max position drift"] < 1e-9).all()


def test_errors_are_relative_to_a_reference_of_two_methods(swings):
    for group, reference in swings.references.items():
        assert reference.methods == (
            "Ida(rtol=1e-07)",
            "GeneralizedAlpha(step=0.00025, newton_tolerance=1e-10), extrapolated",
        )
        rows = swings.table[swings.table["group"] == group]
        errors = rows["error [-]"].to_numpy()
        # Order 2, and above the resolution of the reference.
        assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.1)
        assert errors.min() > reference.resolution()
        assert (rows["reference uncertainty [-]"] == reference.uncertainty).all()


@pytest.mark.slow(reason="half a second")
def test_unresolved_errors_are_bounds(tmp_path):
    """Plots showed them as errors; the largest difference of all columns was the limit of each."""
    cases = [bd.Case(swing, {}, method) for method in (bd.GeneralizedAlpha(0.02), bd.Radau(1e-9))]
    results = run(create_study(cases, REFERENCES), tmp_path)
    (reference,) = results.references.values()
    table = pd.read_csv(results.folder / "cases.csv")
    assert table["below resolution"].dtype == bool
    assert ",TRUE," in (results.folder / "cases.csv").read_text()
    assert list(table["below resolution"]) == [False, True]
    assert table["error bound [-]"][0] == table["error [-]"][0]
    assert np.isnan(table["error [-]"][1])
    assert_allclose(table["error bound [-]"][1], 10.0 * reference.uncertainty)
    half_range = 0.5 * np.ptp(reference.table["end.x [m]"])
    of_forces = [x for name, x in reference.differences.items() if name.endswith("N]")]
    assert_allclose(table["reaction error bound [-]"][1], 10.0 * max(of_forces))
    of_x = reference.differences["end.x [m]"]
    assert_allclose(table["error of end.x, bound [m]"][1], 10.0 * half_range * of_x)
    assert table["reaction error [-]"].isna().tolist() == [False, True]
    assert table["error of end.x, max [m]"].isna().tolist() == [False, True]


@bd.model(t_end=0.4)
def springs():
    """Two masses; coarse fixed steps do not resolve the vibration of the fast one."""
    mech = bd.Mechanism()
    for name, stiffness in (("slow", 1e2), ("fast", 1e6)):
        mass = mech.add(bd.PointMass(name, 1.0, at=(1.0, 0.0), velocity=(0.1, 0.0)))
        mech.add(bd.Spring(f"{name} spring", mech.ground.at(0.0, 0.0), mass.point, stiffness))
        mech.observe(name, mass.point)
    return mech


@pytest.mark.slow(reason="one second")
def test_regression_columns_without_reference_do_not_hide_the_errors_of_others(tmp_path):
    """One column whose references differed left all columns without errors, and was not named."""
    cases = [bd.Case(springs, {}, bd.GeneralizedAlpha(step=h)) for h in (0.02, 0.01)]
    results = run(create_study(cases), tmp_path / "both")
    (reference,) = results.references.values()
    assert reference.columns == ("slow.x [m]",)
    assert " of the amplitude of slow.x, so errors below 10 times this are" in reference.sentence
    assert "no errors of columns that differ by more (fast.x [m] by " in reference.sentence
    assert results.table["error of slow.x, max [m]"].notna().all()
    hidden = run(create_study(cases, columns=("fast.x",)), tmp_path / "fast")
    (reference,) = hidden.references.values()
    assert reference.table is None
    assert "0.01 of the amplitude in all columns (fast.x [m] by " in reference.sentence


def test_the_summary_has_orders_and_the_fastest_integrators(swings):
    summary = pd.read_csv(swings.folder / "summary.csv")
    orders = summary[summary["what"] == "order in step"]
    assert_allclose(orders["value"], 2.0, atol=0.1)
    fastest = summary[(summary["what"] == "fastest") & (summary["at"] == "error <= 1e-02")]
    assert set(fastest["answer"]) <= {case.label for case in SWINGS}


def create_rows(series, step, order, cost, scatter=None):
    """Return rows with error = step^order and wall time = cost / step."""
    rows = pd.DataFrame({"step [s]": step})
    rows = rows.assign(
        **{"group": "g", "status": "ok", "series": series, "rtol": np.nan},
        **{"error [-]": rows["step [s]"] ** order, "wall time [s]": cost / rows["step [s]"]},
        **{"error bound [-]": rows["step [s]"] ** order, "below resolution": False},
        label=[f"{series}(step={h:g})" for h in step],
    )
    if scatter is None:
        return rows
    factors = {"min": 1.0 / (1.0 + scatter), "max": 1.0 + scatter}
    extremes = {f"wall time {name} [s]": f * rows["wall time [s]"] for name, f in factors.items()}
    return rows.assign(**extremes)


def create_crossing_series(scatter=None):
    return [
        create_rows("coarse", (0.1, 0.01, 0.001), 1, 1e-4, scatter),
        create_rows("fine", (0.5, 0.1, 0.03), 3, 1e-3, scatter),
    ]


@pytest.mark.parametrize("scatter", [None, 0.1, 1.0])
def test_crossovers_are_errors_below_which_another_series_is_fastest(scatter):
    summary = summarize_cases(pd.concat(create_crossing_series(scatter))).set_index("what")
    # 1e-4 / e = 1e-3 / e^(1/3): e = 10^-1.5.
    assert_allclose(summary.loc["crossover", "value"], 10.0**-1.5, rtol=0.05)
    assert summary.loc["crossover", "answer"] == "fine"
    assert_allclose(summary.loc["order in step", "value"].astype(float), [1.0, 3.0], atol=1e-6)


def test_differences_within_the_scatter_of_wall_times_are_no_crossovers():
    """The series differ by less than a factor of ten at all common errors."""
    assert "crossover" not in set(summarize_cases(pd.concat(create_crossing_series(10.0)))["what"])
    similar = [create_rows("a", (0.1, 0.01), 1, 1.0), create_rows("b", (0.1, 0.01), 1.02, 1.0)]
    assert "crossover" not in set(summarize_cases(pd.concat(similar))["what"])


@pytest.mark.parametrize(
    ("costs", "scatter", "as_fast"),
    [
        ({"a": 1.0, "b": 1.09, "c": 1.11}, 0.1, ["b"]),
        ({"a": 1.0, "b": 1.19, "c": 1.21}, None, ["b"]),
        ({"a": 1.0}, None, []),
    ],
)
def test_a_case_is_faster_if_its_median_is_below_the_fastest_run_of_the_other(
    costs, scatter, as_fast
):
    rows = [create_rows(name, (0.09,), 2, cost, scatter) for name, cost in costs.items()]
    fastest = summarize_cases(pd.concat(rows)).iloc[0]
    assert fastest["answer"] == "a(step=0.09)"
    assert fastest["as fast"] == ", ".join(f"{name}(step=0.09)" for name in as_fast)
    assert_allclose(fastest["value"], 1.0 / 0.09)
    extremes = [fastest["min"] * 0.09, fastest["max"] * 0.09]
    assert_allclose(extremes, [1.0 / 1.1, 1.1] if scatter else [np.nan] * 2)


@pytest.mark.slow(reason="half a second and more")
def test_mesh_studies_have_errors_in_space_only(tmp_path):
    from hub_beam import hub_beam

    cases = [
        bd.Case(hub_beam, {"elements": n}, bd.GeneralizedAlpha(step=0.01, newton_tolerance=1e-9))
        for n in (1, 2, 4, 8, 12)
    ]
    columns = ("deformation.u [m]", "deformation.v [m]")
    results = run(bd.Study("mesh", tuple(cases), columns=columns, over="elements"), tmp_path)
    assert len(results.references) == 1
    (reference,) = results.references.values()
    assert reference.methods == ("elements=12", "elements=8")
    orders = results.summary["value"].to_numpy(float)
    # The observed order is five and more (validation/mesh_convergence).
    assert orders[-1] > 4.0
    assert (results.folder / "summary.csv").is_file()


def test_cases_of_mesh_studies_must_set_the_refined_parameter():
    with pytest.raises(
        bd.BeamdaeError, match=r"made: every case must set the parameter 'elements' named by over="
    ):
        create_study([bd.Case(swing, {}, ALPHA)], over="elements")


# Failures -------------------------------------------------------------------------------------


@pytest.mark.slow(reason="half a second")
def test_failures_are_rows_with_a_reason(tmp_path):
    cases = [
        bd.Case(swing, {}, ALPHA),
        bd.Case(singular_torque, {"limit": 0.2}, ALPHA),
        bd.Case(swing, {}, bd.Ida(1e-9, formulation="index3", error_control="all", max_steps=300)),
        bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-6, time_limit=0.01)),
    ]
    results = run(create_study(cases), tmp_path)
    assert results.table["status"][0] == "ok"
    assert list(results.table["status"][1:]) == ["failed", "failed", "limited"]
    sentences = list(results.table["reason"][1:])
    assert sentences[0].startswith("stopped at t = 0.2 s: the residual is not finite")
    assert "stopped at" in sentences[1]
    assert sentences[2].endswith("reached the time limit of 0.01 s")
    assert results.table["reached [s]"][1] == pytest.approx(0.2)
    # Its reference fails as well.
    assert "no reference" in results.references["singular_torque(limit=0.2)"].sentence
    assert np.isnan(results.table["error [-]"][1])
    assert results.failed


@pytest.mark.slow(reason="half a second")
def test_exceptions_of_a_model_end_its_own_case_only(tmp_path):
    cases = [bd.Case(swing, {}, ALPHA), bd.Case(zero_division, {}, ALPHA)]
    table = run(create_study(cases), tmp_path).table
    assert table["status"][0] == "ok"
    # The message of CPython 3.14 lacks the word float.
    assert re.fullmatch("ZeroDivisionError: (float )?division by zero", table["reason"][1])


@pytest.mark.slow(reason="runs up to their limits")
@pytest.mark.parametrize(
    ("executor", "limits", "words"),
    [
        # The limit applies to the whole process, so not to this one.
        (LocalPool(1), Limits(memory=1e-3), "reached the memory limit of 0.001 GB"),
        (SerialPool(), Limits(patience=1e-9), "no progress for 1e-09 s"),
        (SerialPool(), Limits(time=1e-3), "reached the time limit of 0.001 s"),
    ],
    ids=["memory", "patience", "time"],
)
def test_cases_that_reach_a_limit_are_rows_with_a_reason(tmp_path, executor, limits, words):
    # 256 of these steps advance less than a hundred-thousandth of the run.
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-8))]
    table = run(create_study(cases, t_end=0.4, limits=limits), tmp_path, executor).table
    assert table["status"][0] == "limited"
    assert table["reason"][0].endswith(words)


@pytest.mark.slow(reason="processes die and are started again")
def test_cases_of_killed_workers_are_repeated_and_others_are_not_lost(tmp_path):
    marker = tmp_path / "marks"
    once = bd.Case(self_killing, {"marker": str(marker), "tries": 1}, ALPHA)
    always = bd.Case(self_killing, {"marker": str(tmp_path / "more"), "tries": 99}, ALPHA)
    study = create_study([*SWINGS[:2], once, always], t_end=0.1)
    results = run(study, tmp_path / "out", LocalPool(2))
    assert list(results.table["status"][:2]) == ["ok", "ok"]
    assert results.table["reason"][3].startswith("the process died 2 times")
    # One run of `once` was killed, perhaps its reference, and repeated.
    assert results.table["status"][2] == "ok"
    assert marker.read_text() == "x"
    again = Store(results.folder).load(results.study.task(always))
    assert again == (None, ""), "it runs again when the study is resumed"


# Resumption -------------------------------------------------------------------------------


@pytest.mark.slow(reason="a fifth of a second")
def test_stored_cases_are_not_repeated(swings):
    progress = []
    again = run(swings.study, swings.folder, progress=progress.append)
    assert [p.stored for p in progress] == [progress[0].total]
    pd.testing.assert_frame_equal(again.table, swings.table, check_dtype=False)


@pytest.mark.slow(reason="a fifth of a second")
def test_only_changed_cases_are_run(swings):
    progress = []
    case = replace(SWINGS[0], integrator=bd.GeneralizedAlpha(step=0.004))
    run(replace(swings.study, cases=(*SWINGS, case)), swings.folder, progress=progress.append)
    assert progress[-1].total == progress[0].stored + 1


def test_fingerprints_depend_on_model_parameters_integrator_and_times():
    case = SWINGS[0]
    base = case.fingerprint(0.4, 0.001)
    assert base == bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.02)).fingerprint(
        0.4, 0.001
    )
    others = [
        replace(case, parameters={"mass": 1.5}).fingerprint(0.4, 0.001),
        replace(case, integrator=ALPHA).fingerprint(0.4, 0.001),
        replace(case, model=singular_torque, parameters={}).fingerprint(0.4, 0.001),
        case.fingerprint(0.3, 0.001),
        case.fingerprint(0.4, 0.002),
    ]
    assert len({base, *others}) == 6


def test_regression_fingerprints_depend_on_the_code_of_integrators():
    """A study returned the results of another integrator of the same name."""

    def derive(base):
        return dataclass(frozen=True)(type("Mine", (base,), {"__module__": base.__module__}))

    integrators = derive(bd.Radau)(), derive(bd.Ida)()
    fingerprints = {bd.Case(swing, {}, x).fingerprint(0.4, 0.001) for x in integrators}
    assert len(fingerprints) == 2


STUDY_FILE = """
import beamdae as bd
from local_numbers import MASS
from local_parts import create_ball

@bd.model(t_end=0.01)
def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(create_ball("ball", MASS))
    mech.observe("ball", ball.point)
    return mech

@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def falls():
    return [bd.Case(falling, {}, bd.Ida(rtol=1e-4))]
"""
PARTS_MODULE = """
from functools import cache, cached_property
import beamdae as bd

@cache
def heavier(mass):
    return 1.0 * mass

class Ball(bd.PointMass):
    @cached_property
    def twice(self):
        return 2.0 * self.mass

def create_ball(name, mass):
    return Ball(name, heavier(mass), at=(0.0, 0.0))
"""


def write_study(folder, mass=1.0, parts=PARTS_MODULE):
    folder.mkdir(exist_ok=True)
    (folder / "falls.py").write_text(STUDY_FILE)
    (folder / "local_numbers.py").write_text(f"MASS = {mass}\n")
    (folder / "local_parts.py").write_text(parts)
    studies = ModelFile(folder / "falls.py").studies
    return studies["falls"]


def test_regression_fingerprints_depend_on_modules_next_to_the_study(tmp_path):
    """Results of the previous modules were returned."""
    first, copy = write_study(tmp_path / "a"), write_study(tmp_path / "b")
    changed = [
        write_study(tmp_path / "c", mass=2.0),
        write_study(tmp_path / "d", parts=PARTS_MODULE.replace("2.0 *", "3.0 *")),
    ]
    keys = [study.task(study.cases[0]).key for study in (first, copy, *changed)]
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "executor",
    [
        pytest.param(SerialPool(), id="serial"),
        pytest.param(LocalPool(1), id="process", marks=pytest.mark.slow(reason="starts a process")),
    ],
)
def test_regression_modules_next_to_a_study_are_sent_to_its_processes(tmp_path, executor):
    """Their classes may contain locks, as cached properties of CPython 3.11 do."""
    results = run(write_study(tmp_path / "a", mass=3.0), tmp_path / "out", executor)
    assert list(results.table["status"]) == ["ok"]
    assert "local_numbers" not in sys.modules
    # Another study may have modules of the same names.
    other = write_study(tmp_path / "b", mass=5.0).cases[0].model()
    assert other.part("ball").mass == 5.0


@pytest.mark.slow(reason="half a second")
def test_damaged_results_are_computed_again(tmp_path):
    study = create_study(SWINGS[:1])
    store, task = Store(tmp_path), study.task(SWINGS[0])
    run(study, tmp_path)
    before, _ = store.load(task)
    assert before.status.success
    lines = store.trajectory_path(task).read_text().splitlines()
    store.trajectory_path(task).write_text("\n".join(lines[:50]))
    assert store.load(task)[0] is None
    for text in ("{", "[]"):
        store.record_path(task).write_text(text)
        assert store.load(task)[0] is None
    again = run(study, tmp_path)
    pd.testing.assert_frame_equal(again.outcome(SWINGS[0]).table, before.table)


@pytest.mark.slow(reason="half a second")
def test_failures_under_other_limits_are_repeated(tmp_path):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=5e-4))]
    first = run(create_study(cases, limits=Limits(time=1e-3)), tmp_path)
    assert first.table["reason"][0].endswith("reached the time limit of 0.001 s")
    second = run(create_study(cases, limits=Limits(time=60.0)), tmp_path)
    assert list(second.table["status"]) == ["ok"]


def create_model(gravity):
    @bd.model(t_end=0.1)
    def falling(mass=1.0):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        mech.add(bd.PointMass("stone", mass, at=(0.0, 0.0)))
        return mech

    return falling


def test_fingerprints_depend_on_closures_and_arrays():
    one, other = (bd.Case(create_model(g), {}, ALPHA).mechanism_fingerprint() for g in (1.0, 10.0))
    assert one != other
    assert one == bd.Case(create_model(1.0), {}, ALPHA).mechanism_fingerprint()

    zeros, changed = np.zeros(2000), np.zeros(2000)
    changed[700] = 1e-12

    @bd.model(t_end=0.1)
    def tabled(values=zeros):
        return swing()

    assert (
        bd.Case(tabled).mechanism_fingerprint()
        != bd.Case(tabled, {"values": changed}).mechanism_fingerprint()
    )


def test_different_models_of_the_same_name_are_refused():
    with pytest.raises(bd.BeamdaeError, match="two different models have the name 'falling'"):
        create_study(
            [bd.Case(create_model(1.0), {}, ALPHA), bd.Case(create_model(10.0), {}, ALPHA)]
        )


@pytest.mark.slow(reason="a fifth of a second")
def test_a_case_that_is_also_a_reference_runs_once_and_has_frames(tmp_path):
    results = run(create_study([bd.Case(swing, {}, COARSE[0])]), tmp_path)
    assert len(results.outcomes) == 3
    assert list(results.frames)


def test_parameters_are_adjacent_columns_and_renamed_on_collision():
    cases = [bd.Case(swing, {"mass": 1.0}), bd.Case(swing, {"torque": 2.0})]
    table = assemble_case_table(
        [tabulate_case(case, "g", Outcome.failed("no"), None) for case in cases]
    )
    assert list(table)[:4] == ["model", "mass", "torque", "group"]
    colliding = replace(swing, parameters={"steps": 3, "shape": [1, 2]})
    (line,) = assemble_case_table(
        [
            tabulate_case(
                bd.Case(colliding, {"steps": 5, "shape": [3, 4]}), "g", Outcome.failed("no"), None
            )
        ]
    ).to_dict("records")
    assert line["parameter steps"] == 5
    assert line["shape"] == "[3, 4]"


@pytest.mark.slow(reason="a command and its processes; an interrupted serial run shows the same")
def test_interrupted_studies_are_resumed(tmp_path, monkeypatch):
    (tmp_path / "file.py").write_text(slow_study(cases=3, seconds=0.2))
    command = ["compare", "file.py", "--out", "out", "--workers", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "beamdae", *command],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Background jobs of a shell ignore interrupts, and their children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    outcomes = tmp_path / "out" / "masses" / "outcomes"
    limit = time.monotonic() + 60.0
    while len(list(outcomes.glob("*.json"))) < 2 and time.monotonic() < limit:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 130, errors
    assert "run the same command again to resume" in errors
    first = pd.read_csv(tmp_path / "out" / "masses" / "cases.csv")
    assert "not run because the study was interrupted" in set(first["reason"])
    stored = len(list(outcomes.glob("*.json")))
    monkeypatch.chdir(tmp_path)
    # Figures take longer than the runs.
    monkeypatch.setattr("beamdae.studies.study_pictures.list_plots", lambda results: {})
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 0, again.stderr
    assert f"{stored} stored before" in again.stderr
    second = pd.read_csv(tmp_path / "out" / "masses" / "cases.csv")
    assert set(second["status"]) == {"ok"}


@pytest.mark.slow(reason="half a second and more")
def test_repetitions_give_the_median_wall_time_and_its_extremes(tmp_path):
    results = run(create_study(SWINGS[:1], repetitions=3), tmp_path)
    (line,) = results.table.to_dict("records")
    assert 0.0 < line["wall time min [s]"] <= line["wall time [s]"] <= line["wall time max [s]"]
    assert {"wall min", "wall max"} <= {x["label"] for x in create_study_page(results)["columns"]}
    assert "wall time min [s]" not in run(create_study(SWINGS[:1]), tmp_path / "once").table
    with pytest.raises(bd.BeamdaeError, match="made: repetitions must be a whole number"):
        create_study(SWINGS[:1], repetitions=0)


# Definitions ----------------------------------------------------------------------------------


def test_a_study_is_a_decorated_function():
    @bd.study(t_end=0.1, time_limit=5.0, columns=["end.x [m]"])
    def two():
        return SWINGS[:2]

    assert two.name == "two"
    assert two.cases == tuple(SWINGS[:2])
    assert two.columns == ("end.x [m]",)
    assert two.task(SWINGS[0]).limits.time == 5.0
    assert two.task(SWINGS[0], reference=True).limits.time == 50.0
    assert two.task(SWINGS[0]).t_end == 0.1


def test_invalid_studies_are_refused():
    with pytest.raises(bd.BeamdaeError, match="made: cases must be a list of at least one Case"):
        create_study([])
    with pytest.raises(bd.BeamdaeError, match=r"two integrators with different .*, got Ida, Ida"):
        bd.Study("made", tuple(SWINGS), references=(bd.Ida(1e-6), bd.Ida(1e-7)))
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        create_study([bd.Case(swing, {"mas": 1.0}, ALPHA)])
    with pytest.raises(bd.BeamdaeError, match="study: time_limit must be positive"):
        bd.study(time_limit=-1.0)


def test_unknown_columns_are_refused_after_the_first_run(tmp_path):
    with pytest.raises(
        bd.BeamdaeError, match=r"made: there is no observed column 'end.z \[m\]'.*did you"
    ):
        run(create_study(SWINGS[:1], columns=("end.z [m]",)), tmp_path)
    assert not (tmp_path / "outcomes").exists()


def test_summaries_of_failed_cases_are_empty():
    rows = [tabulate_case(SWINGS[0], "g", Outcome.failed("it does not build"), REFERENCE_NOT_RUN)]
    table = assemble_case_table(rows)
    assert table["steps"].isna().all()
    assert len(summarize_cases(table)) == 0
    assert len(summarize_mesh_study(table, "mass")) == 0


def test_references_have_frames_for_the_animation(swings):
    assert set(swings.frames) == {case.mechanism_fingerprint() for case in SWINGS}
    frames = swings.frames[SWINGS[0].mechanism_fingerprint()]
    assert json.dumps(frames)
    assert {symbol["name"] for symbol in frames["symbols"]} >= {"bob"}
