"""All cases of critical loads, which `cases.csv` lists with their sources."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from benchmarks.critical_loads.case import CriticalLoadCase
from benchmarks.critical_loads.columns import FRAMES, bars, divergence, flutter, frame, tapered
from benchmarks.critical_loads.curved_structures import BENT, ring

# Functions of the end of the path and of parameters that return fields of a `CriticalLoadCase`.
STRUCTURES: dict[str, Callable[..., dict[str, Any]]] = {
    "bars": bars,
    "divergence": divergence,
    "tapered": tapered,
    "flutter": flutter,
    "ring": ring,
    **BENT,
}


def _read_case(row: dict[str, str]) -> CriticalLoadCase:
    end, published = (float(row[x]) if row[x] else None for x in ("end", "published"))
    parameters = {x: _freeze(y) for x, y in json.loads(row["parameters"] or "{}").items()}
    if row["structure"] in FRAMES:
        fields = frame(FRAMES[row["structure"]](**parameters), end)
    else:
        fields = STRUCTURES[row["structure"]](end, **parameters)
    names = (row[x] for x in ("group", "case", "source"))
    return CriticalLoadCase(*names, published=published, digits=float(row["digits"]), **fields)


def _freeze(value: Any) -> Any:
    """Return tuples in place of lists: references are cached by their parameters."""
    return tuple(map(_freeze, value)) if isinstance(value, list) else value


_TABLE = pd.read_csv(Path(__file__).with_name("cases.csv"), dtype=str, keep_default_na=False)
_CASES = (_read_case(row) for row in _TABLE.to_dict("records"))
CASES = {f"{case.group}, {case.name}": case for case in _CASES}
