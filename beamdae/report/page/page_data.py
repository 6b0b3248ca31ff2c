"""Curves and frames of an HTML page: selection, 16-bit encoding, and files beside the page."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.results.columns import Header, observed_columns
from beamdae.results.storage.files import write_text

Array = np.ndarray

_MAX_PAGE_VALUES = 500_000  # in all curves; about 1.3 MB at 2.7 bytes per value
_MIN_ROWS_PER_CURVE = 200
_MAX_ROWS_PER_CURVE = 2000
_QUANTIZATION_STEPS = 65534  # per range of a curve; one step is far less than a line width
_MISSING_CODE = 65535  # code of values that cannot be quantized
_MAX_MAGNITUDE = 1e300  # larger values are omitted because their range could overflow
_POSITION_DRIFT = "position drift"
_VELOCITY_DRIFT = "velocity drift"
_GRAVITY, _GRAVITY_LABEL = "gravity", "gravity from start"
# Quantities per panel that span decades; the logarithms of their magnitudes are stored and drawn.
_LOGARITHMIC: dict[str, tuple[str, ...]] = {
    "observed": (),
    "error": ("error",),
    "energy": ("imbalance",),
    "drift": (_POSITION_DRIFT, _VELOCITY_DRIFT),
}


def compute_row_limit(curves: int) -> int:
    """Return the maximum number of rows per curve for a page with the given number of curves."""
    rows = _MAX_PAGE_VALUES // max(curves, 1)
    return int(np.clip(rows, _MIN_ROWS_PER_CURVE, _MAX_ROWS_PER_CURVE))


def sample_evenly(count: int, limit: int) -> set[int]:
    """Return at most `limit` of the numbers below `count`, the first and the last included."""
    return set(np.linspace(0, count - 1, min(count, limit)).round().astype(int).tolist())


def select_curves(
    columns: Mapping[str, Any],
    max_rows: int,
    error: Array | None = None,
    differences: Mapping[str, Array] | None = None,
) -> dict[str, Any] | None:
    """Return the curves of a run for the cases of a page.

    Parameters
    ----------
    columns
        Time, observed columns, energies and drift by header, one value per row.
    max_rows
        Longer tables are thinned evenly to this number of rows.
    error
        Error [-] at each row; NaN where the error is unknown.
    differences
        Differences between columns of the run and of a reference, by header.

    Returns
    -------
    dict or None
        Curves by panel, see `page_content.Curves`. None if the table has fewer than two rows.
    """
    t = np.asarray(columns[TIME], float)
    if len(t) < 2:
        return None
    selection = np.linspace(0, len(t) - 1, min(len(t), max_rows)).round().astype(int)

    def select_rows(table: Mapping[str, Any], names: Iterable[str]) -> dict[str, Array]:
        return {n: np.asarray(table[n], float)[selection] for n in names if n in table}

    def split_panels(table: Mapping[str, Any]) -> dict[str, dict[str, Array]]:
        energies = {
            Header.of(c).suffix.replace("_", " "): x
            for c, x in select_rows(table, LEDGER_COLUMNS).items()
        }
        if _GRAVITY in energies:
            # The potential of all masses, relative to y = 0, often far exceeds its changes.
            energies[_GRAVITY] = energies[_GRAVITY] - energies[_GRAVITY][0]
            energies = {_GRAVITY_LABEL if x == _GRAVITY else x: y for x, y in energies.items()}
        return {"observed": select_rows(table, observed_columns(table)), "energy": energies}

    position, velocity = DRIFT_COLUMNS
    drift = select_rows(columns, DRIFT_COLUMNS)
    return {
        "t": t[selection],
        **split_panels(columns),
        _POSITION_DRIFT: drift.get(position),
        _VELOCITY_DRIFT: drift.get(velocity),
        "error": None if error is None else np.asarray(error, float)[selection],
        "difference": {} if differences is None else split_panels(differences),
    }


def write_curves(path: Path, curves: Mapping[str, Mapping[str, Any] | None]) -> None:
    """Write curves of cases, by id, which a page loads when one of the cases is selected.

    A page that is opened from a folder may load scripts but no data, so the file is a script.
    """
    encoded = {name: encode_curves(x) for name, x in curves.items()}
    text = json.dumps(replace_nonfinite(encoded), allow_nan=False, separators=(",", ":"))
    # As text, because "__proto__" as a name in a script is not a name of a quantity.
    write_text(path, f"addCurves({json.dumps(text)});\n")


def encode_curves(curves: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Encode time and curves, by panel and name, for the page script; None without curves."""
    if not curves:
        return None
    panels = {
        "observed": curves.get("observed") or {},
        "error": {"error": curves.get("error")},
        "energy": curves.get("energy") or {},
        "drift": {name: curves.get(name) for name in (_POSITION_DRIFT, _VELOCITY_DRIFT)},
    }
    differences = curves.get("difference") or {}
    magnitude = curves.get("magnitude") or {}
    bode = {
        "magnitude": _pack_curves(magnitude, tuple(magnitude)),
        "phase": _pack_curves(curves.get("phase") or {}),
    }
    return {
        # The frequencies of magnitude and phase are equally spaced on a logarithmic axis.
        "t": _pack_values(curves["t"], log=bool(magnitude)),
        **{panel: _pack_curves(x, _LOGARITHMIC[panel]) for panel, x in panels.items()},
        **(bode if magnitude else {}),
        "difference": {panel: _pack_curves(x) for panel, x in differences.items()},
    }


