"""The study engine: parallel, resumable, and honest about what fails."""

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
from beamdae.studies.execution import case_run as work
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool, SerialPool
from beamdae.studies.execution.tasks import Limits, Outcome
from beamdae.studies.references import REFERENCE_NOT_RUN
from beamdae.studies.store.store import Store
from beamdae.studies.study_page import create_study_page

ALPHA = bd.GeneralizedAlpha(step=2e-3)
REFERENCES = (bd.Ida(rtol=1e-7), bd.GeneralizedAlpha(step=5e-4, newton_tolerance=1e-10))
# For tests in which no error is measured.
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
def torn(limit=0.2):
    """The moment leaves the real numbers at t = limit."""
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 2.0, inertia=0.1))
    mech.add(bd.Moment("torque", on=bob.at(0.0, 0.0), law=lambda t: (limit - t) ** 1.5))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


@bd.model(t_end=0.1)
def broken(mass=0.0):
    return 1.0 / mass


@bd.model(t_end=0.1)
def deadly(marker="", tries=1):
    """Kills its process until it has left so many marks in a file."""
    with open(marker, "a+") as file:
        file.seek(0)
        if len(file.read()) < tries:
            file.write("x")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    return swing()


def made(cases, references=COARSE, **settings):
    return bd.Study("made", tuple(cases), references=references, **settings)


def done(study, folder, executor=None, progress=None):
    return study_run.run_study(study, folder, executor or SerialPool(), progress)


STEPS = (0.02, 0.01, 0.005)
SWINGS = [
    bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
    for mass in (1.0, 3.0)
    for h in STEPS
]


@pytest.fixture(scope="module")
def swings(tmp_path_factory):
    return done(made(SWINGS, REFERENCES), tmp_path_factory.mktemp("swings"))


# Executors ------------------------------------------------------------------------------------

# What differs from run to run and from process to process.
UNSTEADY = ["wall time [s]", "setup time [s]", "measuring time [s]", "peak memory [GB]"]


@pytest.mark.slow(reason="starts processes for a whole study")
def test_processes_and_runs_one_after_the_other_give_the_same_table(tmp_path):
    study = made([*SWINGS[:2], bd.Case(torn, {}, ALPHA), bd.Case(broken, {}, ALPHA)])
    executors = {"serial": SerialPool(), "processes": LocalPool(2)}
    results = [done(study, tmp_path / name, pool) for name, pool in executors.items()]
    serial, parallel = (found.table.drop(columns=UNSTEADY) for found in results)
    assert list(serial["status"][:2]) == ["ok", "ok"]
    assert serial["reason"][2].startswith("stopped at t = 0.2 s")
    assert "ZeroDivisionError" in serial["reason"][3]
    pd.testing.assert_frame_equal(parallel, serial)


@bd.model(t_end=0.1)
def telling(file="", name=""):
    """Writes its name and its process to a file."""
    with open(file, "a") as told:
        told.write(f"{name} {os.getpid()}\n")
    return swing()


def test_serial_runs_are_made_here_in_their_order(tmp_path):
    file = tmp_path / "told"
    cases = [bd.Case(telling, {"file": str(file), "name": name}, ALPHA) for name in "abc"]
    study = made(cases)
    found = list(SerialPool().run_tasks([study.task(case) for case in cases]))
    assert [task.case for task, _, _ in found] == cases
    assert [(outcome.status.kind, keep) for _, outcome, keep in found] == [("ok", True)] * 3
    assert file.read_text().splitlines() == [f"{name} {os.getpid()}" for name in "abc"]


@pytest.mark.slow(reason="a study")
def test_an_interrupted_serial_run_ends_the_study_and_is_done_again(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    # Steps enough that progress is told.
    study = made([bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(1e-3)) for mass in (1.0, 2.0)])
    with monkeypatch.context() as patch:
        patch.setattr(work._LimitMonitor, "__call__", interrupt)
        results = done(study, tmp_path)
    assert results.interrupted
    # A reference may take so few steps that no progress is told.
    *before, outcome = results.outcomes.values()
    assert all(one.status.success for one in before)
    assert len(before) < 2
    assert outcome.status.sentence.startswith("interrupted at t = ")
    assert set(results.table["status"]) == {"interrupted"}
    assert set(done(study, tmp_path).table["status"]) == {"ok"}


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
    # A pendulum of one body: what is left of g is rounding, and the books close to h^2.
    assert (table["max position drift"] < 1e-9).all()


