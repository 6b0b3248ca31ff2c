"""HTML pages of equilibrium paths, natural modes, buckling modes and periodic motions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.mode_shapes import ModeScenes
from beamdae.report.run_page import build_run_page, export_table
from beamdae.report.scene.frame_export import export_frames
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import CoordinatePoses
from beamdae.report.terminal import text_tables as terminal
from beamdae.results.columns import Header
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.periodic_motion import PeriodicMotion
from beamdae.results.storage.files import versions

Array = np.ndarray

_ID = "path"  # id of the only case of a path and of its group
_LOAD_FACTOR = "load factor [-]"
_MAX_FRAMES = 120
_FRAMES_PER_PERIOD = 32
_PRINTED_MULTIPLIERS = 4


def write_analysis_page(result: Any, path: Path, title: str = "") -> Path:
    """Write the page of an equilibrium path, modes, buckling or a periodic motion."""
    if isinstance(result, Equilibrium):
        page = build_path_page(result, title or str(result.model.get("name", "equilibria")))
    elif isinstance(result, PeriodicMotion):
        page = build_periodic_page(result, title or "periodic motion")
    else:
        page = build_modes_page(result, title or f"modes about {result.about}")
    return write_page(path, page)


def build_path_page(equilibrium: Equilibrium, title: str) -> dict[str, Any]:
    """Return the page content of an equilibrium path; points of the path take the place of times.

    One chart shows the load factor over an observed column, with the critical points.
    """
    points = np.arange(len(equilibrium.q), dtype=float)
    columns = {_LOAD_FACTOR: equilibrium.factors.sum(axis=1), **equilibrium.columns}
    curves = select_curves({TIME: points, **columns}, compute_row_limit(len(columns)))
    critical = [
        [point.kind, f"{point.factor:.7g}", str(point.row), point.moves or "-"]
        for point in equilibrium.critical
    ]
    observed = equilibrium.columns
    tables: list[dict[str, Any]] = [
        {"title": "Equilibria", "rows": list(path_facts(equilibrium).items())},
        {
            "title": "Critical points",
            "head": ["kind", "load factor", "point", "moves most"],
            "rows": critical,
        },
        export_table("Observed", terminal.range_table(observed)) if observed else {"rows": []},
        export_table(
            "Validity of the beams", terminal.validity_table(equilibrium.validity), "errors"
        ),
        _settings_table(equilibrium.settings),
    ]
    lengths = [x for x in observed if Header.of(x).unit == "m"]
    return {
        "title": title,
        "subtitle": f"equilibria: {equilibrium.status.sentence}",
        "made": versions(),
        "notes": list(equilibrium.warnings),
        "groups": [{"id": _ID, "frames": _export_path_frames(equilibrium)}],
        "time": {"name": "point", "unit": ""},
        "portrait": {
            # The observed point that moves most.
            "x": max(lengths or observed or [_LOAD_FACTOR], key=lambda x: np.ptp(columns[x])),
            "y": _LOAD_FACTOR,
            "marks": [
                {"t": float(point.row), "label": point.kind} for point in equilibrium.critical
            ],
        },
        "tables": [table for table in tables if table["rows"]],
        "cases": [
            {
                "id": _ID,
                "group": _ID,
                "label": title,
                "family": "equilibria",
                "status": "ok" if equilibrium.status.success else equilibrium.status.sentence,
                "curves": curves,
            }
        ],
    }


def _export_path_frames(equilibrium: Equilibrium) -> dict[str, Any] | None:
    mechanism = equilibrium.equations.mechanism
    if mechanism is None:
        return None
    count = min(len(equilibrium.q), _MAX_FRAMES)
    rows = np.linspace(0, len(equilibrium.q) - 1, count).round().astype(int)
    poses, times = CoordinatePoses(mechanism, equilibrium.q[rows]), rows.astype(float)
    try:
        scene = build_scene(mechanism, poses, times, is_hidden=lambda part: part.is_load)
    except BeamdaeError:
        return None  # There are no parts that can be drawn.
    return export_frames(scene, times)


def build_modes_page(modes: Modes | Buckling, title: str) -> dict[str, Any]:
    """Return the page content of natural or buckling modes: their table and their motion.

    The motion of each mode is one period without decay or growth, scaled to be visible.
    """
    table = modes.table()
    labels = [modes.describe(k) for k in range(len(modes))]
    values = table.iloc[:, 1:].to_dict("records")
    frames = _export_mode_frames(modes)
    first = str(table.columns[1])
    return {
        "title": title,
        "subtitle": f"{len(modes)} modes about {modes.about}",
        "made": versions(),
        "notes": list(modes.warnings),
        "groups": [{"id": _ID}],
        "time": {"name": "phase", "unit": "periods"},
        "noun": "modes",
        "columns": [
            {"key": "label", "label": "mode", "unit": "", "kind": "text"},
            *(_describe_mode_column(name, table[name]) for name in table.columns[1:]),
            {"key": "mode", "label": "number", "unit": "", "kind": "number"},
        ],
        "axes": {"x": "mode", "y": first},
        "sliders": [
            {
                "label": "mode",
                "unit": "",
                "values": list(range(1, len(modes) + 1)),
                "isNumeric": False,
            }
        ],
        "cases": [
            {
                "id": str(k),
                "group": _ID,
                "label": labels[k],
                "family": "modes",
                "rank": k,
                "at": [k],
                "values": {"mode": k + 1, **_plain_values(values[k])},
                "frames": frames[k] if frames else None,
            }
            for k in range(len(modes))
        ],
    }


def _describe_mode_column(name: str, values: Any) -> dict[str, str]:
    unit = Header.of(name).unit if name.endswith("]") else ""
    kind = "number" if pd.api.types.is_numeric_dtype(values) else "text"
    return {"key": name, "label": name.removesuffix(f" [{unit}]"), "unit": unit, "kind": kind}


def _plain_values(row: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(k): x.item() if isinstance(x, np.generic) else x for k, x in row.items()}


def _export_mode_frames(modes: Modes | Buckling) -> list[dict[str, Any]]:
    """Return one animation per mode; an empty list if nothing can be drawn."""
    try:
        scenes = ModeScenes("page", modes)
    except BeamdaeError:
        return []
    shares = np.linspace(0.0, 1.0, _FRAMES_PER_PERIOD + 1)
    # With this phase, a real mode shape starts from zero displacement.
    phases = np.exp(2j * np.pi * (shares - 0.25))
    return [export_frames(scenes.vibrating(k, phases), shares) for k in range(len(modes))]


def build_periodic_page(motion: PeriodicMotion, title: str) -> dict[str, Any]:
    """Return the page content of a periodic motion: one period as a run, and its stability."""
    page = build_run_page(motion.solution, title)
    amplitudes = motion.amplitudes()
    facts = {"title": "Periodic motion", "rows": list(periodic_facts(motion).items())}
    ranges = export_table("Amplitudes", terminal.amplitudes_table(amplitudes))
    added = [facts, ranges] if len(amplitudes) else [facts]
    tables = [table for table in page["tables"] if table["title"] != "Observed"]
    subtitle = f"{motion.status.sentence}; {motion.stability}"
    return page | {"subtitle": subtitle, "tables": [*added, *tables]}


def path_facts(result: Equilibrium) -> dict[str, str]:
    """Return descriptions of an equilibrium path, keyed by topic."""
    n_unstable = int(result.unstable[-1])
    if n_unstable == -1:
        stability = "not known"
    elif n_unstable > 0:
        stability = f"unstable in {n_unstable} direction{'s' * (n_unstable > 1)}"
    elif result.free:
        stability = f"neither stable nor unstable, {result.free} is free to move"
    else:
        stability = "stable"
    critical_points = "; ".join(
        f"{point.kind} at {point.factor:.7g}{f', {point.moves} moves most' if point.moves else ''}"
        for point in result.critical
    )
    n_points = len(result.q)
    return {
        "status": result.status.sentence,
        "loads": "; then ".join(", ".join(stage) for stage in result.loads) or "none is scaled",
        "load factor": f"{result.factor:.7g}",
        "equilibrium": stability,
        "critical points": critical_points or "none",
        "path": f"{n_points} point{'s' * (n_points > 1)}, {result.settings['iterations']} Newton "
        f"iterations, {result.settings['control']} control",
    }


def periodic_facts(motion: PeriodicMotion) -> dict[str, str]:
    """Return descriptions of a periodic motion, keyed by topic."""
    moduli = [f"{abs(x):.6g}" for x in motion.multipliers[:_PRINTED_MULTIPLIERS].tolist()]
    return {
        "status": motion.status.sentence,
        "period": f"{motion.period:.8g} s",
        "stability": motion.stability,
        "multipliers": f"largest moduli {', '.join(moduli)}" if moduli else "none",
    }


def _settings_table(settings: Mapping[str, Any]) -> dict[str, Any]:
    rows = [[str(name), _format_setting(value)] for name, value in settings.items()]
    rows = [row for row in rows if row[1]]
    return {"title": "Settings", "rows": rows, "section": "solver"}


def _format_setting(value: Any) -> str:
    """Return numbers and texts as they are, sequences with commas, and "" for no value."""
    if isinstance(value, Mapping):
        return "; ".join(f"{name} = {_format_setting(x)}" for name, x in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_format_setting, value))
    return "" if value is None else str(value)
