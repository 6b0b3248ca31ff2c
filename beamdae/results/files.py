"""Results on disk: a table as CSV, and beside it what it is the table of."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from beamdae.errors import BeamdaeError


def write(path: Path, table: pd.DataFrame, beside: Mapping[str, Any]) -> Path:
    """Write a table as CSV and what it is the table of, with versions, as JSON beside it.

    Returns the path of the CSV file.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written.
    """
    if path.suffix == ".json":
        raise BeamdaeError(f"{path}: the table is CSV, .json is for what is written beside it.")
    sidecar = {**beside, "versions": versions()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(path, index=False)
        path.with_suffix(".json").write_text(json.dumps(sidecar, indent=2) + "\n")
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be written, {problem.strerror}.") from problem
    return path


@cache
def versions() -> dict[str, str]:
    """Versions of beamdae and of what its numbers depend on."""
    from importlib.metadata import version

    names = ("beamdae", "casadi", "scikit-sundae", "numpy", "scipy")
    return {name: version(name) for name in names}
