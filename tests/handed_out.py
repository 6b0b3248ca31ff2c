"""Write into everything that objects of beamdae hand out, and list what then reads differently.

An object hands out its public attributes, the results of its methods without arguments, and the
entries of these. Tables, arrays, sparse matrices, dictionaries, lists and sets among them are
overwritten. Afterwards, all of them are read again.
"""

import dataclasses
import inspect
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse as sp
from mechanisms import hinged_beam, mass_on_rail, rectangle

import beamdae as bd

# Methods without required arguments that compute at length, draw or display.
_SKIPPED_METHODS = frozenset(
    {"animate", "check", "diagram", "draw", "plot", "run", "save", "snapshot", "solve", "verify"}
)
# Collections of a mechanism under construction, to which `Mechanism.add` and others add.
_OPEN_COLLECTIONS = frozenset({"events", "inactive", "observables", "parts"})
# Modules of objects that are opened: other objects are read by their repr.
_PACKAGE = "beamdae"
# Objects of these modules are internal: caches and expressions shared by models.
_CLOSED_MODULES = ("beamdae.symbolic", "beamdae.equations.structure", "beamdae.native")
_MAX_DEPTH = 8
_MAX_ENTRIES = 4  # of tuples and dictionaries, from the start


def collect_leaves(thing: Any, path: str = "") -> dict[str, Any]:
    """Return all containers of values that an object hands out, by the expression that gives it."""
    leaves: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _collect(thing, path, leaves, {}, 0)
    return leaves


def _collect(
    thing: Any, path: str, leaves: dict[str, Any], opened: dict[int, Any], depth: int
) -> None:
    if depth > _MAX_DEPTH:
        return
    is_leaf = isinstance(thing, (np.ndarray, pd.DataFrame, pd.Series, pd.Index, set))
    if is_leaf or sp.issparse(thing):
        if path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
    elif isinstance(thing, Mapping):
        if path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
        for key in list(thing)[:_MAX_ENTRIES]:
            _collect(thing[key], f"{path}[{key!r}]", leaves, opened, depth + 1)
    elif isinstance(thing, (list, tuple)) and not hasattr(thing, "_fields"):
        if isinstance(thing, list) and path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
        for k, entry in enumerate(thing[:_MAX_ENTRIES]):
            _collect(entry, f"{path}[{k}]", leaves, opened, depth + 1)
    elif _is_opened(thing) and id(thing) not in opened:
        opened[id(thing)] = thing  # kept, so that its id stays unique
        for name, read in _list_members(thing):
            value: Any = None
            with suppress(ValueError, NotImplementedError):  # including BeamdaeError
                value = read()
            _collect(value, f"{path}.{name}", leaves, opened, depth + 1)


def _is_opened(thing: Any) -> bool:
    module = type(thing).__module__
    return module.split(".")[0] == _PACKAGE and not module.startswith(_CLOSED_MODULES)


