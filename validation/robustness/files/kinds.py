"""Kinds of result files: a valid example, its mutation, and uses whose answers are checked.

Each use returns an empty text if the answers are consistent with the content of the file, and a
complaint otherwise. It raises BeamdaeError only while the file is read.
"""

from __future__ import annotations

import copy
import hashlib
import json
import random
import shutil
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

import beamdae as bd
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError
from beamdae.report.page.page_file import write_page
from beamdae.report.run_page import build_run_page
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.continued_runs import RunParts
from beamdae.simulation import as_equations
from beamdae.studies.execution.executors import SerialPool
from beamdae.studies.execution.study_run import run_study
from beamdae.studies.study_page import create_study_page
from robustness.files import mutations

_T_END = 0.4  # s
_LATER = 0.5  # s, end of resumed runs
_METHOD = bd.Radau(1e-4)
_MAX_RELATIVE_DIFFERENCE = 2e-3  # of coordinates in both ways of loading a run


@bd.model(t_end=_T_END)
def caught(gravity: float = 9.81) -> bd.Mechanism:
    """Return a falling ball that an event catches, and a pendulum with a requested start."""
    mech = bd.Mechanism(gravity=(0.0, -gravity), start={"bob.angle": 0.3})
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(3.0, 0.3)))
    mech.add(bd.Force("push", ball.point, (0.0, lambda t: 0.2 * t)))
    hold = mech.add(bd.Revolute("hold", mech.ground.at(3.0, 0.3), ball.point))
    mech.deactivate(hold)
    mech.observe("ball", ball.point)
    mech.observe("bob", bob.at(1.0, 0.0))
    mech.when("ball.y", 0.1, "down", do=bd.activate(hold, as_is=True), name="caught")
    return mech


@cache
def _solution() -> bd.results.Solution:
    return bd.simulate(caught, _METHOD, output_step=0.02)


@cache
def _equations() -> EquationsOfMotion:
    """Return the equations of `caught`, assembled once for all files."""
    return as_equations("robustness", caught)


class InconsistentError(Exception):
    """Raised if answers differ from the content of a file, or an error is raised too late."""


def _expect(condition: Any, complaint: str) -> None:
    if not condition:
        raise InconsistentError(complaint)


def _use(function: Callable[[], Any], name: str) -> Any:
    """Return the result of a use of loaded data, which must not raise."""
    try:
        return function()
    except Exception as error:
        raise InconsistentError(f"{type(error).__name__} at {name}: {error}") from error


# Checkpoints ---------------------------------------------------------------------------------


@cache
def _checkpoint_content() -> dict[str, Any]:
    path = Path(mkdtemp()) / "end.json"
    return json.loads(_solution().checkpoint(path).read_text())


def write_checkpoint(folder: Path, change: str, rng: random.Random) -> Path:
    content = copy.deepcopy(_checkpoint_content())
    content.pop("checksum")
    if change in mutations.JSON_MUTATIONS:
        mutations.JSON_MUTATIONS[change](content, rng)
    content["checksum"] = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    text = json.dumps(content)
    path = folder / "end.json"
    path.write_text(mutations.duplicate_key(text, rng) if change == "duplicates" else text)
    return path


def use_checkpoint(path: Path) -> None:
    later = bd.simulate(caught, _METHOD, _LATER, output_step=0.05, start=path, accept_changes=True)
    content = json.loads(path.read_text())
    _expect(later.t[0] == content["t"], "the run does not begin at the time of the checkpoint")
    if later.status.success:
        finite = all(np.isfinite(x).all() for x in later.columns.values())
        _expect(finite, "a successful run with columns that are not finite")
    if not content["found"] and not content["inactive"]:
        return
    # Coordinates of the ball, which only the frozen joint holds.
    names = later.equations.q_names
    for k, name in enumerate(names):
        if name.startswith("ball") and "hold" in content["inactive"]:
            value = content["states"][name][0]
            _expect(
                abs(later.q[0, k] - value) <= 1e-6 * max(1.0, abs(value)),
                f"{name} differs from the checkpoint",
            )


# Saved runs ----------------------------------------------------------------------------------


@cache
def _run_content() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    path = _solution().save(Path(mkdtemp()) / "a.run")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return json.loads(arrays.pop("told").tobytes()), arrays


