"""Faults of saved studies: damaged trajectories and records."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pandas as pd

from robustness.faults.bench import Bench, CommandResult, copy_prepared, expect, expect_exit

MODEL = """import os, sys, time
from pathlib import Path

import numpy as np

import beamdae as bd

LENGTH = 1.0


@bd.model(t_end=0.05)
def swing(mass=1.0):
    # more
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (LENGTH, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(LENGTH, 0.0))
    return mech
"""
STUDY = """

@bd.study(SETTINGS)
def few():
    methods = (bd.Ida(1e-4), bd.GeneralizedAlpha(1e-3))
    return [bd.Case(swing, {"mass": mass}, method) for mass in (1.0, 2.0) for method in methods]
"""
RUN = ("compare", "study.py", "--workers", "2")
STUDY_TIME_LIMIT = 100.0  # s


def write_study(bench: Bench, more: str = "pass", settings: str = "time_limit=20.0") -> None:
    text = MODEL.replace("# more", more) + STUDY.replace("SETTINGS", settings)
    bench.write("study.py", text)


def run_few(bench: Bench, *codes: int, time_limit: float = STUDY_TIME_LIMIT) -> CommandResult:
    return expect_exit(bench.run(*RUN, time_limit=time_limit), *codes)


def results_folder(bench: Bench) -> Path:
    return bench.folder / "results" / "few"


def read_cases(bench: Bench) -> pd.DataFrame:
    return pd.read_csv(results_folder(bench) / "cases.csv")


def read_trajectories(bench: Bench) -> dict[str, str]:
    return {p.name: p.read_text() for p in (results_folder(bench) / "trajectories").glob("*.csv")}


def _run_study_once(bench: Bench) -> None:
    write_study(bench)
    run_few(bench, 0)


def _expect_repaired(bench: Bench, kind: str, damage) -> None:
    """Check that a restart repeats a damaged run and reproduces the tables."""
    copy_prepared(bench, _run_study_once)
    right, table = read_trajectories(bench), read_cases(bench)
    path = sorted(results_folder(bench).glob(kind))[0]
    damage(path)
    run_few(bench, 0)
    expect(read_trajectories(bench) == right, "the trajectories differ")
    errors = [c for c in table if c.startswith("error")]
    expect(read_cases(bench)[errors].equals(table[errors]), "the errors differ")


def _truncate(count: int):
    return lambda path: path.write_bytes(path.read_bytes()[:-count])


def trajectory_cut_by_1(bench: Bench) -> None:
    """A run is repeated if its trajectory lacks the last byte."""
    _expect_repaired(bench, "trajectories/*.csv", _truncate(1))


def trajectory_cut_by_12(bench: Bench) -> None:
    """A run is repeated if its trajectory lacks the last digits."""
    _expect_repaired(bench, "trajectories/*.csv", _truncate(12))


def trajectory_cut_by_40(bench: Bench) -> None:
    """A run is repeated if its trajectory lacks some of the last columns."""
    _expect_repaired(bench, "trajectories/*.csv", _truncate(40))


def trajectory_with_another_digit(bench: Bench) -> None:
    """A run is repeated if a digit of its trajectory has changed."""

    def damage(path: Path) -> None:
        text = path.read_text()
        at = text.rindex(".", 0, len(text) // 2) + 1
        path.write_text(text[:at] + str((int(text[at]) + 5) % 10) + text[at + 1 :])

    _expect_repaired(bench, "trajectories/*.csv", damage)


def trajectory_missing(bench: Bench) -> None:
    """A run is repeated if its trajectory is missing."""
    _expect_repaired(bench, "trajectories/*.csv", lambda path: path.unlink())


def record_of_random_bytes(bench: Bench) -> None:
    """A run is repeated if its record is not JSON."""
    _expect_repaired(bench, "outcomes/*.json", lambda path: path.write_bytes(os.urandom(1000)))


def record_cut(bench: Bench) -> None:
    """A run is repeated if its record is truncated."""
    _expect_repaired(
        bench, "outcomes/*.json", lambda path: path.write_bytes(path.read_bytes()[:100])
    )


def record_of_a_list(bench: Bench) -> None:
    """A run is repeated if its record is a different JSON value."""
    _expect_repaired(bench, "outcomes/*.json", lambda path: path.write_text("[1, 2]"))


def record_of_nan(bench: Bench) -> None:
    """A run is repeated if the values of its record are NaN."""

    def damage(path: Path) -> None:
        record = json.loads(path.read_text())
        record["values"] = {key: float("nan") for key in record["values"]}
        path.write_text(json.dumps(record))

    _expect_repaired(bench, "outcomes/*.json", damage)


def record_is_a_folder(bench: Bench) -> None:
    """A folder with the name of a record is reported by name."""
    copy_prepared(bench, _run_study_once)
    path = sorted(results_folder(bench).glob("outcomes/*.json"))[0]
    path.unlink()
    path.mkdir()
    result = run_few(bench, 2)
    expect(path.name in result.err, f"no message about the folder: {result.error_tail}")


FAULTS = (
    trajectory_cut_by_1,
    trajectory_with_another_digit,
    trajectory_missing,
    record_of_random_bytes,
    record_of_nan,
    record_is_a_folder,
)
# Slow, or similar to one of the faults above.
SLOW = (
    trajectory_cut_by_12,
    trajectory_cut_by_40,
    record_cut,
    record_of_a_list,
)