def test_errors_are_measured_against_what_two_methods_agree_on(swings):
    for group, reference in swings.references.items():
        assert reference.methods == (
            "Ida(rtol=1e-07)",
            "GeneralizedAlpha(step=0.00025, newton_tolerance=1e-10), extrapolated",
        )
        rows = swings.table[swings.table["group"] == group]
        errors = rows["error [-]"].to_numpy()
        # Order 2, and well above what the reference resolves.
        assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.1)
        assert errors.min() > reference.resolution
        assert (rows["reference uncertainty [-]"] == reference.uncertainty).all()


def test_errors_the_reference_cannot_resolve_are_marked(tmp_path):
    cases = [bd.Case(swing, {}, method) for method in (bd.GeneralizedAlpha(0.02), bd.Radau(1e-9))]
    table = done(made(cases, REFERENCES), tmp_path).table
    assert list(table["below resolution"]) == [False, True]


def test_summary_has_orders_the_fastest_and_crossovers(swings):
    found = pd.read_csv(swings.folder / "summary.csv")
    orders = found[found["what"] == "order in step"]
    assert_allclose(orders["value"], 2.0, atol=0.1)
    best = found[(found["what"] == "fastest") & (found["at"] == "error <= 1e-02")]
    assert set(best["answer"]) <= {case.label for case in SWINGS}


def timed_rows(series, step, order, cost, scatter=None):
    """Rows with error = step^order and cost proportional to 1 / step."""
    rows = pd.DataFrame({"step": step})
    rows = rows.assign(
        **{"group": "g", "status": "ok", "series": series, "rtol": np.nan},
        **{"error [-]": rows["step"] ** order, "wall time [s]": cost / rows["step"]},
        **{"below resolution": False, "reference uncertainty [-]": 0.0},
        label=[f"{series}(step={h:g})" for h in step],
    )
    if scatter is None:
        return rows
    ends = {"min": 1.0 / (1.0 + scatter), "max": 1.0 + scatter}
    more = {f"wall time {name} [s]": f * rows["wall time [s]"] for name, f in ends.items()}
    return rows.assign(**more)


def crossing(scatter=None):
    return [
        timed_rows("coarse", (0.1, 0.01, 0.001), 1, 1e-4, scatter),
        timed_rows("fine", (0.5, 0.1, 0.03), 3, 1e-3, scatter),
    ]


@pytest.mark.parametrize("scatter", [None, 0.1, 1.0])
def test_crossover_is_where_another_series_becomes_the_fastest(scatter):
    found = summarize_cases(pd.concat(crossing(scatter))).set_index("what")
    # 1e-4 / e = 1e-3 / e^(1/3): e = 10^-1.5.
    assert_allclose(found.loc["crossover", "value"], 10.0**-1.5, rtol=0.05)
    assert found.loc["crossover", "answer"] == "fine"
    assert_allclose(found.loc["order in step", "value"].astype(float), [1.0, 3.0], atol=1e-6)


def test_no_series_overtakes_where_it_may_be_chance():
    """At no error they have in common is one faster than the other by more than a factor of ten."""
    assert "crossover" not in set(summarize_cases(pd.concat(crossing(10.0)))["what"])
    same = [timed_rows("a", (0.1, 0.01), 1, 1.0), timed_rows("b", (0.1, 0.01), 1.02, 1.0)]
    assert "crossover" not in set(summarize_cases(pd.concat(same))["what"])