def _checksum_of_run(content: dict[str, Any], arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256(json.dumps(content).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_run(folder: Path, change: str, rng: random.Random) -> Path:
    content, arrays = copy.deepcopy(_run_content())
    has_checksum = content.pop("checksum", None) is not None
    name = rng.choice(sorted(arrays))
    if change in mutations.JSON_MUTATIONS:
        mutations.JSON_MUTATIONS[change](content, rng)
    elif change == "arrays":
        arrays[name] = mutations.change_array(arrays[name], rng)
    elif change == "shapes":
        arrays[name] = mutations.reshape_array(arrays[name], rng)
    elif change == "members":
        other = rng.choice(sorted(arrays))
        kind = rng.randrange(3)
        if kind == 0:
            del arrays[name]
        elif kind == 1:
            arrays[f"{name}2"] = arrays[name]
        else:
            arrays[name], arrays[other] = arrays[other], arrays[name]
    if has_checksum:
        content["checksum"] = _checksum_of_run(content, arrays)
    text = json.dumps(content)
    if change == "duplicates":
        text = mutations.duplicate_key(text, rng)
    path = folder / "a.run"
    with open(path, "wb") as file:
        np.savez_compressed(file, **arrays, told=np.frombuffer(text.encode(), np.uint8))
    return path


def use_run(path: Path) -> None:
    saved = bd.load(path)
    _use(lambda: _check_saved_run(saved, path), "the saved run")
    loaded = bd.load(path, _equations())
    _use(lambda: _check_solution(loaded, saved, path), "the solution")


def _check_saved_run(saved: Any, path: Path) -> None:
    columns, coordinates = saved.all_columns(), saved.coordinates()
    lengths = {len(x) for x in columns.values()} | {len(coordinates)}
    _expect(lengths == {len(saved.times)}, "columns of different lengths")
    _expect((np.diff(saved.times) > 0.0).all(), "times do not ascend")
    summary, metadata = saved.summary(), saved.metadata()
    _expect(summary["status"] == saved.status.kind == metadata["status"], "two statuses")
    _expect(summary["success"] == saved.status.success, "two statuses")
    _expect(summary["last_time"] >= saved.times[-1] * (1.0 - 1e-9), "rows after the last time")
    _expect(all(isinstance(x, str) for x in (*saved.warnings, saved.label)), "no texts")
    json.dumps(metadata)
    saved.table()
    _expect(len(saved["ball.y"]) == len(saved.times), "a column of another length")
    _expect(str(saved) and repr(saved), "no text")
    saved.to_csv(path.with_name("table.csv"))
    saved.at_times(saved.times[:1])


def _check_solution(loaded: Any, saved: Any, path: Path) -> None:
    observed, coordinates = loaded.observed, loaded.coordinates()
    _expect(len(observed) == len(saved.times), "other rows with the model")
    other = saved.coordinates()
    _expect(list(other) == list(coordinates), "other coordinates with the model")
    half = 1 + 2 * loaded.equations.n
    for name in list(other)[:half]:
        scale = np.max(np.abs(coordinates[name])) or 1.0
        difference = np.max(np.abs(coordinates[name] - other[name]))
        _expect(difference <= _MAX_RELATIVE_DIFFERENCE * scale, f"two values of {name}")
    _expect(loaded.status == saved.status, "two statuses")
    _expect(loaded.summary()["last_time"] == saved.summary()["last_time"], "two last times")
    for name in (
        "quality",
        "warnings",
        "events",
        "energies",
        "drift",
        "start",
        "label",
    ):
        getattr(loaded, name)
    _expect(isinstance(repr(loaded), str), "no text")
    loaded.at(0.5 * (loaded.trajectory.start + loaded.trajectory.end))
    loaded.to_csv(path.with_name("table.csv"))
    bd.load(loaded.save(path.with_name("again.run")))
    write_page(path.with_name("page.html"), build_run_page(loaded, "run"))
    if loaded.trajectory.end < _LATER:
        with suppress(BeamdaeError):  # The state may be unsuitable as a start.
            bd.simulate(_equations(), _METHOD, _LATER, start=loaded, accept_changes=True)


# Records of studies --------------------------------------------------------------------------


@bd.model(t_end=0.1)
def swing(mass: float = 2.0) -> bd.Mechanism:
    """Return a pendulum."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


@cache
def _study() -> bd.Study:
    case = bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.01))
    references = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))
    return bd.Study("made", (case,), references=references, t_end=0.1, output_step=0.005)


@cache
def _study_folder() -> tuple[Path, Any]:
    folder = Path(mkdtemp())
    results = run_study(_study(), folder, SerialPool())
    return folder, results


def write_record(folder: Path, change: str, rng: random.Random) -> Path:
    original, _ = _study_folder()
    shutil.copytree(original, folder, dirs_exist_ok=True)
    paths = sorted((folder / "outcomes").glob("*.json"))
    path = rng.choice(paths)
    # Only one of them has frames, which are the largest part of a record.
    path = (
        next(x for x in paths if '"frames": null' not in x.read_text())
        if rng.random() < 0.5
        else path
    )
    record = json.loads(path.read_text())
    content, rows = record["outcome"], path.with_suffix(".csv")
    if change in mutations.JSON_MUTATIONS:
        mutations.JSON_MUTATIONS[change](content, rng)
    elif change == "tables":
        text = mutations.change_csv(rows.read_text(), rng)
        rows.unlink()
        rows.write_text(text)
        content["rows"]["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    record = record | {
        "sha256": hashlib.sha256(canonical.encode()).hexdigest(),
        "outcome": content,
    }
    text = json.dumps(record)
    path.write_text(mutations.duplicate_key(text, rng) if change == "duplicates" else text)
    return path


def use_record(path: Path) -> None:
    folder = path.parents[1]
    _, before = _study_folder()
    study = _study()
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        results = run_study(study, folder, SerialPool())
    write_page(folder / "page.html", create_study_page(results))
    tables = {key: outcome.table for key, outcome in results.outcomes.items()}
    if results.notes or set(tables) != set(before.outcomes):
        # The case was run again.
        errors = [c for c in before.table if c.startswith("error of") or c == "error [-]"]
        _expect(results.table[errors].equals(before.table[errors]), "other errors")
        raise BeamdaeError(results.notes[0] if results.notes else f"{path}: not used.")
    content = json.loads(path.read_text())["outcome"]
    outcome = results.outcomes[path.stem]
    _expect(outcome.status.kind == content["status"]["kind"], "another status")
    _expect(outcome.status.sentence == content["status"]["sentence"], "another reason")
    times = outcome.table.index
    _expect((np.diff(times) > 0.0).all() and np.isfinite(times).all(), "times do not ascend")
    reached = outcome.values.get("reached [s]")
    if reached is not None and outcome.status.success:
        _expect(abs(times[-1] - reached) <= 1e-6 * reached, "the table does not reach the end")
    rows = results.table
    _expect(set(rows["status"]) <= {"ok", "failed", "limited", "interrupted"}, "another status")
    _expect(str(rows) and (folder / "cases.csv").read_text(), "no table")


# Tables of continued runs --------------------------------------------------------------------


@cache
def _parts_folder() -> tuple[Path, Checkpoint, bd.results.Solution]:
    folder = Path(mkdtemp())
    _solution().to_csv(folder / "run.csv")
    checkpoint = Checkpoint.of(_solution())
    later = bd.simulate(caught, _METHOD, _LATER, output_step=0.02, start=_solution())
    return folder, checkpoint, later


def write_parts(folder: Path, change: str, rng: random.Random) -> Path:
    original, _, _ = _parts_folder()
    shutil.copytree(original, folder, dirs_exist_ok=True)
    path = folder / "run.json"
    metadata = json.loads(path.read_text())
    if change in mutations.JSON_MUTATIONS:
        mutations.JSON_MUTATIONS[change](metadata, rng)
    elif change == "tables":
        table = folder / "run.csv"
        table.write_text(mutations.change_csv(table.read_text(), rng))
    text = json.dumps(metadata)
    path.write_text(mutations.duplicate_key(text, rng) if change == "duplicates" else text)
    return path


def use_parts(path: Path) -> None:
    _, checkpoint, later = _parts_folder()
    parts = RunParts.ending_at(path.with_suffix(".csv"), checkpoint)
    columns, files = parts.write(later)
    times = columns["t [s]"]
    _expect(len({len(x) for x in columns.values()}) == 1, "columns of different lengths")
    _expect((np.diff(times) > 0.0).all(), "times do not ascend")
    _expect(times[-1] == later.t[-1], "another end")
    _expect(all(file.parent == path.parent for file in files), "files in another folder")
    metadata = json.loads(path.read_text())
    _expect(metadata["status"] in ("ok", "failed", "limited", "interrupted"), "another status")


@dataclass(frozen=True)
class Kind:
    """Kind of a file.

    Attributes
    ----------
    write
        Writes a mutated file to a folder and returns its path, given the name of the mutation and
        a random number generator.
    use
        Reads and uses the file; raises BeamdaeError if the file is refused, and InconsistentError.
    changes
        Names of the mutations.
    share
        Share of all files.
    """

    write: Callable[[Path, str, random.Random], Path]
    use: Callable[[Path], None]
    changes: tuple[str, ...]
    share: float


_JSON = (*mutations.JSON_MUTATIONS, "duplicates")
KINDS = {
    "checkpoint": Kind(write_checkpoint, use_checkpoint, _JSON, 0.25),
    "saved run": Kind(write_run, use_run, (*_JSON, "arrays", "shapes", "members"), 0.4),
    "record": Kind(write_record, use_record, (*_JSON, "tables", "tables"), 0.2),
    "continued run": Kind(write_parts, use_parts, (*_JSON, "tables"), 0.15),
}
