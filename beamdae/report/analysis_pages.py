"""HTML pages of equilibria, modes, buckling, critical loads, periodic motions and responses."""

from __future__ import annotations

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
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import compute_row_limit, sample_evenly, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.page_parts import (
    GROUP,
    create_cases,
    describe_columns,
    describe_page,
    export_table,
    fact_table,
    slider,
)
from beamdae.report.pictures.mode_shapes import export_modes
from beamdae.report.run_page import build_run_page
from beamdae.report.scene.frame_export import FRAMES_PER_PERIOD, export_frames, export_run_frames
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import CoordinatePoses, EnlargedPoses, Poses
from beamdae.report.scene.run_scene import choose_scale
from beamdae.report.terminal import text_tables as terminal
from beamdae.results.columns import Header
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.periodic_motion import PeriodicMotion

Array = np.ndarray

_LOAD_FACTOR = "load factor [-]"
_MAX_FRAMES = 120
_PRINTED_MULTIPLIERS = 4
_MAX_RESPONSE_MOTIONS = 25  # motions on the page of a response


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


def build_path_page(equilibrium: Equilibrium, title: str) -> Content:
    """Return the page of an equilibrium path, with its points in the place of times.

    One chart shows the load factor over an observed column, or this column over the quantity that
    varies instead, with the critical points.
    """
    header, observed, critical = equilibrium.header, equilibrium.columns, equilibrium.critical
    columns = {header: equilibrium.factors.sum(axis=1), **observed}
    points = np.arange(len(equilibrium.q), dtype=float)
    curves = select_curves({TIME: points, **columns}, compute_row_limit(len(columns)))
    lengths = [x for x in observed if Header.of(x).unit == "m"]
    # The observed point that moves most.
    largest = max(lengths or observed or [header], key=lambda x: np.ptp(columns[x]))
    abscissa, ordinate = (header, largest) if equilibrium.over else (largest, header)
    rows = [[x.kind, f"{x.factor:.7g}", str(x.row), x.moves or "-"] for x in critical]
    status = equilibrium.status
    page = describe_page(
        title,
        f"equilibria: {status.sentence}",
        equilibrium.warnings,
        [
            fact_table("Equilibria", path_facts(equilibrium)),
            {
                "title": "Critical points",
                "head": ["kind", equilibrium.quantity, "point", "moves most"],
                "rows": rows,
            },
            export_table("Observed", terminal.equilibrium_table(observed, equilibrium.errors)),
            fact_table("Settings", equilibrium.settings, "solver"),
        ],
        groups=[{"id": GROUP, "frames": _export_path_frames(equilibrium)}],
        time={"name": "point", "unit": ""},
        featured=[largest],
        portrait={
            "x": abscissa,
            "y": ordinate,
            "marks": [{"t": float(x.row), "label": x.kind} for x in critical],
        },
    )
    page["cases"] = [
        {
            "id": "path",
            "group": GROUP,
            "label": title,
            "family": "equilibria",
            "status": "ok" if status.success else status.sentence,
            "curves": curves,
        }
    ]
    return page


def _export_path_frames(equilibrium: Equilibrium) -> dict[str, Any] | None:
    mechanism = equilibrium.equations.mechanism
    if mechanism is None:
        return None
    rows = sorted(sample_evenly(len(equilibrium.q), _MAX_FRAMES))
    poses: Poses = CoordinatePoses(mechanism, equilibrium.q[rows])
    times = np.array(rows, float)
    try:
        scene = build_scene(mechanism, poses, times, is_hidden=lambda part: part.is_load)
        scale = choose_scale(mechanism, poses, scene)
        if scale != 1.0:
            poses = EnlargedPoses(poses, scale)
            scene = build_scene(mechanism, poses, times, is_hidden=lambda part: part.is_load)
    except BeamdaeError:
        return None  # There are no parts that can be drawn.
    return export_frames(scene, times, scale=scale)


