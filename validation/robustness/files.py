"""Hostile files: valid files with mutated content and correct checksums, read and used.

A use ends, or raises BeamdaeError. Forged files may contain any numbers.
"""

import copy
import hashlib
import json
import math
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
from robustness import judge
from robustness.isolation import ScratchFolder

import beamdae as bd
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, BeamdaeWarning, KernelWarning
from beamdae.results.storage.documents import checksum
from beamdae.simulation import as_equations
from beamdae.studies.executors import SerialPool
from beamdae.studies.study_run import run_study

# Mutations ------------------------------------------------------------------------------------

_STOP_PROBABILITY = 0.1  # of mutating a container as a whole instead of one of its entries
_MAX_DEPTH = 12
OTHER_TYPES = (None, True, "x", 3, 2.5, [], {}, [[1]], {"a": 1}, [None], "", False)
HUGE = (10**400, -(10**400), 10**30, 2**63, 1e308, -1e308, 1e200, -(10**4000))
NOT_FINITE = (math.nan, math.inf, -math.inf)
LONG = (
    "x" * 100_000,
    "\x1b[2J\x07",
    "\ud800",
    "../../../etc/passwd",
    "/dev/zero",
    "a\0b",
    "=1+2",
    "</script><script>",
    "%s %d {0}",
)