@pytest.mark.parametrize(
    ("costs", "scatter", "as_fast"),
    [
        ({"a": 1.0, "b": 1.09, "c": 1.11}, 0.1, ["b"]),
        ({"a": 1.0, "b": 1.19, "c": 1.21}, None, ["b"]),
        ({"a": 1.0}, None, []),
    ],
)
def test_one_is_faster_if_its_median_is_less_than_the_fastest_run_of_the_other(
    costs, scatter, as_fast
):
    rows = [timed_rows(name, (0.09,), 2, cost, scatter) for name, cost in costs.items()]
    best = summarize_cases(pd.concat(rows)).iloc[0]
    assert best["answer"] == "a(step=0.09)"
    assert best["as fast"] == ", ".join(f"{name}(step=0.09)" for name in as_fast)
    assert_allclose(best["value"], 1.0 / 0.09)
    found = [best["min"] * 0.09, best["max"] * 0.09]
    assert_allclose(found, [1.0 / 1.1, 1.1] if scatter else [np.nan] * 2)


@pytest.mark.slow(reason="half a second and more")
def test_a_study_of_meshes_has_errors_in_space_alone(tmp_path):
    from hub_beam import hub_beam

    cases = [
        bd.Case(hub_beam, {"elements": n}, bd.GeneralizedAlpha(step=0.01, newton_tolerance=1e-9))
        for n in (1, 2, 4, 8, 12)
    ]
    columns = ("deformation.u [m]", "deformation.v [m]")
    results = done(bd.Study("mesh", tuple(cases), columns=columns, over="elements"), tmp_path)
    assert len(results.references) == 1
    (reference,) = results.references.values()
    assert reference.methods == ("elements=12", "elements=8")
    orders = results.summary["value"].to_numpy(float)
    # Elements of order five and more (validation/mesh_convergence).
    assert orders[-1] > 4.0
    assert (results.folder / "summary.csv").is_file()


def test_a_mesh_study_needs_its_parameter_in_every_case():
    with pytest.raises(
        bd.BeamdaeError, match=r"made: every case must set the parameter 'elements' of over="
    ):
        made([bd.Case(swing, {}, ALPHA)], over="elements")


# Failures -------------------------------------------------------------------------------------


def test_failures_are_rows_with_a_sentence(tmp_path):
    cases = [
        bd.Case(swing, {}, ALPHA),
        bd.Case(torn, {"limit": 0.2}, ALPHA),
        bd.Case(swing, {}, bd.Ida(1e-9, formulation="index3", error_control="all", max_steps=300)),
        bd.Case(swing, {}, bd.GeneralizedAlpha(step=1e-6, time_limit=0.01)),
    ]
    results = done(made(cases), tmp_path)
    assert results.table["status"][0] == "ok"
    assert list(results.table["status"][1:]) == ["failed", "failed", "limited"]
    sentences = list(results.table["reason"][1:])
    assert sentences[0].startswith("stopped at t = 0.2 s: the residual is not finite")
    assert "stopped at" in sentences[1]
    assert sentences[2].startswith("time limit of 0.01 s, stopped at")
    assert results.table["reached [s]"][1] == pytest.approx(0.2)
    # The torn one has no reference either, and says so.
    assert "no reference" in results.references["torn(limit=0.2)"].sentence
    assert np.isnan(results.table["error [-]"][1])
    assert results.failed


def test_whatever_a_model_raises_ends_its_case_alone(tmp_path):
    cases = [bd.Case(swing, {}, ALPHA), bd.Case(broken, {}, ALPHA)]
    table = done(made(cases), tmp_path).table
    assert table["status"][0] == "ok"
    # CPython 3.14 says it without the word float.
    assert re.fullmatch("ZeroDivisionError: (float )?division by zero", table["reason"][1])


