"""HTML pages of equilibria, modes, buckling, Campbell diagrams, linear models, responses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, format_count
from beamdae.report.page.page_content import PageCase, PageColumn, PageContent, PageTable
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.mode_shapes import (
    ModeScenes,
    choose_frequency_limit,
    describe_hidden_modes,
    find_overdamped,
)
from beamdae.report.run_page import build_run_page, export_table
from beamdae.report.scene.frame_export import export_frames, export_run_frames
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
_FRAMES_PER_PERIOD = 32
_PRINTED_MULTIPLIERS = 4
_MAX_RESPONSE_MOTIONS = 25  # motions on the page of a response; others are interpolated
_MAX_CAMPBELL_MOTIONS = 120  # modes with a motion on the page of a Campbell diagram
_SPEED = "speed [rad/s]"
_FREQUENCY = "frequency [Hz]"
_GROWTH_RATE = "growth rate [1/s]"
_COUNTS = ("mode", "multiple")
_GUIDE_POINTS = 101
_VIEW_MARGIN = 0.05  # of the frequencies shown first, relative to the largest one
# Columns with smaller half ranges, relative to the largest one in their unit, are rounding noise.
_NOISE_RANGE = 1e-9
_NUMBERS = "biuf"  # kinds of NumPy's types of numbers
# Transfer functions below this share of the bound by the norms of matrices are rounding noise.
_TRANSFER_ROUNDING = 10.0 * np.finfo(float).eps
_QUARTILES = (0.25, 0.5, 0.75)
_MAX_POLES = 24  # in the table of a linear model
_MAX_REAL_POLES = 8  # of these; overdamped axial vibrations of beams have many
_MIN_IMAGINARY_SHARE = 1e-6  # of poles; smaller imaginary parts are rounding errors
_POLE_ROUNDING = 10.0 * np.finfo(float).eps  # of poles, relative to the largest one
_FREQUENCY_MARGIN = 10.0  # of transfer functions, below the slowest and above the listed poles
_MAX_PEAK_DAMPING = 0.7  # damping ratio above which a pole has no peak
_MAX_FREQUENCY_RATIO = 1e6  # of transfer functions
_MAX_FREQUENCIES, _MIN_FREQUENCIES = 600, 60
_FREQUENCY_WORK = 1e10  # frequencies times number of states cubed; about ten seconds
_PEAK_SHARE = 0.5  # of the frequencies are beside poles
# Distances from lightly damped poles, in half widths of their peaks.
_PEAK_POSITIONS = np.array([-6.0, -3.0, -1.5, -0.7, -0.3, 0.0, 0.3, 0.7, 1.5, 3.0, 6.0])
_MIN_PEAK_WIDTH = 1e-5  # relative half width of peaks that are resolved
# Shift of the positions beside undamped poles, where the response is infinite, and the minimum
# distance of all frequencies from these poles, in half widths.
_UNDAMPED_SHIFT, _MIN_POLE_DISTANCE = 0.1, 0.05


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
    elif isinstance(result, LinearModel):
        page = build_linear_page(result, f"linear model about {result.about}")
    else:
        noun = "buckling modes" if isinstance(result, Buckling) else "modes"
        page = build_modes_page(result, f"{noun} about {result.about}")
    return write_page(path, page if title is None else page | {"title": title})


def build_path_page(equilibrium: Equilibrium, title: str) -> PageContent:
    """Return the page of an equilibrium path, with its points in the place of times.

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
    tables: list[PageTable] = [
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
    # The observed point that moves most.
    largest = max(lengths or observed or [_LOAD_FACTOR], key=lambda x: np.ptp(columns[x]))
    return {
        "title": title,
        "subtitle": f"equilibria: {equilibrium.status.sentence}",
        "made": versions(),
        "notes": list(equilibrium.warnings),
        "groups": [{"id": _ID, "frames": _export_path_frames(equilibrium)}],
        "time": {"name": "point", "unit": ""},
        "featured": [largest],
        "portrait": {
            "x": largest,
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
    shares = np.linspace(0.0, 1.0, _FRAMES_PER_PERIOD + 1)
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
    page = build_run_page(motion.solution, title)
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
    moving = _sample_evenly(count, _MAX_RESPONSE_MOTIONS)
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
                "isNumeric": True,
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
                "frames": export_run_frames(point.solution, _FRAMES_PER_PERIOD)
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


def _sample_evenly(count: int, limit: int) -> set[int]:
    """Return at most `limit` of the numbers below `count`, the first and the last included."""
    return set(np.linspace(0, count - 1, min(count, limit)).round().astype(int).tolist())


def build_campbell_page(diagram: Campbell, title: str) -> PageContent:
    """Return the page content of a Campbell diagram: one case per mode and speed.

    The scatter plot shows the frequencies over the speed, with the multiples of the speed as lines
    and the resonances as marks.
    """
    order = np.argsort(diagram.speeds)
    unit, key = diagram.speed_unit, f"speed [{diagram.speed_unit}]"
    speeds = diagram.speeds[order] / diagram.speed_factor
    frequencies, rates = diagram.frequencies[order], diagram.eigenvalues.real[order]
    guide = np.linspace(speeds[0], speeds[-1], _GUIDE_POINTS)
    revolutions = diagram.speed_factor / (2.0 * np.pi)  # per second and unit of the speed
    n_modes = frequencies.shape[1]
    frames = _export_campbell_frames(diagram, order.tolist())
    resonances = diagram.resonances()
    resonances.insert(0, key, resonances.pop(_SPEED) / diagram.speed_factor)
    marks = resonances.to_dict("records")
    hidden, overdamped = describe_hidden_modes(diagram), find_overdamped(diagram)
    limit = choose_frequency_limit(diagram)
    return {
        "title": title,
        "subtitle": f"{format_count(n_modes, 'mode')} at {format_count(len(speeds), 'speed')}"
        + (f"; {hidden} above the range shown first, Reset shows all" if hidden else ""),
        "made": versions(),
        "notes": list(diagram.warnings),
        "groups": [{"id": _ID}],
        "time": {"name": "phase", "unit": "periods"},
        "noun": "modes",
        "leads": True,
        "columns": [
            {"key": "label", "label": "mode", "unit": "", "kind": "text"},
            {"key": key, "label": "speed", "unit": unit, "kind": "number"},
            {"key": _FREQUENCY, "label": "frequency", "unit": "Hz", "kind": "number"},
            {"key": _GROWTH_RATE, "label": "growth rate", "unit": "1/s", "kind": "number"},
        ],
        "axes": {"x": key, "y": _FREQUENCY},
        "views": {"scatter": {"y": [-_VIEW_MARGIN * limit, (1.0 + _VIEW_MARGIN) * limit]}}
        if hidden
        else {},
        "overlays": [
            {
                "x": key,
                "y": _FREQUENCY,
                "lines": [
                    {
                        "label": f"{multiple}\u00d7",
                        "x": guide.tolist(),
                        "y": (multiple * np.abs(guide) * revolutions).tolist(),
                    }
                    for multiple in diagram.multiples
                ],
                "marks": [{"label": "", "x": x[key], "y": x[_FREQUENCY]} for x in marks],
            }
        ],
        "sliders": [
            {
                "label": "speed",
                "unit": unit,
                "values": speeds.tolist(),
                "isNumeric": len(speeds) > 1,
            },
            {
                "label": "mode",
                "unit": "",
                "values": list(range(1, n_modes + 1)),
                "isNumeric": False,
            },
        ],
        "tables": [
            {
                "title": "Resonances",
                "head": [key, "frequency [Hz]", "mode", "excitations per revolution"],
                "rows": [
                    [f"{x[key]:.6g}", f"{x[_FREQUENCY]:.6g}", *(str(x[k]) for k in _COUNTS)]
                    for x in marks
                ],
            }
        ],
        "cases": [
            {
                "id": f"{i}-{k}",
                "group": _ID,
                "label": f"mode {k + 1} at {speeds[i]:.6g} {unit}",
                "family": f"mode {k + 1}",
                "series": f"mode {k + 1}",
                "rank": i,
                "at": [i, k],
                "values": {
                    key: float(speeds[i]),
                    # Overdamped modes have no frequency.
                    _FREQUENCY: float(frequencies[i, k]) if not overdamped[k] else None,
                    _GROWTH_RATE: float(rates[i, k]),
                },
                "frames": frames.get((i, k)),
            }
            for k in range(n_modes)
            for i in range(len(speeds))
        ],
    }


def build_linear_page(model: LinearModel, title: str) -> PageContent:
    """Return the page content of a linear model: its poles and one case per transfer function.

    The charts show magnitude and phase over the frequency (Bode diagram).
    """
    poles = model.poles[model.poles.imag >= 0.0]
    rounding = _POLE_ROUNDING * np.max(np.abs(poles), initial=0.0)
    described = [_describe_pole(pole, rounding) for pole in poles]
    listed = _select_poles(poles, np.array([x[-1] for x in described]))
    frequencies = _choose_frequencies(poles, listed, len(model.states))
    response = model.frequency_response(frequencies)
    pairs = [
        (i, j)
        for j, source in enumerate(model.inputs)
        for i, output in enumerate(model.outputs)
        if output.name != source.name  # The response of an input to itself is 1.
    ]
    # Those with one unit share a chart, and the first ones are selected.
    units = [_format_ratio(model.outputs[i].unit, model.inputs[j].unit) for i, j in pairs]
    sizes = np.median(np.abs(response), axis=0)
    scales = {
        unit: max(sizes[x] for x, y in zip(pairs, units, strict=True) if y == unit)
        for unit in units
    }
    noise = _TRANSFER_ROUNDING * _bound_magnitudes(model, np.quantile(frequencies, _QUARTILES))
    pairs = [pairs[k] for k in sorted(range(len(pairs)), key=lambda k: units.index(units[k]))]
    rows = [[str(k + 1), *(f"{x:.6g}" for x in described[k])] for k in listed]
    growth_rate = max((x[-1] for x in described), default=0.0)
    facts = {
        "about": model.about,
        "size": f"{format_count(len(model.states), 'state')}, "
        f"{format_count(len(model.inputs), 'input')}, "
        f"{format_count(len(model.outputs), 'output')}",
        "largest growth rate": f"{growth_rate:.6g} 1/s" if len(poles) else "-",
    }
    if len(poles) > len(listed):
        fastest = np.max(np.abs(np.delete(poles, listed)))
        facts["not listed"] = f"{len(poles) - len(listed)} poles, up to |p| = {fastest:.4g} 1/s"
    values = [
        [x.name, x.unit, "output", f"{y:.6g}"]
        for x, y in zip(model.outputs, model.output_values, strict=True)
    ]
    quantities = [*([x.name, x.unit, "input", "-"] for x in model.inputs), *values]
    tables: list[PageTable] = [
        {"title": "Linear model", "rows": list(facts.items())},
        {
            "title": "Poles",
            "head": ["pole", "frequency [Hz]", "damping ratio [-]", "growth rate [1/s]"],
            "rows": rows,
        },
        {
            "title": "Inputs and outputs",
            "head": ["name", "unit", "kind", "value at the state"],
            "rows": quantities,
        },
    ]
    return {
        "title": title,
        "subtitle": f"{facts['size']}, {format_count(len(pairs), 'transfer function')}",
        "made": versions(),
        "notes": list(model.warnings),
        "groups": [{"id": _ID}],
        "time": {"name": "frequency", "unit": "Hz", "log": True},
        "noun": "transfer functions",
        "axes": None,
        "columns": [
            {"key": "label", "label": "output / input", "unit": "", "kind": "text"},
            {"key": "largest", "label": "largest magnitude", "unit": "", "kind": "number"},
            {"key": "at", "label": "at frequency", "unit": "Hz", "kind": "number"},
        ],
        "tables": [table for table in tables if table["rows"]],
        "cases": [
            _build_transfer_case(
                model,
                frequencies,
                response[:, i, j],
                i,
                j,
                max(_NOISE_RANGE * scales[unit], noise[i, j]),
            )
            for (i, j), unit in zip(pairs, sorted(units, key=units.index), strict=True)
        ],
    }


def _select_poles(poles: Array, growth_rates: Array) -> list[int]:
    """Return the positions of the poles in the table: growing ones, and the slowest others.

    Of the others, at most eight are real.
    """
    is_oscillating = np.array([_is_oscillating(x) for x in poles], bool)
    is_candidate = is_oscillating | (np.cumsum(~is_oscillating) <= _MAX_REAL_POLES)
    is_listed = is_candidate & (np.cumsum(is_candidate) <= _MAX_POLES)
    return np.flatnonzero(is_listed | (growth_rates > 0.0)).tolist()


def _describe_pole(pole: complex, rounding: float) -> tuple[float, float, float]:
    """Return frequency [Hz], damping ratio [-] and growth rate [1/s].

    The real part of an oscillating pole is 0 if it is at most `rounding` [1/s].
    """
    if _is_oscillating(pole) and abs(pole.real) <= rounding:
        pole = complex(0.0, pole.imag)
    size = abs(pole)
    frequency = abs(pole.imag) / (2.0 * np.pi) if _is_oscillating(pole) else 0.0
    # Adding zero changes -0 to 0.
    return frequency, (-pole.real / size if size else 0.0) + 0.0, pole.real + 0.0


def _is_oscillating(pole: complex) -> bool:
    return abs(pole.imag) > _MIN_IMAGINARY_SHARE * abs(pole)


def _format_ratio(output_unit: str, input_unit: str) -> str:
    divisor = input_unit if input_unit.isalpha() or input_unit == "-" else f"({input_unit})"
    return f"{output_unit}/{divisor}" if divisor != "-" else output_unit


def _build_transfer_case(
    model: LinearModel, frequencies: Array, response: Array, i: int, j: int, noise: float
) -> PageCase:
    """Return a transfer function, without curves if its median magnitude is at most `noise`.

    Rounding errors are compared to medians, because peaks of undamped modes have any magnitude.
    """
    output, source = model.outputs[i], model.inputs[j]
    magnitude, largest = np.abs(response), int(np.argmax(np.abs(response)))
    size = np.median(magnitude)
    # A response that is zero but for rounding has no phase.
    is_noise = magnitude <= _NOISE_RANGE * size
    phase = np.degrees(np.unwrap(np.angle(response)))
    return {
        "id": f"{i}-{j}",
        "group": _ID,
        "label": f"{output.header} / {source.header}",
        "family": source.name,
        "values": {"largest": float(magnitude[largest]), "at": float(frequencies[largest])},
        "curves": {
            "t": frequencies,
            "magnitude": {f"magnitude [{_format_ratio(output.unit, source.unit)}]": magnitude},
            "phase": {"phase [deg]": np.where(is_noise, np.nan, phase)},
        }
        if size > noise
        else None,
    }


def _bound_magnitudes(model: LinearModel, frequencies: Array) -> Array:
    """Return the median over the frequencies of |C (i w I - A)^-1| |B|, w = 2 pi f.

    |.| are the norms of rows and columns. Rounding errors of the transfer matrix are proportional
    to this product, even where the response is zero by symmetry.
    """
    bounds = []
    for f in frequencies:
        shifted = 2j * np.pi * f * np.eye(len(model.A)) - model.A
        gains = np.linalg.solve(shifted.T, model.C.T.astype(complex))
        bounds.append(np.outer(np.linalg.norm(gains, axis=0), np.linalg.norm(model.B, axis=0)))
    return np.median(bounds, axis=0)


def _choose_frequencies(poles: Array, listed: list[int], n_states: int) -> Array:
    """Return frequencies [Hz] around the listed poles, denser near lightly damped ones."""
    sizes = np.abs(poles) / (2.0 * np.pi)
    known = np.sort(sizes[sizes > _NOISE_RANGE * sizes.max(initial=0.0)])
    if not len(known):
        known = np.ones(1)
    low = known[0] / _FREQUENCY_MARGIN
    peaks = [
        size
        for pole, size in zip(poles[listed], sizes[listed], strict=True)
        if _is_oscillating(pole) and abs(pole.real) < _MAX_PEAK_DAMPING * abs(pole)
    ]
    high = min(max([known[0], *peaks]) * _FREQUENCY_MARGIN, low * _MAX_FREQUENCY_RATIO)
    work = _FREQUENCY_WORK / max(n_states, 1) ** 3
    count = int(np.clip(work, _MIN_FREQUENCIES, _MAX_FREQUENCIES))
    near, undamped = [], []
    n_peaks = int(_PEAK_SHARE * count) // len(_PEAK_POSITIONS)
    for k, (pole, size) in enumerate(zip(poles, sizes, strict=True)):
        if _is_oscillating(pole):
            center, width = pole.imag / (2.0 * np.pi), abs(pole.real) / (2.0 * np.pi)
            if width <= _MIN_PEAK_WIDTH * size:
                width = _MIN_PEAK_WIDTH * size
                undamped.append((center, _MIN_POLE_DISTANCE * width))
                center += _UNDAMPED_SHIFT * width
            if k < n_peaks:
                near.append(center + width * _PEAK_POSITIONS)
    near_poles = np.concatenate([np.zeros(0), *near])
    near_poles = near_poles[(near_poles > low) & (near_poles < high)]
    grid = np.geomspace(low, high, max(count - len(near_poles), 2))
    frequencies = np.unique(np.concatenate([grid, near_poles]))
    for center, distance in undamped:
        frequencies = frequencies[np.abs(frequencies - center) >= distance]
    return frequencies


def _export_campbell_frames(
    diagram: Campbell, order: list[int]
) -> dict[tuple[int, int], dict[str, Any]]:
    """Return one animation per mode at evenly sampled speeds, by position of speed and mode.

    Shapes have the phase of the shape at the speed before, so that animations can be interpolated.
    """
    n_modes = diagram.eigenvalues.shape[1]
    positions = sorted(_sample_evenly(len(order), max(_MAX_CAMPBELL_MOTIONS // max(n_modes, 1), 2)))
    shares = np.linspace(0.0, 1.0, _FRAMES_PER_PERIOD + 1)
    phases = np.exp(2j * np.pi * shares)
    frames: dict[tuple[int, int], dict[str, Any]] = {}
    before: dict[int, Array] = {}
    for i in positions:
        modes = diagram.modes[order[i]]
        try:
            scenes = ModeScenes("page", modes)
        except BeamdaeError:
            return {}
        for k, number in enumerate(_find_modes(modes, diagram.eigenvalues[order[i]])):
            product = np.vdot(modes.shapes[number], before.get(k, modes.shapes[number]))
            turn = product / abs(product) if product else 1.0
            before[k] = turn * modes.shapes[number]
            frames[i, k] = export_frames(scenes.vibrating(number, turn * phases), shares)
    return frames


def _find_modes(modes: Modes, eigenvalues: Array) -> list[int]:
    """Return the numbers of the modes with these eigenvalues; equal ones in ascending order."""
    free = list(range(len(modes)))
    numbers = []
    for eigenvalue in eigenvalues:
        numbers.append(min(free, key=lambda k: abs(modes.eigenvalues[k] - eigenvalue)))
        free.remove(numbers[-1])
    return numbers


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
    return {
        "status": result.status.sentence,
        "loads": "; then ".join(", ".join(stage) for stage in result.loads) or "none is scaled",
        "load factor": f"{result.factor:.7g}",
        "equilibrium": stability,
        "critical points": critical_points or "none",
        "path": f"{format_count(n_points, 'point')}, {result.settings['iterations']} Newton "
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