def _nest(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


NESTED = (_nest(30), _nest(120), _nest(400), [[]] * 1000)


def pick(content: Any, rng: random.Random) -> tuple[Any, Any]:
    """Return a container inside `content` and a key or index of one of its entries."""
    container, key = [content], 0
    for _ in range(_MAX_DEPTH):
        value = container[key]
        if not isinstance(value, (dict, list)) or not value:
            break
        if value is not content and rng.random() < _STOP_PROBABILITY:
            break
        entries = list(value) if isinstance(value, dict) else range(len(value))
        container, key = value, rng.choice(entries)
    return container, key


def replace_by(values: tuple[Any, ...]) -> Callable[[Any, random.Random], None]:
    """Return the mutation that replaces an entry by one of `values`."""

    def mutate(content: Any, rng: random.Random) -> None:
        container, key = pick(content, rng)
        container[key] = copy.deepcopy(rng.choice(values))

    return mutate


def change_value(content: Any, rng: random.Random) -> None:
    """Replace a value by another value of the same type."""
    container, key = pick(content, rng)
    value = container[key]
    if isinstance(value, bool):
        container[key] = not value
    elif isinstance(value, (int, float)):
        container[key] = rng.choice(
            (-value, value + 1, 2 * value, 0 * value, value * 1000, -1, value - 1)
        )
    elif isinstance(value, str):
        container[key] = rng.choice((f"{value}2", "", "unknown", value[::-1], "up", "ok"))
    elif isinstance(value, list):
        container[key] = rng.choice((value[::-1], value[:1], value * 2))


def remove(content: Any, rng: random.Random) -> None:
    """Remove an entry."""
    container, key = pick(content, rng)
    del container[key]


def add(content: Any, rng: random.Random) -> None:
    """Add an entry."""
    container, key = pick(content, rng)
    value = copy.deepcopy(rng.choice((container[key], *OTHER_TYPES)))
    if isinstance(container, list):
        container.insert(key, value)
    else:
        container[rng.choice(("more", "status", "t", f"{key} "))] = value


def rename(content: Any, rng: random.Random) -> None:
    """Rename an entry of an object."""
    container, key = pick(content, rng)
    if isinstance(container, dict):
        container[f"{key}x"] = container.pop(key)


JSON_MUTATIONS: dict[str, Callable[[Any, random.Random], None]] = {
    "types": replace_by(OTHER_TYPES),
    "values": change_value,
    "missing": remove,
    "extra": add,
    "names": rename,
    "huge": replace_by(HUGE),
    "nan": replace_by(NOT_FINITE),
    "nesting": replace_by(NESTED),
    "texts": replace_by(LONG),
}


def change_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Return an array with other numbers."""
    values = np.array(array)
    if not values.size:
        return np.ones((1, *values.shape[1:]))
    if values.dtype.kind != "f":
        return rng.choice((values[::-1], values + 1, -values, values * 0))
    index = rng.randrange(values.size)
    number = rng.choice((0.0, -1.0, 1e9, 1e300, math.nan, math.inf, 1e-300))
    with np.errstate(over="ignore"):
        kind = rng.randrange(5)
        if kind == 0:
            values.flat[index] = number
        elif kind == 1:
            values = values[::-1].copy()
        elif kind == 2:
            values = np.full_like(values, number)
        elif kind == 3:
            values = values * 1.5
        else:
            values.flat[index] = values.flat[index - 1]
    return values


def reshape_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Return an array of another shape or type."""
    options: list[Callable[[], np.ndarray]] = [
        lambda: array[:-1],
        lambda: array[:0],
        lambda: np.concatenate([array, array]),
        lambda: np.atleast_2d(array),
        lambda: array.ravel(),
        lambda: array.T[None],
        lambda: np.float64(3.0),
        lambda: array.astype(np.float32),
        lambda: array.astype(np.int64, casting="unsafe"),
        lambda: array.astype(complex),
        lambda: array.astype(str),
        lambda: array.astype(">f8"),
        lambda: array.astype(bool),
        lambda: np.asfortranarray(array),
        lambda: np.array(["2026-01-01"], "datetime64[D]"),
    ]
    with np.errstate(invalid="ignore"):
        return np.asarray(rng.choice(options)())


def change_csv(text: str, rng: random.Random) -> str:
    """Return CSV text with another cell, row or header."""
    lines = text.splitlines()
    row = rng.randrange(len(lines))
    cells = lines[row].split(",")
    cell = rng.randrange(len(cells))
    kind = rng.randrange(8)
    if kind <= 2:
        cells[cell] = rng.choice(("", "nan", "inf", "x", "1.2.3", "1e999", "-", "1_0", "9e9", '"'))
        lines[row] = ",".join(cells)
    elif kind == 3:
        lines[row] = ",".join([*cells, "0.0"])
    elif kind == 4:
        lines[row] = ",".join(cells[:-1])
    elif kind == 5:
        del lines[row]
    elif kind == 6:
        lines.insert(row, lines[row])
    else:
        lines[1:] = lines[:0:-1]
    return rng.choice(("\n".join([*lines, ""]), "\n".join(lines), "\n".join([*lines, ""])))


# Examples -------------------------------------------------------------------------------------

_T_END = 0.4  # s
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
    if change in JSON_MUTATIONS:
        JSON_MUTATIONS[change](content, rng)
    elif change == "arrays":
        arrays[name] = change_array(arrays[name], rng)
    elif change == "shapes":
        arrays[name] = reshape_array(arrays[name], rng)
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
        rows = folder / "trajectories" / content["file"]
        text = change_csv(rows.read_text(), rng)
        rows.write_text(text)
        content["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    else:
        JSON_MUTATIONS[change](content, rng)
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
    count
        Number of files.
    """

    write: Callable[[Path, str, random.Random], Path]
    use: Callable[[Path], None]
    changes: tuple[str, ...]
    count: int


_JSON = tuple(JSON_MUTATIONS)
KINDS = {
    "saved run": Kind(write_run, use_run, (*_JSON, "arrays", "shapes", "members"), 900),
    "record": Kind(write_record, use_record, (*_JSON, "tables", "tables"), 500),
}


def list_names() -> list[str]:
    """Return the names of files, "KIND: CHANGE: NUMBER"."""
    return [
        f"{name}: {kind.changes[k % len(kind.changes)]}: {k}"
        for name, kind in KINDS.items()
        for k in range(kind.count)
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