@pytest.mark.slow(reason="runs up to their limits")
@pytest.mark.parametrize(
    ("executor", "limits", "words"),
    [
        # The memory is that of the process, so it has one of its own.
        (LocalPool(1), Limits(memory=1e-3), "memory limit of 0.001 GB, stopped at"),
        (SerialPool(), Limits(patience=1e-9), "no progress for 1e-09 s, stopped at"),
        (SerialPool(), Limits(time=1e-3), "time limit of 0.001 s, stopped at"),
    ],
    ids=["memory", "patience", "time"],
)
def test_a_case_that_hits_a_limit_is_a_row_saying_so(tmp_path, executor, limits, words):
    # So small a step that 64 of them do not move by a hundred-thousandth of the run.
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=5e-8))]
    table = done(made(cases, t_end=0.4, limits=limits), tmp_path, executor).table
    assert table["status"][0] == "limited"
    assert table["reason"][0].startswith(words)


@pytest.mark.slow(reason="processes die and are started again")
def test_a_killed_worker_is_tried_again_and_takes_no_other_case(tmp_path):
    marker = tmp_path / "marks"
    once = bd.Case(deadly, {"marker": str(marker), "tries": 1}, ALPHA)
    always = bd.Case(deadly, {"marker": str(tmp_path / "more"), "tries": 99}, ALPHA)
    study = made([*SWINGS[:2], once, always], t_end=0.1)
    results = done(study, tmp_path / "out", LocalPool(2))
    assert list(results.table["status"][:2]) == ["ok", "ok"]
    assert results.table["reason"][3].startswith("its process died 2 times")
    # The reference of `once` met the marker first; one of the runs died, none was lost.
    assert results.table["status"][2] == "ok"
    assert marker.read_text() == "x"
    again = Store(results.folder).load(results.study.task(always))
    assert again == (None, ""), "tried again at the next start"


# Starting again -------------------------------------------------------------------------------


def test_finished_cases_are_not_done_again(swings):
    seen = []
    again = done(swings.study, swings.folder, progress=seen.append)
    assert [p.stored for p in seen] == [seen[0].total]
    pd.testing.assert_frame_equal(again.table, swings.table, check_dtype=False)


def test_a_changed_case_is_done_and_the_others_are_kept(swings):
    seen = []
    case = replace(SWINGS[0], integrator=bd.GeneralizedAlpha(step=0.004))
    done(replace(swings.study, cases=(*SWINGS, case)), swings.folder, progress=seen.append)
    assert seen[-1].total == seen[0].stored + 1


def test_fingerprint_depends_on_all_that_matters():
    case = SWINGS[0]
    base = case.fingerprint(0.4, 0.001)
    assert base == bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.02)).fingerprint(
        0.4, 0.001
    )
    others = [
        replace(case, parameters={"mass": 1.5}).fingerprint(0.4, 0.001),
        replace(case, integrator=ALPHA).fingerprint(0.4, 0.001),
        replace(case, model=torn, parameters={}).fingerprint(0.4, 0.001),
        case.fingerprint(0.3, 0.001),
        case.fingerprint(0.4, 0.002),
    ]
    assert len({base, *others}) == 6


def test_regression_integrators_of_one_name_are_told_apart():
    """By their code: a study gave the results of the one that was there before."""

    def made_like(base):
        return dataclass(frozen=True)(type("Mine", (base,), {"__module__": base.__module__}))

    one, other = made_like(bd.Radau)(), made_like(bd.Ida)()
    found = {bd.Case(swing, {}, mine).fingerprint(0.4, 0.001) for mine in (one, other)}
    assert len(found) == 2


BESIDE = """
import beamdae as bd
from numbers_of_mine import MASS
from parts_of_mine import weighed

@bd.model(t_end=0.01)
def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(weighed("ball", MASS))
    mech.observe("ball", ball.point)
    return mech

@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def falls():
    return [bd.Case(falling, {}, bd.Ida(rtol=1e-4))]
"""
PARTS = """
from functools import cache, cached_property
import beamdae as bd

@cache
def heavier(mass):
    return 1.0 * mass

class Ball(bd.PointMass):
    @cached_property
    def twice(self):
        return 2.0 * self.mass

def weighed(name, mass):
    return Ball(name, heavier(mass), at=(0.0, 0.0))
"""