def _list_members(thing: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield name and getter of public attributes, and name and method of argument-free methods."""
    names = {*dir(type(thing)), *getattr(thing, "__dict__", ())}
    for name in sorted(names):
        if name.startswith("_") or name in _SKIPPED_METHODS:
            continue
        declared = inspect.getattr_static(type(thing), name, None)
        if isinstance(declared, (classmethod, staticmethod)):
            continue
        if inspect.isfunction(declared):
            required = list(inspect.signature(declared).parameters.values())[1:]
            if all(
                p.default is not p.empty or p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
                for p in required
            ):
                yield f"{name}()", lambda name=name: getattr(thing, name)()
        else:
            yield name, lambda name=name: getattr(thing, name)


def describe_value(value: Any) -> Any:
    """Return a value that compares equal to that of an unchanged container."""
    if isinstance(value, (pd.DataFrame, pd.Series, pd.Index)):
        return value.to_string() if not isinstance(value, pd.Index) else str(list(value))
    if sp.issparse(value):
        # Not the dense matrix: overwritten indices would end the process.
        arrays = (getattr(value, name, np.zeros(0)) for name in ("data", "indices", "indptr"))
        return value.shape, *(repr(array.tolist()) for array in arrays)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, repr(value.tolist())
    if isinstance(value, Mapping):
        return repr([(key, _describe_entry(value[key])) for key in value])
    if isinstance(value, list):
        return repr([_describe_entry(entry) for entry in value])
    return repr(sorted(map(str, value)))


def _describe_entry(entry: Any) -> Any:
    if isinstance(entry, (np.ndarray, Mapping, list, pd.DataFrame, pd.Series)):
        return describe_value(entry)
    is_plain = isinstance(entry, (str, int, float, bool, tuple, type(None)))
    return repr(entry) if is_plain and not dataclasses.is_dataclass(entry) else type(entry).__name__


def overwrite(value: Any) -> None:
    """Try to change a container in all usual ways; refusals are ignored."""
    for write in _WRITES:
        with suppress(Exception):
            write(value)


def _write_array(value: Any) -> None:
    value[...] = value * 1000 + 1 if value.dtype.kind in "fiuc" else np.zeros_like(value)


def _write_columns(value: Any) -> None:
    for column in list(value):
        value[column] = 12345.0


def _write_entries(value: Any) -> None:
    for key in list(value):
        value[key] = "overwritten"


# Writing into the arrays behind tables comes first: the other ways replace these arrays.
_WRITES: tuple[Callable[[Any], Any], ...] = (
    _write_array,
    lambda value: _write_array(value.values),
    lambda value: _write_array(np.asarray(value)),
    lambda value: [_write_array(value[column].values) for column in value],
    lambda value: _write_array(value.data),
    lambda value: _write_array(value.indices),
    lambda value: value.mul(1000, inplace=True),
    lambda value: value.iloc.__setitem__((slice(None), 0), 777.0),
    lambda value: value.iloc.__setitem__(slice(None), 777.0),
    _write_columns,
    lambda value: value.drop(columns=list(value)[:1], inplace=True),
    _write_entries,
    lambda value: value.update({"overwritten": 1}),
    lambda value: value.pop(next(iter(value))),
    lambda value: value.clear(),
    lambda value: value.append("overwritten"),
    lambda value: value.reverse(),
    lambda value: value.add("overwritten"),
    lambda value: value.sort(),
)


def list_changes(thing: Any) -> list[str]:
    """Return the expressions whose values differ after writing into everything handed out.

    `thing` itself belongs to the caller.
    """
    before = collect_leaves(thing)
    expected = {path: describe_value(leaf) for path, leaf in before.items()}
    for leaf in before.values():
        overwrite(leaf)
    again = {path: describe_value(leaf) for path, leaf in collect_leaves(thing).items()}
    return sorted(path for path in expected if path and again.get(path) != expected[path])


STRIP = rectangle(0.004, 0.01)


@bd.model(t_end=0.1)
def arm(stiffness=50.0):
    """Beam on a hinge with a spring, shaken at its tip."""
    mech, beam = hinged_beam(STRIP, 2, name="arm", gravity=9.81, start={"arm.x0": 0.0})
    hinge = mech.part("hinge")
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, stiffness))
    mech.add(bd.TorsionSpring("damper", hinge.a, hinge.b, damping=1.0))
    mech.add(bd.Force("shaker", beam.end, (0.0, bd.sine(1.0, frequency=10.0))))
    mech.observe("tip", beam.end)
    mech.when("tip.y", crosses=-0.001, direction="down", do="record", name="low")
    return mech


@bd.model(t_end=0.1)
def shaken(stiffness=100.0, damping=50.0):
    """Mass on a spring, shaken ten times per second."""
    mech, bob = mass_on_rail(x=1.0, name="bob", spring=(stiffness, damping))
    mech.add(bd.Force("shaker", bob.point, (bd.sine(1.0, frequency=10.0), 0.0)))
    mech.observe("bob", bob.point)
    return mech


def run(**settings: Any) -> bd.results.Solution:
    """Run the arm; its metadata contain the warnings that have been read."""
    solution = bd.simulate(arm(), bd.Radau(1e-4), output_step=0.01, **settings)
    assert isinstance(solution.warnings, tuple)
    return solution


def _saved_run(folder: Path) -> Any:
    return bd.load(run().save(folder / "run.beamdae"))


# Objects that hand out data, made with files in a folder.
RESULTS: dict[str, Callable[[Path], Any]] = {
    "Solution": lambda _: run(),
    "SavedRun": _saved_run,
    "Solution.at": lambda _: run().at(0.05),
    "SectionForces": lambda _: run().section_forces("arm"),
    "Equilibrium": lambda _: bd.equilibrium(arm()),
    "Modes": lambda _: bd.modes(arm(), n=2),
    "LinearModel": lambda _: bd.linearize(arm(), inputs=["shaker"], outputs=["tip"]),
    "PeriodicMotion": lambda _: bd.periodic(shaken(), 0.1),
    "Check": lambda _: bd.check(shaken()),
    "refined Solution": lambda _: bd.simulate(shaken(), accuracy=0.01),
    "Sensitivities": lambda _: bd.sensitivities(shaken, "stiffness"),
    "EquilibriumSensitivities": lambda _: bd.equilibrium_sensitivities(shaken, "stiffness"),
    "ModeSensitivities": lambda _: bd.mode_sensitivities(shaken, "stiffness"),
    "PeriodicSensitivities": lambda _: bd.periodic_sensitivities(shaken, "stiffness", 0.1),
    "Fit": lambda _: bd.fit(
        shaken, {"t [s]": [0.0, 0.05, 0.1], "bob.x": [1.0, 1.001, 1.0]}, "stiffness"
    ),
    "Optimization": lambda _: bd.optimize(
        shaken, bd.quantities.Mass(), "stiffness", (), {"stiffness": (40.0, 160.0)}
    ),
    "SweepResults": lambda _: bd.sweep(shaken, {"stiffness": [50.0, 60.0]}, jobs=1),
    "Mechanism": lambda _: arm(),
    "Model": lambda _: arm,
}