def build_modes_page(modes: Modes | Buckling, title: str) -> Content:
    """Return the page content of natural or buckling modes: their table and their motion.

    The motion of each mode is one period without decay or growth, scaled to be visible.
    """
    count = len(modes)
    table = modes.table().iloc[:, 1:]
    axes = {"x": "mode", "y": str(table.columns[0])}
    table["mode"] = range(1, count + 1)
    labels = [modes.describe(k) for k in range(count)]
    motions = [{"at": [k], "frames": x} for k, x in enumerate(export_modes(modes, range(count)))]
    return describe_page(
        title,
        f"{format_count(count, 'mode')} about {modes.about}",
        modes.warnings,
        time={"name": "phase", "unit": "periods"},
        noun="modes",
        columns=describe_columns("mode", table),
        axes=axes,
        sliders=[slider("mode", range(1, count + 1))],
        cases=create_cases(table, labels, *motions, family="modes"),
    )


def build_critical_loads_page(result: Boundary | KnockDown, title: str) -> Content:
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
    marks = [{"label": x.kind, "x": x.value, "y": x.factor} for x in special]
    labels = [f"point {k + 1}" for k in range(len(table))]
    return describe_page(
        title,
        subtitle,
        result.warnings,
        [
            fact_table("Critical loads", facts),
            {"title": "Special points", "head": ["kind", name, "load factor"], "rows": points},
        ],
        noun="points",
        columns=describe_columns("point", table),
        axes={"x": name, "y": _LOAD_FACTOR},
        overlays=[{"x": name, "y": _LOAD_FACTOR, "lines": [], "marks": marks}],
        cases=create_cases(table, labels, family="points", series="curve"),
    )


def build_periodic_page(motion: PeriodicMotion, title: str) -> Content:
    """Return the page content of a periodic motion: one period as a run, and its stability."""
    page = build_run_page(motion.solution, title, warnings=motion.warnings)
    amplitudes = motion.amplitudes()
    added = [fact_table("Periodic motion", periodic_facts(motion))]
    if len(amplitudes):
        added.append(export_table("Amplitudes", terminal.amplitudes_table(amplitudes)))
    tables = [table for table in page["tables"] if table["title"] != "Observed"]
    subtitle = f"{motion.status.sentence}; {motion.stability}"
    return page | {"subtitle": subtitle, "tables": [*added, *tables]}


def build_response_page(response: FrequencyResponse, title: str) -> Content:
    """Return the page content of a response curve: one case per periodic motion along the curve.

    The scatter plot shows a half range over the parameter, with peaks marked and lines to unstable
    motions dashed.
    """
    table, points, parameter = response.table(), response.points, response.parameter
    observed = list(points[0].solution.columns) if points else []
    amplitudes = {name: response.curve(name)[1] for name in observed}
    lengths = [name for name in observed if Header.of(name).unit == "m"]
    largest = max(lengths or observed, key=lambda name: amplitudes[name].max(), default=None)
    peaks = response.peak_table()
    moving = sample_evenly(len(points), _MAX_RESPONSE_MOTIONS)
    max_rows = compute_row_limit(len(points) * len(observed))
    motions = [
        {
            "family": "stable" if point.stable else "unstable",
            "at": [k],
            "dashed": not point.stable,
            "curves": select_curves({TIME: point.solution.t, **point.solution.columns}, max_rows),
            "frames": export_run_frames(point.solution, FRAMES_PER_PERIOD) if k in moving else None,
        }
        for k, point in enumerate(points)
    ]
    labels = [f"{parameter} = {x.parameter:.6g} {response.unit}".rstrip() for x in points]
    return describe_page(
        title,
        f"periodic motions over {parameter}: {response.status.sentence}",
        response.warnings,
        [
            fact_table("Response", response_facts(response)),
            export_table("Peaks", terminal.peaks_table(parameter, response.label, peaks)),
        ],
        noun="motions",
        families=["stable", "unstable"],
        leads=True,
        columns=describe_columns("motion", table, {parameter: response.unit}),
        axes={"x": parameter, "y": largest and _half_range_column(largest)},
        overlays=[
            {
                "x": parameter,
                "y": _half_range_column(str(name)),
                "lines": [],
                "marks": [
                    {"label": f"{x:.4g}", "x": x, "y": y}
                    for x, y in rows[[parameter, "half range"]].to_numpy().tolist()
                ],
            }
            for name, rows in peaks.groupby("observed", sort=False)
        ],
        sliders=[slider(parameter, [point.parameter for point in points], response.unit)],
        cases=create_cases(table, labels, *motions, series="curve"),
    )


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
