"""Facts and tables of results of analyses, which commands print and pages show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import format_count, format_distinct
from beamdae.model_parameters import format_with_unit
from beamdae.report.tables import (
    ERROR_DIGITS,
    ERROR_HEADER,
    column_extremes,
    format_headers,
    format_number,
    range_rows,
)

if TYPE_CHECKING:
    import pandas as pd

_PRINTED_MULTIPLIERS = 4
_RATE = "growth rate [1/s]"
# Overdamped vibrations of a damping time T decay at rates from 1 / T to 2 / T.
_DECAY_RANGE = 2.0
_SAME = ("kind", "moves")  # columns with equal values in merged rows


@dataclass(frozen=True)
class Description:
    """Words and numbers about a result.

    Attributes
    ----------
    facts
        Texts by topic.
    tables
        Tables by title: data frames, lists of rows by header, or lines of text for the terminal.
    data
        Function that returns the entries of the JSON document beside status and reason.
    details
        Facts that are shown on request.
    """

    facts: Mapping[str, str] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    data: Callable[[], Mapping[str, Any]] = dict
    details: Mapping[str, str] = field(default_factory=dict)


def describe(result: Any) -> Description:
    """Return the description of the result of an analysis."""
    description: Description = _DESCRIPTIONS[type(result).__name__](result)
    return description


def _table_of_modes(result: Any) -> pd.DataFrame:
    """Return the table of modes or buckling loads, with the errors that have been measured."""
    table = result.table()
    # Errors that take long are not measured.
    errors = vars(result).get("errors")
    if errors is not None and not np.isnan(errors.total).all():
        numbers = (int(x.split()[-2]) for x in errors.headers)  # as in "frequency 2 [Hz]"
        totals = dict(zip(numbers, errors.total.tolist(), strict=True))
        sizes = [float(f"{totals.get(k, np.nan):.{ERROR_DIGITS}g}") for k in table["mode"]]
        table.insert(2, ERROR_HEADER, sizes)
    return table


def _describe_loads(stages: Sequence[Sequence[str]], mechanism: Any) -> str:
    """Return the scaled loads of each stage, and the loads that act in full."""
    from beamdae.analysis.statics.load_scaling import resolve_load_stages

    loads = [] if mechanism is None else sum(resolve_load_stages(mechanism, None), ())
    constant = ", ".join(x for x in loads if not any(x in stage for stage in stages))
    scaled = "; then ".join(map(", ".join, stages)) or "none is scaled"
    return f"{scaled}; in full: {constant}" if constant else scaled


def _describe_modes(modes: Any) -> Description:
    table = _table_of_modes(modes)
    last = [name for name in map(str, table) if name.startswith(("growth rate", "effective mass"))]
    shown = table[[*(name for name in table if name not in last), *last]]
    data = {"about": modes.about, "modes": modes.table()}
    return Description({"about": modes.about}, {"Modes": _merge_decays(shown)}, lambda: data)


def _merge_decays(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with one row for overdamped vibrations of a part by one damping time."""
    import pandas as pd

    blocks: list[list[dict[Any, Any]]] = []
    for row in table.to_dict("records"):
        first = blocks[-1][0] if blocks else {}
        is_similar = row["kind"] == "decay" and all(row[x] == first.get(x) for x in _SAME)
        if is_similar and row[_RATE] >= _DECAY_RANGE * first[_RATE]:
            blocks[-1].append(row)
        else:
            blocks.append([row])
    for rows in (x for x in blocks if len(x) > 1):
        for name in rows[0]:
            values = [row[name] for row in rows]
            if name in ("mode", _RATE):
                ends = dict.fromkeys(format_number(x, 5) for x in (values[0], values[-1]))
                rows[0][name] = " to ".join(ends)
            elif name not in _SAME:
                total = sum if name.startswith("effective mass") else max
                rows[0][name] = total(values)
    return pd.DataFrame([rows[0] for rows in blocks], columns=table.columns)


def _describe_buckling(buckling: Any) -> Description:
    table = _table_of_modes(buckling)
    data = {"loads": list(buckling.loads), "modes": buckling.table()}
    facts = {"loads": _describe_loads([buckling.loads], buckling.mechanism)}
    if buckling.reason:
        facts["buckling loads"] = f"none; {buckling.reason}"
    return Description(facts, {"Buckling": table}, lambda: data)


def _describe_campbell(diagram: Any) -> Description:
    table, resonances = diagram.table(), diagram.resonances()
    speed, speeds = f"speed [{diagram.speed_unit}]", diagram.speeds / diagram.speed_factor
    frequencies = table.filter(regex=r"\[Hz\]$")
    frequencies.insert(0, speed, speeds)
    shown = resonances.rename(columns={"multiple": "excitations per revolution"})
    shown.insert(0, speed, shown.pop("speed [rad/s]") / diagram.speed_factor)
    return Description(
        {},
        {"Frequencies": frequencies, "Resonances": shown},
        lambda: {"about": "rotations", "speeds": table, "resonances": resonances},
    )


