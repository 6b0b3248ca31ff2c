"""Faults of studies: damaged files of what was kept."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pandas as pd

from robustness.bench import Bench, Ran, expect, prepared, told

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


def write_study(bench: Bench, more: str = "pass", settings: str = "time_limit=20.0") -> None:
    text = MODEL.replace("# more", more) + STUDY.replace("SETTINGS", settings)
    bench.write("study.py", text)


def done(bench: Bench, *codes: int, limit: float = 100.0) -> Ran:
    return told(bench.run(*RUN, limit=limit), *codes)


def results(bench: Bench) -> Path:
    return bench.folder / "results" / "few"


def cases(bench: Bench) -> pd.DataFrame:
    return pd.read_csv(results(bench) / "cases.csv")


def trajectories(bench: Bench) -> dict[str, str]:
    return {p.name: p.read_text() for p in (results(bench) / "trajectories").glob("*.csv")}


def _finished(bench: Bench) -> None:
    write_study(bench)
    done(bench, 0)


def _mended(bench: Bench, kind: str, damage) -> None:
    """A second start does a damaged run again, says so, and ends as the first one did."""
    prepared(bench, _finished)
    right, table = trajectories(bench), cases(bench)
    path = sorted(results(bench).glob(kind))[0]
    damage(path)
    again = done(bench, 0)
    found = trajectories(bench)
    expect(found == right, "the trajectories are others")
    errors = [c for c in table if c.startswith("error")]
    expect(cases(bench)[errors].equals(table[errors]), "the errors are others")
    expect("again" in again.err or "damaged" in again.err, "not a word of the damage")


def _cut(count: int):
    return lambda path: path.write_bytes(path.read_bytes()[:-count])


def trajectory_cut_by_1(bench: Bench) -> None:
    """A trajectory without its last byte is done again."""
    _mended(bench, "outcomes/*.csv", _cut(1))


def trajectory_cut_by_12(bench: Bench) -> None:
    """A trajectory without its last digits is done again."""
    _mended(bench, "outcomes/*.csv", _cut(12))


def trajectory_cut_by_40(bench: Bench) -> None:
    """A trajectory without some of its last columns is done again."""
    _mended(bench, "outcomes/*.csv", _cut(40))


def trajectory_with_another_digit(bench: Bench) -> None:
    """A trajectory one digit of which changed is done again."""

    def damage(path: Path) -> None:
        text = path.read_text()
        at = text.rindex(".", 0, len(text) // 2) + 1
        path.write_text(text[:at] + str((int(text[at]) + 5) % 10) + text[at + 1 :])

    _mended(bench, "outcomes/*.csv", damage)


def trajectory_missing(bench: Bench) -> None:
    """A run whose rows are gone is done again."""
    _mended(bench, "outcomes/*.csv", lambda path: path.unlink())


def record_of_garbage(bench: Bench) -> None:
    """A record that is no JSON is done again."""
    _mended(bench, "outcomes/*.json", lambda path: path.write_bytes(os.urandom(1000)))


def record_cut(bench: Bench) -> None:
    """Half a record is done again."""
    _mended(bench, "outcomes/*.json", lambda path: path.write_bytes(path.read_bytes()[:100]))


def record_of_a_list(bench: Bench) -> None:
    """A record that is another JSON is done again."""
    _mended(bench, "outcomes/*.json", lambda path: path.write_text("[1, 2]"))


def record_of_nan(bench: Bench) -> None:
    """A record whose values became NaN is done again."""

    def damage(path: Path) -> None:
        record = json.loads(path.read_text())
        outcome = record["outcome"]
        outcome["values"] = {key: float("nan") for key in outcome["values"]}
        path.write_text(json.dumps(record))

    _mended(bench, "outcomes/*.json", damage)


def record_is_a_folder(bench: Bench) -> None:
    """A folder by the name of a record is told in a sentence."""
    prepared(bench, _finished)
    path = sorted(results(bench).glob("outcomes/*.json"))[0]
    path.unlink()
    path.mkdir()
    ran = done(bench, 2)
    expect(path.name in ran.err, f"not a word of the folder: {ran.last}")


FAULTS = (
    trajectory_cut_by_1,
    trajectory_with_another_digit,
    trajectory_missing,
    record_of_garbage,
    record_of_nan,
    record_is_a_folder,
)
# Slow, or much like one of those.
SLOW = (
    trajectory_cut_by_12,
    trajectory_cut_by_40,
    record_cut,
    record_of_a_list,
)