def beside(folder, mass=1.0, parts=PARTS):
    folder.mkdir(exist_ok=True)
    (folder / "falls.py").write_text(BESIDE)
    (folder / "numbers_of_mine.py").write_text(f"MASS = {mass}\n")
    (folder / "parts_of_mine.py").write_text(parts)
    studies = ModelFile(folder / "falls.py").studies
    return studies["falls"]


def test_regression_a_study_follows_numbers_and_modules_beside_its_file(tmp_path):
    """It gave the results of what they were before."""
    first, kept = beside(tmp_path / "a"), beside(tmp_path / "b")
    changed = [
        beside(tmp_path / "c", mass=2.0),
        beside(tmp_path / "d", parts=PARTS.replace("2.0 *", "3.0 *")),
    ]
    keys = [study.task(study.cases[0]).key for study in (first, kept, *changed)]
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


@pytest.mark.parametrize(
    "executor",
    [
        pytest.param(SerialPool(), id="serial"),
        pytest.param(LocalPool(1), id="process", marks=pytest.mark.slow(reason="starts a process")),
    ],
)
def test_regression_modules_beside_a_file_go_with_it_to_a_process(tmp_path, executor):
    """With all their classes hold, locks of CPython's 3.11 included; and none of them stays."""
    results = done(beside(tmp_path / "a", mass=3.0), tmp_path / "out", executor)
    assert list(results.table["status"]) == ["ok"]
    assert "numbers_of_mine" not in sys.modules
    # Another file has others of the same names.
    other = beside(tmp_path / "b", mass=5.0).cases[0].model()
    assert other.part("ball").mass == 5.0


def test_damaged_results_are_computed_again(tmp_path):
    study = made(SWINGS[:1])
    store, task = Store(tmp_path), study.task(SWINGS[0])
    done(study, tmp_path)
    known, _ = store.load(task)
    assert known.status.success
    lines = store.trajectory_path(task).read_text().splitlines()
    store.trajectory_path(task).write_text("\n".join(lines[:50]))
    assert store.load(task)[0] is None
    for text in ("{", "[]"):
        store.record_path(task).write_text(text)
        assert store.load(task)[0] is None
    again = done(study, tmp_path)
    pd.testing.assert_frame_equal(again.outcome(SWINGS[0]).table, known.table)


def test_a_failure_under_other_limits_is_tried_again(tmp_path):
    cases = [bd.Case(swing, {}, bd.GeneralizedAlpha(step=5e-4))]
    first = done(made(cases, limits=Limits(time=1e-3)), tmp_path)
    assert first.table["reason"][0].startswith("time limit")
    second = done(made(cases, limits=Limits(time=60.0)), tmp_path)
    assert list(second.table["status"]) == ["ok"]


def factory(gravity):
    @bd.model(t_end=0.1)
    def falling(mass=1.0):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        mech.add(bd.PointMass("stone", mass, at=(0.0, 0.0)))
        return mech

    return falling


def test_what_a_model_is_closed_over_and_arrays_are_part_of_the_fingerprint():
    one, other = (bd.Case(factory(g), {}, ALPHA).mechanism_fingerprint() for g in (1.0, 10.0))
    assert one != other
    assert one == bd.Case(factory(1.0), {}, ALPHA).mechanism_fingerprint()

    zeros, changed = np.zeros(2000), np.zeros(2000)
    changed[700] = 1e-12

    @bd.model(t_end=0.1)
    def tabled(values=zeros):
        return swing()

    assert (
        bd.Case(tabled).mechanism_fingerprint()
        != bd.Case(tabled, {"values": changed}).mechanism_fingerprint()
    )


def test_two_models_of_one_name_are_refused():
    with pytest.raises(bd.BeamdaeError, match="two different models are called 'falling'"):
        made([bd.Case(factory(1.0), {}, ALPHA), bd.Case(factory(10.0), {}, ALPHA)])


def test_a_case_that_is_a_reference_as_well_is_run_once_and_animated(tmp_path):
    results = done(made([bd.Case(swing, {}, COARSE[0])]), tmp_path)
    assert len(results.outcomes) == 3
    assert list(results.frames)