def _describe_bode(diagram: Any) -> Description:
    peaks, linear = diagram.peak_table(), diagram.model
    first, last = diagram.frequencies[[0, -1]].tolist()
    facts = {
        "about": linear.about,
        "states": str(len(linear.states)),
        "frequencies": f"{len(diagram.frequencies)}, {first:.4g} to {last:.4g} Hz",
    }
    return Description(
        facts,
        {"Peaks": peaks},
        lambda: {"about": linear.about, "response": diagram.table(), "peaks": peaks},
    )


def _describe_motion(motion: Any) -> Description:
    amplitudes = motion.amplitudes()
    moduli = [f"{abs(x):.6g}" for x in motion.multipliers[:_PRINTED_MULTIPLIERS].tolist()]
    facts = {
        "period": f"{motion.period:.8g} s",
        "stability": motion.stability,
        "multipliers": f"largest moduli {', '.join(moduli)}" if moduli else "none",
    }
    return Description(
        facts,
        {"Amplitudes": amplitudes.drop(columns="unit").rename_axis("observed").reset_index()},
        lambda: {
            "period": motion.period,
            "stable": motion.stable,
            "stability": motion.stability,
            "multipliers": [[x.real, x.imag] for x in motion.multipliers.tolist()],
            "observed": amplitudes.to_dict("index"),
        },
    )


def _describe_response(response: Any) -> Description:
    values, peaks = [point.parameter for point in response.points], response.peak_table()
    n_unstable = sum(not point.stable for point in response.points)
    span = f", {response.parameter} {min(values):.6g} to {max(values):.6g}" if values else ""
    span += f" {response.unit}" if values and response.unit else ""
    shown = peaks.assign(peak=True)
    for name in response.varying_columns:
        if name not in set(peaks["observed"]):
            parameters, sizes = response.curve(name)
            k = int(np.argmax(sizes))
            magnitude = response._sizes(name)[1][k]
            shown.loc[len(shown)] = [name, parameters[k], sizes[k], magnitude, False]
    return Description(
        {
            "curve": f"{format_count(len(values), 'point')}{span}",
            "unstable": f"{n_unstable} of {len(values)} points",
            "critical points": "; ".join(
                f"{kind} at {format_with_unit(float(f'{value:.6g}'), response.unit)}"
                for kind, value in response.critical_points
            )
            or "none",
        },
        {"Peaks": shown.rename(columns={response.parameter: response.label})},
        lambda: {
            "points": response.table(),
            "folds": response.folds,
            "critical points": response.critical_points,
            "peaks": peaks,
        },
    )


def _describe_path(path: Any) -> Description:
    n_unstable = int(path.unstable[-1])
    if n_unstable == -1:
        stability = "not known"
    elif n_unstable > 0:
        stability = f"unstable in {format_count(n_unstable, 'direction')}"
    elif path.free:
        stability = f"neither stable nor unstable, {path.free} is free to move"
    else:
        stability = "stable"
    control = path.settings["control"]
    if path.over and control == "load":
        control = path.settings["over"]
    begin = path.factors[0, -1:].tolist()
    facts = {
        "loads": _describe_loads(path.loads, path.equations.mechanism),
        # Paths of mechanisms that are free without loads begin at some load.
        path.quantity: " to ".join(f"{x:.7g}" for x in dict.fromkeys([*begin, path.factor])),
        "equilibrium": stability,
        "critical points": "; ".join(
            f"{x.description} at {x.factor:.7g}{f', {x.moves} moves most' if x.moves else ''}"
            for x in path.critical
        )
        or "none",
    }
    details = {
        "path": f"{format_count(len(path.q), 'point')}, {path.settings['iterations']} Newton "
        f"iterations, {control} control"
    }

    def create_data() -> dict[str, Any]:
        errors = dict(zip(path.errors.headers, path.errors.total.tolist(), strict=True))
        data = path.metadata(**{"relative errors": errors})
        del data["warnings"]
        return data | {"points": len(path.q), "observed": column_extremes(path.columns)}

    from beamdae.results.equilibrium import UNSTABLE

    # Errors that take long are not measured.
    rows = range_rows(path.columns, vars(path).get("errors"))
    rows = [x for x in rows if x["observed"] != UNSTABLE]
    return Description(facts, {"Observed": rows}, create_data, details)


