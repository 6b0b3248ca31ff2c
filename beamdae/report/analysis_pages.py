"""HTML pages of equilibria, modes, buckling, critical loads, periodic motions and responses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import Bode
from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, format_count
from beamdae.report.campbell_page import build_campbell_page
from beamdae.report.linear_page import build_linear_page
from beamdae.report.page.page_content import PageColumn, PageContent, PageTable
from beamdae.report.page.page_data import compute_row_limit, sample_evenly, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.mode_shapes import ModeScenes
from beamdae.report.run_page import build_run_page, export_table
from beamdae.report.scene.frame_export import FRAMES_PER_PERIOD, export_frames, export_run_frames
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import CoordinatePoses, EnlargedPoses, Poses
from beamdae.report.scene.run_scene import choose_scale
from beamdae.report.terminal import text_tables as terminal
from beamdae.results.columns import Header
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.periodic_motion import PeriodicMotion
from beamdae.results.storage.files import versions

Array = np.ndarray

_ID = "path"  # id of the only case of a path and of its group
_LOAD_FACTOR = "load factor [-]"
_MAX_FRAMES = 120
_PRINTED_MULTIPLIERS = 4
_MAX_RESPONSE_MOTIONS = 25  # motions on the page of a response; others are interpolated
_NUMBERS = "biuf"  # kinds of NumPy's types of numbers


def write_analysis_page(result: Any, path: Path, title: str | None = None) -> Path:
    """Write the page of the result of an analysis, such as modes or a response curve."""
    if isinstance(result, Equilibrium):
        page = build_path_page(result, str(result.model.get("name", "equilibria")))
    elif isinstance(result, PeriodicMotion):
        page = build_periodic_page(result, "periodic motion")
    elif isinstance(result, FrequencyResponse):
        page = build_response_page(result, f"response over {result.parameter}")
    elif isinstance(result, Campbell):
        page = build_campbell_page(result, "Campbell diagram")
    elif isinstance(result, Boundary | KnockDown):
        page = build_critical_loads_page(result, "critical loads")
    elif isinstance(result, LinearModel | Bode):
        model = result.model if isinstance(result, Bode) else result
        page = build_linear_page(result, f"linear model about {model.about}")
    else:
        noun = "buckling modes" if isinstance(result, Buckling) else "modes"
        page = build_modes_page(result, f"{noun} about {result.about}")
    return write_page(path, page if title is None else page | {"title": title})


def build_path_page(equilibrium: Equilibrium, title: str) -> PageContent:
    """Return the page of an equilibrium path, with its points in the place of times.

    One chart shows the load factor over an observed column, or this column over the quantity that
    varies instead, with the critical points.
    """
    points = np.arange(len(equilibrium.q), dtype=float)
    header = equilibrium.header
    columns = {header: equilibrium.factors.sum(axis=1), **equilibrium.columns}
    curves = select_curves({TIME: points, **columns}, compute_row_limit(len(columns)))
    critical = [
        [point.kind, f"{point.factor:.7g}", str(point.row), point.moves or "-"]
        for point in equilibrium.critical
    ]
    observed = equilibrium.columns
    tables: list[PageTable] = [
        {"title": "Equilibria", "rows": list(path_facts(equilibrium).items())},
        {
            "title": "Critical points",
            "head": ["kind", equilibrium.quantity, "point", "moves most"],
            "rows": critical,
        },
        export_table("Observed", terminal.range_table(observed)) if observed else {"rows": []},
        export_table("Errors", terminal.errors_table(equilibrium.errors), "errors"),
        _settings_table(equilibrium.settings),
    ]
    lengths = [x for x in observed if Header.of(x).unit == "m"]
    # The observed point that moves most.
    largest = max(lengths or observed or [header], key=lambda x: np.ptp(columns[x]))
    abscissa, ordinate = (header, largest) if equilibrium.over else (largest, header)
    return {
        "title": title,
        "subtitle": f"equilibria: {equilibrium.status.sentence}",
        "made": versions(),
        "notes": list(equilibrium.warnings),
        "groups": [{"id": _ID, "frames": _export_path_frames(equilibrium)}],
        "time": {"name": "point", "unit": ""},
        "featured": [largest],
        "portrait": {
            "x": abscissa,
            "y": ordinate,
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
    poses: Poses = CoordinatePoses(mechanism, equilibrium.q[rows])
    times = rows.astype(float)
    try:
        scene = build_scene(mechanism, poses, times, is_hidden=lambda part: part.is_load)
        scale = choose_scale(mechanism, poses, scene)
        if scale != 1.0:
            poses = EnlargedPoses(poses, scale)
            scene = build_scene(mechanism, poses, times, is_hidden=lambda part: part.is_load)
    except BeamdaeError:
        return None  # There are no parts that can be drawn.
    return export_frames(scene, times, scale=scale)


def build_modes_page(modes: Modes | Buckling, title: str) -> PageContent:
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
        "subtitle": f"{format_count(len(modes), 'mode')} about {modes.about}",
        "made": versions(),
        "notes": list(modes.warnings),
        "groups": [{"id": _ID}],
        "time": {"name": "phase", "unit": "periods"},
        "noun": "modes",
        "columns": [
            {"key": "label", "label": "mode", "unit": "", "kind": "text"},
            *(_describe_mode_column(name, table[name]) for name in table.columns[1:]),
            {"key": "mode", "label": "mode number", "unit": "", "kind": "number"},
        ],
        "axes": {"x": "mode", "y": first},
        "sliders": [
            {
                "label": "mode",
                "unit": "",
                "values": list(range(1, len(modes) + 1)),
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


def _describe_mode_column(name: str, values: Any) -> PageColumn:
    unit = Header.of(name).unit
    kind = "number" if np.asarray(values).dtype.kind in _NUMBERS else "text"
    return {"key": name, "label": name.removesuffix(f" [{unit}]"), "unit": unit, "kind": kind}


def _plain_values(row: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(k): x.item() if isinstance(x, np.generic) else x for k, x in row.items()}


def _export_mode_frames(modes: Modes | Buckling) -> list[dict[str, Any]]:
    """Return one animation per mode; an empty list if nothing can be drawn."""
    try:
        scenes = ModeScenes("page", modes)
    except BeamdaeError:
        return []
    shares = np.linspace(0.0, 1.0, FRAMES_PER_PERIOD + 1)
    # The first frame, which pages show first and print, is at the largest displacement.
    phases = np.exp(2j * np.pi * shares)
    return [export_frames(scenes.vibrating(k, phases), shares) for k in range(len(modes))]


def build_critical_loads_page(result: Boundary | KnockDown, title: str) -> PageContent:
    """Return the page content of critical loads over a parameter or an imperfection.

    There is one case per point, without motion. Marks show the special points.
    """
    table = result.table()
    name = str(table.columns[0])
    special = result.special if isinstance(result, Boundary) else ()
    points = [[point.kind, f"{point.value:.7g}", f"{point.factor:.7g}"] for point in special]
    if isinstance(result, Boundary):
        subtitle = f"{result.kind}: {result.status.sentence}"
        facts = {"status": result.status.sentence, "loads": ", ".join(result.loads)}
    else:
        subtitle = "load factors of the first critical points of imperfect structures"
        facts = {"load factor without imperfection": f"{result.perfect:.7g}"}
    tables: list[PageTable] = [
        {"title": "Critical loads", "rows": [[key, value] for key, value in facts.items()]},
        {"title": "Special points", "head": ["kind", name, "load factor"], "rows": points},
    ]
    return {
        "title": title,
        "subtitle": subtitle,
        "made": versions(),
        "notes": list(result.warnings),
        "groups": [{"id": _ID}],
        "noun": "points",
        "columns": [
            {"key": "label", "label": "point", "unit": "", "kind": "text"},
            *(_describe_mode_column(str(column), table[column]) for column in table),
        ],
        "axes": {"x": name, "y": _LOAD_FACTOR},
        "overlays": [
            {
                "x": name,
                "y": _LOAD_FACTOR,
                "lines": [],
                "marks": [{"label": x.kind, "x": x.value, "y": x.factor} for x in special],
            }
        ],
        "tables": [table for table in tables if table["rows"]],
        "cases": [
            {
                "id": str(k),
                "group": _ID,
                "label": f"point {k + 1}",
                "family": "points",
                "series": "curve",
                "rank": k,
                "values": _plain_values(row),
            }
            for k, row in enumerate(table.to_dict("records"))
        ],
    }


def build_periodic_page(motion: PeriodicMotion, title: str) -> PageContent:
    """Return the page content of a periodic motion: one period as a run, and its stability."""
    page = build_run_page(motion.solution, title, warnings=motion.warnings)
    amplitudes = motion.amplitudes()
    facts = {"title": "Periodic motion", "rows": list(periodic_facts(motion).items())}
    ranges = export_table("Amplitudes", terminal.amplitudes_table(amplitudes))
    added = [facts, ranges] if len(amplitudes) else [facts]
    tables = [table for table in page["tables"] if table["title"] != "Observed"]
    subtitle = f"{motion.status.sentence}; {motion.stability}"
    return page | {"subtitle": subtitle, "tables": [*added, *tables]}


def build_response_page(response: FrequencyResponse, title: str) -> PageContent:
    """Return the page content of a response curve: one case per periodic motion along the curve.

    The scatter plot shows a half range over the parameter, with peaks marked and lines to unstable
    motions dashed.
    """
    table, count = response.table(), len(response.points)
    for name in {"stable", "fold"} & set(table):
        table[name] = np.where(table[name], "yes", "no")
    observed = list(response.points[0].solution.columns) if count else []
    amplitudes = {name: response.curve(name)[1] for name in observed}
    lengths = [name for name in observed if Header.of(name).unit == "m"]
    largest = max(lengths or observed, key=lambda name: amplitudes[name].max(), default=None)
    rows = [_plain_values(row) for row in table.to_dict("records")]
    moving = sample_evenly(count, _MAX_RESPONSE_MOTIONS)
    max_rows = compute_row_limit(count * len(observed))
    peaks = response.peak_table()
    tables: list[PageTable] = [
        {"title": "Response", "rows": list(response_facts(response).items())},
        {
            "title": "Peaks",
            "head": ["column", response.label, "half range", "largest magnitude"],
            "rows": [
                [name, *(f"{x:.7g}" for x in numbers)]
                for name, *numbers in peaks.itertuples(index=False)
            ],
        },
    ]
    return {
        "title": title,
        "subtitle": f"periodic motions over {response.parameter}: {response.status.sentence}",
        "made": versions(),
        "notes": list(response.warnings),
        "groups": [{"id": _ID}],
        "noun": "motions",
        "families": ["stable", "unstable"],
        "leads": True,
        "columns": [
            {"key": "label", "label": "motion", "unit": "", "kind": "text"},
            *(
                _describe_mode_column(str(name), table[name])
                | ({"unit": response.unit} if name == response.parameter else {})
                for name in table
            ),
        ],
        "axes": {"x": response.parameter, "y": largest and _half_range_column(largest)},
        "overlays": [
            {
                "x": response.parameter,
                "y": _half_range_column(str(name)),
                "lines": [],
                "marks": [
                    {"label": f"{x:.4g}", "x": x, "y": y}
                    for x, y in points[[response.parameter, "half range"]].to_numpy().tolist()
                ],
            }
            for name, points in peaks.groupby("observed", sort=False)
        ],
        "sliders": [
            {
                "label": response.parameter,
                "unit": response.unit,
                "values": [point.parameter for point in response.points],
            }
        ],
        "tables": [table for table in tables if table["rows"]],
        "cases": [
            {
                "id": str(k),
                "group": _ID,
                "label": f"{response.parameter} = {point.parameter:.6g} {response.unit}".rstrip(),
                "family": "stable" if point.stable else "unstable",
                "series": "curve",
                "rank": k,
                "at": [k],
                "dashed": not point.stable,
                "values": rows[k],
                "curves": select_curves(
                    {TIME: point.solution.t, **point.solution.columns}, max_rows
                ),
                "frames": export_run_frames(point.solution, FRAMES_PER_PERIOD)
                if k in moving
                else None,
            }
            for k, point in enumerate(response.points)
        ],
    }


def _half_range_column(header: str) -> str:
    """Return the name of the column of `FrequencyResponse.table` with the half ranges."""
    name, _, unit = header.partition(" [")
    return f"{name} half range [{unit}"


def response_facts(response: FrequencyResponse) -> dict[str, str]:
    """Return descriptions of a response curve, keyed by topic."""
    values = [point.parameter for point in response.points]
    n_unstable = sum(not point.stable for point in response.points)
    span = f", {response.parameter} {min(values):.6g} to {max(values):.6g}" if values else ""
    span += f" {response.unit}" if values and response.unit else ""
    return {
        "status": response.status.sentence,
        "curve": f"{format_count(len(values), 'point')}{span}",
        "unstable": f"{n_unstable} of {len(values)} points",
        "folds": ", ".join(f"{fold:.6g}" for fold in response.folds) or "none",
    }


def path_facts(result: Equilibrium) -> dict[str, str]:
    """Return descriptions of an equilibrium path, keyed by topic."""
    n_unstable = int(result.unstable[-1])
    if n_unstable == -1:
        stability = "not known"
    elif n_unstable > 0:
        stability = f"unstable in {format_count(n_unstable, 'direction')}"
    elif result.free:
        stability = f"neither stable nor unstable, {result.free} is free to move"
    else:
        stability = "stable"
    critical_points = "; ".join(
        f"{point.kind} at {point.factor:.7g}{f', {point.moves} moves most' if point.moves else ''}"
        for point in result.critical
    )
    n_points = len(result.q)
    unscaled = "all in full" if result.over else "none is scaled"
    control = result.settings["control"]
    if result.over and control == "load":
        control = result.settings["over"]
    return {
        "status": result.status.sentence,
        "loads": "; then ".join(", ".join(stage) for stage in result.loads) or unscaled,
        result.quantity: f"{result.factor:.7g}",
        "equilibrium": stability,
        "critical points": critical_points or "none",
        "path": f"{format_count(n_points, 'point')}, {result.settings['iterations']} Newton "
        f"iterations, {control} control",
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


def _settings_table(settings: Mapping[str, Any]) -> PageTable:
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