def test_parameters_stand_together_and_give_way_to_columns():
    cases = [bd.Case(swing, {"mass": 1.0}), bd.Case(swing, {"torque": 2.0})]
    table = assemble_case_table(
        [tabulate_case(case, "g", Outcome.failed("no"), None) for case in cases]
    )
    assert list(table)[:4] == ["model", "mass", "torque", "group"]
    tricky = replace(swing, parameters={"steps": 3, "shape": [1, 2]})
    (line,) = assemble_case_table(
        [
            tabulate_case(
                bd.Case(tricky, {"steps": 5, "shape": [3, 4]}), "g", Outcome.failed("no"), None
            )
        ]
    ).to_dict("records")
    assert line["parameter steps"] == 5
    assert line["shape"] == "[3, 4]"


@pytest.mark.slow(reason="a command and its processes; an interrupted serial run shows the same")
def test_interrupt_keeps_what_is_done_and_a_second_start_goes_on(tmp_path, monkeypatch):
    (tmp_path / "file.py").write_text(slow_study(cases=3, seconds=0.2))
    command = ["compare", "file.py", "--out", "out", "--workers", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "beamdae", *command],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background jobs ignore the interrupt, and so would what they start.
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
    assert "not run, the study was interrupted" in set(first["reason"])
    kept = len(list(outcomes.glob("*.json")))
    monkeypatch.chdir(tmp_path)
    # Pictures take longer than the runs.
    monkeypatch.setattr("beamdae.studies.study_pictures.list_plots", lambda results: {})
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 0, again.stderr
    assert f"{kept} stored before" in again.stderr
    second = pd.read_csv(tmp_path / "out" / "masses" / "cases.csv")
    assert set(second["status"]) == {"ok"}


def test_repetitions_give_the_median_wall_time_and_its_ends(tmp_path):
    results = done(made(SWINGS[:1], repetitions=3), tmp_path)
    (line,) = results.table.to_dict("records")
    names = ("wall time min [s]", "wall time [s]", "wall time max [s]")
    assert 0.0 < line[names[0]] <= line[names[1]] <= line[names[2]]
    assert {"wall min", "wall max"} <= {x["label"] for x in create_study_page(results)["columns"]}
    assert "wall time min [s]" not in done(made(SWINGS[:1]), tmp_path / "once").table
    with pytest.raises(bd.BeamdaeError, match="made: repetitions must be a whole number"):
        made(SWINGS[:1], repetitions=0)


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


def test_wrong_studies_are_refused():
    with pytest.raises(bd.BeamdaeError, match="made: cases must be a list of at least one Case"):
        made([])
    with pytest.raises(bd.BeamdaeError, match=r"two integrators with different .*, got Ida, Ida"):
        bd.Study("made", tuple(SWINGS), references=(bd.Ida(1e-6), bd.Ida(1e-7)))
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        made([bd.Case(swing, {"mas": 1.0}, ALPHA)])
    with pytest.raises(bd.BeamdaeError, match="study: time_limit must be positive"):
        bd.study(time_limit=-1.0)


def test_columns_are_checked_before_the_work_is_done(tmp_path):
    with pytest.raises(bd.BeamdaeError, match=r"made: no observed column 'end.z \[m\]'.*did you"):
        done(made(SWINGS[:1], columns=("end.z [m]",)), tmp_path)
    assert not (tmp_path / "outcomes").exists()


def test_outcomes_of_nothing():
    lines = [tabulate_case(SWINGS[0], "g", Outcome.failed("it does not build"), REFERENCE_NOT_RUN)]
    table = assemble_case_table(lines)
    assert table["steps"].isna().all()
    assert len(summarize_cases(table)) == 0
    assert len(summarize_mesh_study(table, "mass")) == 0


def test_frames_of_the_reference_are_kept_for_the_animation(swings):
    keys = {case.mechanism_fingerprint() for case in SWINGS}
    assert set(swings.frames) == keys
    frames = swings.frames[SWINGS[0].mechanism_fingerprint()]
    assert json.dumps(frames)
    assert {symbol["name"] for symbol in frames["symbols"]} >= {"bob"}