def encode_frames(frames: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Encode the frames of an animation for the page script; None if there are no frames."""
    if not frames or not frames["t"]:
        return None
    return {
        "t": _pack_values(frames["t"]),
        "bodies": [_pack_body(body) for body in frames["bodies"]],
        "poses": [
            {axis: _pack_values(x) for axis, x in pose.items()} for pose in frames.get("poses", ())
        ],
        "symbols": list(frames.get("symbols", ())),
        "colors": [_pack_color(color) for color in frames.get("colors", ())],
        "extent": frames.get("extent"),
        **{key: frames[key] for key in ("scale", "heights") if key in frames},
    }


def _pack_color(color: Mapping[str, Any]) -> dict[str, Any]:
    """Pack the colors of beams, with the values of all frames in one list per beam."""
    values = [
        {"name": beam, "values": _pack_values(np.ravel(frames).tolist())}
        for beam, frames in color["values"].items()
    ]
    return {**color, "values": values}


def _pack_body(body: Mapping[str, Any]) -> dict[str, Any]:
    """Pack a body, with the points of all frames in one list per axis."""
    description = {"name": body["name"], "kind": body["kind"], "points": len(body["x"][0])}
    points = {axis: _pack_values(np.ravel(body[axis]).tolist()) for axis in ("x", "y")}
    # A trail has a single list of points; the script shows the points up to the current frame.
    frames = {key: body[key] for key in ("frames", "heights") if key in body}
    return description | points | frames


def _pack_curves(curves: Mapping[str, Any], logarithmic: Sequence[str] = ()) -> dict[str, Any]:
    present = {name: x for name, x in curves.items() if x is not None and len(x)}
    return {name: _pack_values(x, name in logarithmic) for name, x in present.items()}


def _pack_values(values: Sequence[float | None] | Array, log: bool = False) -> dict[str, Any]:
    """Quantize values, or the logarithms of their magnitudes, into equal 16-bit steps.

    Missing and non-finite values become `_MISSING_CODE`, and so do zeros if `log` is True, and
    magnitudes of `_MAX_MAGNITUDE` or more if it is False.
    """
    x = np.array(values, float)
    if log:
        x = np.log10(np.abs(x), out=np.full(len(x), math.nan), where=x != 0.0)
    finite = np.abs(x) < _MAX_MAGNITUDE
    low, high = (float(f(x[finite])) if finite.any() else 0.0 for f in (np.min, np.max))
    step = (high - low) / _QUANTIZATION_STEPS or 1.0
    codes = np.full(len(x), _MISSING_CODE, "<u2")
    codes[finite] = np.round((x[finite] - low) / step)
    packed = {"u16": base64.b64encode(codes.tobytes()).decode(), "low": low, "step": step}
    return packed | {"log": True} if log else packed


def replace_nonfinite(value: Any) -> Any:
    """Return plain values with None for nan and infinity, which JSON lacks."""
    if isinstance(value, Mapping):
        return {str(name): replace_nonfinite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [replace_nonfinite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