def _describe_fit(fit: Any) -> Description:
    interval = (
        "normal distribution, sigma is known"
        if fit.is_sigma_known
        else f"t distribution with {fit.degrees_of_freedom} degrees of freedom, sigma is estimated"
    )
    if not fit.status.success:
        interval = "none, because the search did not reach a minimum"
    facts = {
        "chi-square": fit.describe_chi_square(),
        "sigma": ", ".join(f"{name} {value:.4g}" for name, value in fit.sigma.items()),
        "searches": fit.describe_starts(),
        "at a bound": ", ".join(fit.at_bounds),
    }
    details = {
        "intervals": interval,
        "data": f"{fit.residuals.size} in {format_count(len(fit.solutions), 'experiment')}",
        "runs": f"{fit.evaluations} with derivatives of each experiment",
    }
    table = fit.table()
    estimates = table.rename(index=format_headers(fit.units)).rename_axis("estimate")
    limits = ["value", "lower 95 %", "upper 95 %"]
    texts = [format_distinct(*row, digits=5) for row in table[limits].to_numpy()]
    estimates[limits] = [[x.replace("nan", "-") for x in row] for row in texts]
    searches = _tabulate_searches(fit.starts, fit.units, "chi-square", "runs")
    return Description(
        {topic: text for topic, text in facts.items() if text},
        {"Estimates": estimates.reset_index(), **searches},
        lambda: {
            "estimates": table.assign(unit=list(fit.units.values())).to_dict("index"),
            "chi-square": fit.chi_square,
            "degrees of freedom": fit.degrees_of_freedom,
            "probability of a larger chi-square": fit.probability,
            "sigma": dict(fit.sigma),
            "evaluations": fit.evaluations,
            "searches": fit.starts,
            "undetermined": list(fit.undetermined),
            "at bounds": list(fit.at_bounds),
        },
        details,
    )


def _describe_optimization(result: Any) -> Description:
    history, design, units = result.history(), result.table(), result.units
    failures = int((history["failure"] != "").sum())
    first = format_with_unit(float(f"{history['objective'].iloc[0]:.6g}"), units["objective"])
    facts = {
        "objective": f"{result.objective_label} = {result.objective_text}, first {first}",
        "designs": f"{result.evaluations} of at most {result.max_evaluations}"
        + (f", {failures} failed" if failures else ""),
        "searches": result.describe_starts(),
        "at a bound": "; ".join(result.bound_notes) or "none",
    }
    constraints = [
        {
            "constraint": format_with_unit(x.name, x.unit),
            "value": x.value,
            "limit": x.limit,
            "margin [%]": 100.0 * x.relative_margin,
            "multiplier": x.multiplier,
        }
        for x in result.constraints
    ]
    headers = format_headers({str(name): units.get(str(name), "") for name in design.index})
    names = ["value", "first value", "lower bound", "upper bound", "at bound"]
    parameters = design[names].rename(index=headers).rename_axis("parameter")
    of_design = {str(name): units[str(name)] for name in design.index}
    searches = _tabulate_searches(result.starts, of_design, "objective", "designs")
    return Description(
        {topic: text for topic, text in facts.items() if text},
        {
            "Parameters": parameters.reset_index(),
            **({"Constraints": constraints} if constraints else {}),
            **({"Observed": range_rows(result.observed)} if result.observed else {}),
            **searches,
        },
        lambda: {
            "objective": result.objective,
            "parameters": dict(design["value"]),
            "constraints": result.constraint_table(),
            "observed": column_extremes(result.observed),
            "evaluations": result.evaluations,
            "at bounds": list(result.at_bounds),
            "searches": result.starts,
        },
    )


def _tabulate_searches(
    table: pd.DataFrame | None, units: Mapping[str, str], goal: str, cost: str
) -> dict[str, pd.DataFrame]:
    """Return the table of the searches of a fit or an optimization by its title, if there is one.

    Parameters
    ----------
    table
        Searches, with columns "first NAME", `goal`, "evaluations" and NAME.
    units
        Units of the varied numbers.
    goal, cost
        What a search minimizes, and the header of its evaluations.
    """
    if table is None:
        return {}
    last = [name for name in units if name in table]
    first = [f"first {name}" for name in units if f"first {name}" in table]
    shown = table[[goal, "reason", *last, *first, "evaluations"]]
    shown = shown.rename(columns=format_headers(units) | {"evaluations": cost, "reason": "end"})
    shown.insert(0, "search", range(1, len(table) + 1))
    return {"Searches": shown}


# By the name of the class, so that no analysis is imported that is not described.
_DESCRIPTIONS: Mapping[str, Callable[[Any], Description]] = {
    "Bode": _describe_bode,
    "Buckling": _describe_buckling,
    "Campbell": _describe_campbell,
    "Equilibrium": _describe_path,
    "Fit": _describe_fit,
    "FrequencyResponse": _describe_response,
    "Modes": _describe_modes,
    "Optimization": _describe_optimization,
    "PeriodicMotion": _describe_motion,
}
