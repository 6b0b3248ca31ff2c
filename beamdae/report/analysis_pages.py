"""HTML pages of analyses: statics, modes, linear models, fits and optimized designs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import (
    Bode,
    TransferFunction,
    bode,
)
from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, format_count
from beamdae.model_parameters import split_unit
from beamdae.report.descriptions import describe
from beamdae.report.page.content import (
    GROUP,
    Content,
    compute_row_limit,
    create_cases,
    describe_columns,
    describe_page,
    export_table,
    export_tables,
    fact_table,
    sample_evenly,
    select_curves,
    slider,
)
from beamdae.report.pictures.analysis_plots import mark_rows
from beamdae.report.pictures.mode_shapes import (
    choose_frequency_limit,
    describe_hidden_modes,
    export_modes,
    find_overdamped,
)
from beamdae.report.scene.mechanism_scene import (
    build_scene,
    coordinate_poses,
    reference_poses,
)
from beamdae.report.scene.run_scene import (
    export_frames,
    export_run_frames,
)
from beamdae.results.columns import Header, remove_unit
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.solution import Solution
from beamdae.simulation import silenced

if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit
    from beamdae.analysis.optimization.result import Optimization


Array = np.ndarray

_LOAD_FACTOR = "load factor [-]"
_MAX_PATH_FRAMES = 120
_MAX_MOTIONS = 120  # modes with a motion; others have none
_FREQUENCY = "frequency [Hz]"
_GROWTH_RATE = "growth rate [1/s]"
_GUIDE_POINTS = 101
_VIEW_MARGIN = 0.05  # of the frequencies shown first, relative to the largest one
_MAX_VIBRATIONS, _MAX_DECAYS = 16, 8  # the slowest ones; growing ones are listed, too


def build_path_page(equilibrium: Equilibrium, title: str, names: Sequence[str] = ()) -> Content:
    """Return the page of an equilibrium path, with its points in the place of times.

    One chart shows the load factor over an observed column, the first one of `names` or the one
    that varies most, or this column over the quantity that varies instead, with the critical
    points.
    """
    header, observed, critical = equilibrium.header, equilibrium.columns, equilibrium.critical
    columns = {header: equilibrium.factors.sum(axis=1), **observed}
    points = np.arange(len(equilibrium.q), dtype=float)
    curves = select_curves({TIME: points, **columns}, compute_row_limit(len(columns)))
    lengths = [x for x in observed if Header.of(x).unit == "m"]
    # The observed point that moves most.
    largest = max(lengths or observed or [header], key=lambda x: np.ptp(columns[x]))
    names = names or [largest]
    abscissa, ordinate = (header, names[0]) if equilibrium.over else (names[0], header)
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
        featured=list(names),
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
    rows = sorted(sample_evenly(len(equilibrium.q), _MAX_PATH_FRAMES))
    poses = coordinate_poses(mechanism, equilibrium.q[rows])
    times = np.array(rows, float)
    try:
        scene = build_scene(mechanism, poses, times, None, lambda part: part.is_load, scale=None)
    except BeamdaeError:
        return None  # There are no parts that can be drawn.
    return export_frames(scene, times)


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


def build_campbell_page(diagram: Campbell, title: str) -> Content:
    """Return the page content of a Campbell diagram: one case per mode and speed.

    The scatter plot shows the frequencies over the speed, with the multiples of the speed as lines
    and the resonances as marks.
    """
    import pandas as pd

    order = np.argsort(diagram.speeds)
    unit, key = diagram.speed_unit, f"speed [{diagram.speed_unit}]"
    speeds = diagram.speeds[order] / diagram.speed_factor
    frequencies, rates = diagram.frequencies[order], diagram.eigenvalues.real[order]
    n_modes, n_speeds = frequencies.shape[1], len(speeds)
    # Overdamped modes have no frequency.
    frequencies = np.where(find_overdamped(diagram), np.nan, frequencies)
    columns = {
        key: np.tile(speeds, n_modes),
        _FREQUENCY: frequencies.T.ravel(),
        _GROWTH_RATE: rates.T.ravel(),
    }
    table = pd.DataFrame(columns)
    frames = _export_frames(diagram, order.tolist())
    places = [(i, k) for k in range(n_modes) for i in range(n_speeds)]
    labels = [f"mode {k + 1} at {speeds[i]:.6g} {unit}" for i, k in places]
    motions = [
        {
            "family": f"mode {k + 1}",
            "series": f"mode {k + 1}",
            "rank": i,
            "at": [i, k],
            "frames": x,
        }
        for i, k in places
        for x in [frames.get((i, k))]
    ]
    resonances = describe(diagram).tables["Resonances"]
    marks = resonances[[key, _FREQUENCY]].to_numpy(float).tolist()
    guide = np.linspace(speeds[0], speeds[-1], _GUIDE_POINTS)
    revolutions = np.abs(guide) * diagram.speed_factor / (2.0 * np.pi)  # per second
    lines = [
        {"label": f"{n}\u00d7", "x": guide.tolist(), "y": (n * revolutions).tolist()}
        for n in diagram.multiples
    ]
    hidden, limit = describe_hidden_modes(diagram), choose_frequency_limit(diagram)
    view = {"y": [-_VIEW_MARGIN * limit, (1.0 + _VIEW_MARGIN) * limit]}
    return describe_page(
        title,
        f"{format_count(n_modes, 'mode')} at {format_count(n_speeds, 'speed')}"
        + (f"; {hidden} above the range shown first, Reset shows all" if hidden else ""),
        diagram.warnings,
        [export_table("Resonances", resonances)],
        time={"name": "phase", "unit": "periods"},
        noun="modes",
        leads=True,
        columns=describe_columns("mode", table),
        axes={"x": key, "y": _FREQUENCY},
        views={"scatter": view} if hidden else {},
        overlays=[
            {
                "x": key,
                "y": _FREQUENCY,
                "lines": lines,
                "marks": [{"label": "", "x": x, "y": y} for x, y in marks],
            }
        ],
        sliders=[slider("speed", speeds.tolist(), unit), slider("mode", range(1, n_modes + 1))],
        cases=create_cases(table, labels, *motions),
    )


def _export_frames(diagram: Campbell, order: list[int]) -> dict[tuple[int, int], Any]:
    """Return one animation per mode at evenly sampled speeds, by position of speed and mode.

    Shapes have the phase of the shape at the speed before.
    """
    n_modes = diagram.eigenvalues.shape[1]
    frames: dict[tuple[int, int], Any] = {}
    before: dict[int, Array] = {}
    for i in sorted(sample_evenly(len(order), max(_MAX_MOTIONS // max(n_modes, 1), 2))):
        modes = diagram.modes[order[i]]
        numbers = _find_modes(modes, diagram.eigenvalues[order[i]])
        phases = []
        for k, number in enumerate(numbers):
            product = np.vdot(modes.shapes[number], before.get(k, modes.shapes[number]))
            phases.append(product / abs(product) if product else 1.0)
            before[k] = phases[-1] * modes.shapes[number]
        exported = export_modes(modes, numbers, phases)
        frames |= {(i, k): x for k, x in enumerate(exported)}
    return frames


def _find_modes(modes: Modes, eigenvalues: Array) -> list[int]:
    """Return the numbers of the modes with these eigenvalues; equal ones in ascending order."""
    free = list(range(len(modes)))
    numbers = []
    for eigenvalue in eigenvalues:
        numbers.append(min(free, key=lambda k: abs(modes.eigenvalues[k] - eigenvalue)))
        free.remove(numbers[-1])
    return numbers


def build_linear_page(content: LinearModel | Bode, title: str) -> Content:
    """Return the page content of a linear model: its poles and one case per transfer function.

    The charts show magnitude and phase over the frequency (Bode diagram).
    """
    diagram = content if isinstance(content, Bode) else bode(content)
    model, transfers = diagram.model, diagram.transfer_functions
    poles = model.poles[model.poles.imag >= 0.0]
    # Adding zero changes -0 to 0.
    ratios = -poles.real / np.where(poles == 0.0, 1.0, np.abs(poles)) + 0.0
    columns = np.stack([poles.imag / (2.0 * np.pi), ratios, poles.real + 0.0], axis=1)
    is_decay = poles.imag == 0.0
    is_listed = (~is_decay & (np.cumsum(~is_decay) <= _MAX_VIBRATIONS)) | (poles.real > 0.0)
    is_listed |= is_decay & (np.cumsum(is_decay) <= _MAX_DECAYS)
    listed = np.flatnonzero(is_listed).tolist()
    rows = [[str(k + 1), *(f"{x:.6g}" for x in columns[k])] for k in listed]
    facts = {
        "about": model.about,
        "size": f"{format_count(len(model.states), 'state')}, "
        f"{format_count(len(model.inputs), 'input')}, "
        f"{format_count(len(model.outputs), 'output')}",
        "largest growth rate": f"{np.max(poles.real) + 0.0:.6g} 1/s" if len(poles) else "-",
    }
    if not is_listed.all():
        fastest = np.max(np.abs(poles[~is_listed]))
        facts["not listed"] = f"{np.sum(~is_listed)} poles, up to |p| = {fastest:.4g} 1/s"
    values = [
        [x.name, x.unit, "output", f"{y:.6g}"]
        for x, y in zip(model.outputs, model.output_values, strict=True)
    ]
    quantities = [*([x.name, x.unit, "input", "-"] for x in model.inputs), *values]
    import pandas as pd

    largest = [int(np.argmax(np.abs(x.response))) for x in transfers]
    table = pd.DataFrame(
        {
            "largest magnitude": [
                float(np.abs(x.response[k])) for x, k in zip(transfers, largest, strict=True)
            ],
            "at frequency [Hz]": diagram.frequencies[largest],
        }
    )
    curves = [
        {"family": model.inputs[x.input].name, "curves": _select_response(diagram, x)}
        for x in transfers
    ]
    return describe_page(
        title,
        f"{facts['size']}, {format_count(len(transfers), 'transfer function')}",
        diagram.warnings,
        [
            fact_table("Linear model", facts),
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
        ],
        time={"name": "frequency", "unit": "Hz", "log": True},
        noun="transfer functions",
        axes=None,
        columns=describe_columns("output / input", table),
        cases=create_cases(table, [x.name for x in transfers], *curves),
    )


def _select_response(diagram: Bode, x: TransferFunction) -> dict[str, Any] | None:
    """Return the curves of a transfer function; None if it is zero but for rounding errors."""
    if x.is_noise:
        return None
    return {
        "t": diagram.frequencies,
        "magnitude": {f"magnitude [{x.unit}]": np.abs(x.response)},
        "phase": {"phase [deg]": x.phase},
    }


_DATA_GROUP = "data"  # id of the group of experiments without a name
_BEST, _FIRST, _FEASIBLE, _INFEASIBLE = "best", "first", "within limits", "beyond a limit"
_OBJECTIVE, _VIOLATION = "objective", "violation"
# Numbers of more parameters, such as the heights of a beam, are in the table of parameters only.
_MAX_NUMBER_COLUMNS = 12


def build_fit_page(fit: Fit, title: str) -> Content:
    """Return the page content of a fit for `beamdae.report.page.page_file.write_page`."""
    runs, data = fit.solutions, fit.residual_table()
    groups = data.groupby(["experiment", "observable"], sort=False)
    sources = [(str(x), str(header), rows) for (x, header), rows in groups]
    columns = sum(len(run.columns) for run in runs.values()) + 2 * len(sources)
    limit = compute_row_limit(columns)
    cases: list[Content] = []
    for experiment, run in runs.items():
        cases.append(
            {
                "id": f"model {experiment}",
                "group": experiment or _DATA_GROUP,
                "label": "model",
                "family": "model",
                "curves": select_curves({TIME: run.t, **run.columns}, limit),
            }
        )
    for k, (experiment, header, rows) in enumerate(sources):
        sensor = fit.sensor_of(int(rows.index[0]))
        curve = {
            TIME: (rows[TIME].to_numpy() - sensor["shift"]) / sensor["clock"],
            header: (rows["value"].to_numpy() - sensor["offset"]) / sensor["scale"],
            _residual_header(header): rows["residual"].to_numpy(),
        }
        cases.append(
            {
                "id": f"data {k}",
                "group": experiment or _DATA_GROUP,
                "label": f"data of {header}",
                "family": "data",
                "points": True,
                "values": {
                    "count": len(rows),
                    "rms": float(np.sqrt(np.mean(rows["residual"] ** 2))),
                },
                "curves": select_curves(curve, limit),
            }
        )
    corrections = "data, corrected by the estimated properties of sensors"
    source = corrections if fit.sensors else "data as measured"
    description = describe(fit)
    facts = {**description.facts, **description.details, "points in the charts": source}
    return describe_page(
        title,
        fit.status.sentence,
        [*fit.warnings, *fit.undetermined],
        [
            fact_table("Fit", facts),
            *export_tables(description),
        ],
        made=next(iter(runs.values())).versions,
        groups=[
            {
                "id": experiment or _DATA_GROUP,
                "label": experiment or fit.model_name,
                "frames": export_run_frames(run, enlarges=True),
            }
            for experiment, run in runs.items()
        ],
        columns=[
            {"key": "count", "label": "number of data", "unit": "", "kind": "number"},
            {"key": "rms", "label": "rms residual", "unit": "sigma", "kind": "number"},
        ],
        axes=None,
        noun="curves",
        featured=list(dict.fromkeys(y for _, x, _ in sources for y in (x, _residual_header(x)))),
        cases=cases,
    )


def _residual_header(header: str) -> str:
    return f"residual of {remove_unit(header)} [sigma]"


def build_optimization_page(result: Optimization, title: str) -> Content:
    """Return the page content of an optimization for `write_page`.

    The cases are the evaluated designs; the first and the best one have a motion or a drawing.
    """
    with silenced():  # The optimization has issued them.
        of_model = result.mechanism().build_warnings
    history, best, units = result.history(), result.best_number, result.units
    labels: list[str] = []
    entries: list[Content] = []
    time: Content = {}
    for k, violation in enumerate(history[_VIOLATION], 1):
        family = _FEASIBLE if violation == 0.0 else _INFEASIBLE
        label, motion = f"design {k}", Content()
        if k in (1, best):
            family = _BEST if k == best else _FIRST
            label += f" ({'first and best' if best == 1 else family})"
            motion, axis = _export_design(result, k == best)
            time = axis if k == best else time
        labels.append(label)
        status = history["failure"].iloc[k - 1] or "ok"
        entries.append({"rank": k, "family": family, "status": status, **motion})
    table = history.drop(columns="failure")
    table.insert(0, "design", range(1, len(table) + 1))
    numbers = list(result.table().index)
    shown = table.drop(columns=numbers if len(numbers) > _MAX_NUMBER_COLUMNS else [])
    cases, description = create_cases(table, labels, *entries), describe(result)
    # The page opens on the first cases with curves.
    cases.sort(key=lambda x: (_BEST, _FIRST).index(x["family"]) if x.get("frames") else 2)
    return describe_page(
        title,
        result.status.sentence,
        list(dict.fromkeys([*result.warnings, *of_model])),
        [
            fact_table("Optimization", {"status": result.status.sentence, **description.facts}),
            *export_tables(description),
        ],
        groups=[{"id": GROUP, "label": result.model["name"]}],
        noun="designs",
        leads=True,
        columns=describe_columns("design", shown, units)[1:],
        axes={"x": "design", "y": _OBJECTIVE},
        families=[_BEST, _FIRST, _FEASIBLE, _INFEASIBLE],
        time=time,
        featured=_list_headers(result),
        cases=cases,
    )


def _list_headers(result: Optimization) -> list[str]:
    """Return the headers of the columns in the objective and the constraints."""
    observed: dict[str, str] = {}
    for analysis in result.analyses:
        for header in getattr(analysis, "columns", ()):
            observed |= {header: header, split_unit(header)[0]: header}
    return [observed.get(name, name) for name in result.columns]


def _export_design(result: Optimization, is_best: bool) -> tuple[Content, Content]:
    """Return frames and curves of a run, a path, a mode, or a drawing, and their time axis."""
    analyses = result.analyses if is_best else result.first_analyses
    run = next((x for x in analyses if isinstance(x, Solution)), None)
    path = next((x for x in analyses if isinstance(x, Equilibrium)), None)
    if run is not None:
        limit = compute_row_limit(2 * len(run.columns))
        curves = select_curves({TIME: run.t, **run.columns}, limit)
        return {"frames": export_run_frames(run, enlarges=True), "curves": curves}, {}
    if path is not None:
        page = build_path_page(path, "")
        entries = {"frames": page["groups"][0]["frames"], "curves": page["cases"][0]["curves"]}
        return entries, page["time"]
    if analyses:
        page = build_modes_page(analyses[0], "")
        return {"frames": next((x["frames"] for x in page["cases"]), None)}, page["time"]
    times = np.zeros(1)
    try:
        scene = build_scene(result.mechanism(is_best), reference_poses, times)
        return {"frames": export_frames(scene, times)}, {}
    except BeamdaeError:
        return {"frames": None}, {}  # There are no parts that can be drawn.
