"""Runs from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from beamdae.equations.model_hash import identity_of
from beamdae.errors import BeamdaeError
from beamdae.parts.initial_state import AS_DRAWN
from beamdae.results.solution import Solution
from beamdae.results.storage.files import file_path
from beamdae.results.storage.packed_run import Packed, unpacked
from beamdae.results.storage.saved_run import SavedRun, read, tables_of
from beamdae.simulation import as_equations


def load(path: str | Path, model: Any = None) -> Solution | SavedRun:
    """A run from a file of `Solution.save`.

    Parameters
    ----------
    path
        Of the file.
    model
        The model function, mechanism, system or equations that ran. With it the run is a `Solution`
        again, all steps of it; without it there are its tables, see `SavedRun`.

    Raises
    ------
    BeamdaeError
        If there is no such file, it is damaged or of another version, or the run is one of another
        model.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball", ball.point)
    >>> path = bd.simulate(mech, t_end=1.0).save("fall.beamdae")
    >>> print(f"{bd.load(path)['ball.y'].min():.3f} m")
    -2.905 m
    >>> print(f"{bd.load(path, mech).at(0.5).state.q[1]:.3f} m")
    0.774 m
    """
    file = file_path("load", path)
    arrays, told = read(file)
    equations = None if model is None else as_equations("load", model, AS_DRAWN)
    if equations is not None and identity_of(equations) != told.get("identity"):
        raise BeamdaeError(f"{file}: it is a run of another model, of other parts or numbers.")
    try:
        if equations is None:
            return tables_of(file, arrays, told)
        return unpacked(equations, Packed(arrays, told["plain"]))
    except (KeyError, TypeError, ValueError, IndexError):
        raise BeamdaeError(f"{file}: the saved run is damaged.") from None
