"""Hostile files: valid files with mutated content and correct checksums, read and used.

A use ends, or raises BeamdaeError. Forged files may contain any numbers.
"""

from __future__ import annotations

import copy
import hashlib
import json
import random
import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

import beamdae as bd
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, BeamdaeWarning, KernelWarning
from beamdae.results.storage.documents import checksum
from beamdae.simulation import as_equations
from beamdae.studies.execution.executors import SerialPool
from beamdae.studies.execution.study_run import run_study
from robustness import judge, mutations
from robustness.isolation import ScratchFolder

_T_END = 0.4  # s
_LATER = 0.5  # s, end of resumed runs
_METHOD = bd.Radau(1e-4)


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


def _forge(content: Any, arrays: dict[str, np.ndarray] | None = None) -> str:
    """Return the text of a document with the right checksum."""
    if isinstance(content, dict):
        content = {name: x for name, x in content.items() if name != "checksum"}
        content["checksum"] = checksum(content, arrays)
    return json.dumps(content)


# Checkpoints ---------------------------------------------------------------------------------


@cache
def _checkpoint_content() -> dict[str, Any]:
    path = Path(mkdtemp()) / "end.json"
    return json.loads(_solution().checkpoint(path).read_text())


def write_checkpoint(folder: Path, change: str, rng: random.Random) -> Path:
    content = copy.deepcopy(_checkpoint_content())
    mutations.JSON_MUTATIONS[change](content, rng)
    path = folder / "end.json"
    path.write_text(_forge(content))
    return path


def use_checkpoint(path: Path) -> None:
    bd.simulate(caught, _METHOD, _LATER, output_step=0.05, start=path, accept_changes=True)


# Saved runs ----------------------------------------------------------------------------------


@cache
def _run_content() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    path = _solution().save(Path(mkdtemp()) / "a.run")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return json.loads(arrays.pop("document").tobytes()), arrays


def write_run(folder: Path, change: str, rng: random.Random) -> Path:
    content, arrays = copy.deepcopy(_run_content())
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
    path = folder / "a.run"
    with open(path, "wb") as file:
        np.savez(file, **arrays, document=np.frombuffer(_forge(content, arrays).encode(), np.uint8))
    return path


def use_run(path: Path) -> None:
    bd.load(path)
    bd.load(path, _equations())


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
def _study() -> bd.results.Study:
    case = bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.01))
    references = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))
    return bd.results.Study("made", (case,), references=references, t_end=0.1, output_step=0.005)


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
    content = json.loads(path.read_text())
    if change == "tables":
        rows = folder / "trajectories" / content["rows"]["file"]
        text = mutations.change_csv(rows.read_text(), rng)
        rows.write_text(text)
        content["rows"]["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    else:
        mutations.JSON_MUTATIONS[change](content, rng)
    path.write_text(_forge(content))
    return path


def use_record(path: Path) -> None:
    run_study(_study(), path.parents[1], SerialPool())


@dataclass(frozen=True)
class Kind:
    """Kind of a file.

    Attributes
    ----------
    write
        Writes a mutated file to a folder and returns its path, given the name of the mutation and
        a random number generator.
    use
        Reads and uses the file; raises BeamdaeError if the file is refused.
    changes
        Names of the mutations.
    share
        Share of all files.
    """

    write: Callable[[Path, str, random.Random], Path]
    use: Callable[[Path], None]
    changes: tuple[str, ...]
    share: float


_JSON = tuple(mutations.JSON_MUTATIONS)
KINDS = {
    "checkpoint": Kind(write_checkpoint, use_checkpoint, _JSON, 0.3),
    "saved run": Kind(write_run, use_run, (*_JSON, "arrays", "shapes", "members"), 0.45),
    "record": Kind(write_record, use_record, (*_JSON, "tables", "tables"), 0.25),
}

FILE_COUNT = 2000


def list_names() -> list[str]:
    """Return the names of files, "KIND: CHANGE: NUMBER", in proportion to the shares of kinds."""
    return [
        f"{name}: {kind.changes[k % len(kind.changes)]}: {k}"
        for name, kind in KINDS.items()
        for k in range(round(FILE_COUNT * kind.share))
    ]


def try_name(name: str) -> list[str]:
    """Write, read and use a hostile file, and return the complaint."""
    kind, change, _ = name.split(": ")
    with ScratchFolder() as scratch, warnings.catch_warnings():
        # Warnings of NumPy would be printed on standard error.
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", BeamdaeWarning)
        warnings.simplefilter("ignore", KernelWarning)
        path = KINDS[kind].write(scratch.folder, change, random.Random(name))
        try:
            KINDS[kind].use(path)
            outcome = judge.TrialOutcome("ran")
        except BeamdaeError as error:
            outcome = judge.TrialOutcome("refused", str(error))
        except Exception as error:
            outcome = judge.outcome_of_exception(error)
    complaint = judge.find_complaint(outcome)
    return [f"{complaint}: {outcome.text}" if complaint else ""]
