"""HTML pages of equilibria, modes, buckling, critical loads, periodic motions and responses."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, format_count
from beamdae.report.descriptions import describe
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import compute_row_limit, sample_evenly, select_curves
from beamdae.report.page_parts import (
    GROUP,
    create_cases,
    describe_columns,
    describe_page,
    export_table,
    export_tables,
    fact_table,
    slider,
)
from beamdae.report.pictures.mode_shapes import export_modes
from beamdae.report.pictures.path_plots import mark_rows
from beamdae.report.run_page import build_run_page
from beamdae.report.scene.frame_export import FRAMES_PER_PERIOD, export_frames, export_run_frames
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import CoordinatePoses, EnlargedPoses, Poses
from beamdae.report.scene.run_scene import choose_scale
from beamdae.results.columns import Header
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.periodic_motion import PeriodicMotion

Array = np.ndarray

_LOAD_FACTOR = "load factor [-]"
_MAX_FRAMES = 120
_MAX_RESPONSE_MOTIONS = 25  # motions on the page of a response


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
    points_of_path = [
        {
            "kind": x.kind,
            equilibrium.quantity: f"{x.factor:.7g}",
            "point": x.row,
            "modes": x.multiplicity,
            "moves most": x.moves,
        }
        for x in critical
    ]
    status, warnings = equilibrium.status, equilibrium.warnings
    description = describe(equilibrium)  # contains the errors that the warnings have measured
    page = describe_page(
        title,
        f"equilibria: {status.sentence}",
        warnings,
        [
            fact_table("Equilibria", {"status": status.sentence, **description.facts}),
            export_table("Critical points", points_of_path),
            *export_tables(description),
            fact_table("Settings", {**description.details, **equilibrium.settings}, "solver"),
        ],
        groups=[{"id": GROUP, "frames": _export_path_frames(equilibrium)}],
        time={"name": "point", "unit": ""},
        featured=[largest],
        portrait={
            "x": abscissa,
            "y": ordinate,
            "marks": [{"t": float(k), "label": x} for k, x in mark_rows(equilibrium).items()],
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
    points = [
        {"kind": x.kind, name: f"{x.value:.7g}", "load factor": f"{x.factor:.7g}"} for x in special
    ]
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
            export_table("Special points", points),
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
    description = describe(motion)
    facts = {"status": motion.status.sentence, **description.facts}
    added = [fact_table("Periodic motion", facts), *export_tables(description)]
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
    peaks, description = response.peak_table(), describe(response)
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
            fact_table("Response", {"status": response.status.sentence, **description.facts}),
            *export_tables(description),
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
