"""Table 2: elements and CPU time until the tip deformation of the hub beam has converged."""

from __future__ import annotations

import numpy as np
import pandas as pd
from hub_beam import hub_beam

import beamdae as bd
from pan_liu_2012.claims import OPEN, Judgement, Tables, agrees, claim
from pan_liu_2012.runs import PAPER_SCHEME, WITNESS, deviation, solved

ELEMENTS = {
    "curved": {},
    "curved, paper, full quadrature": {"continuity": "local", "quadrature": "full"},
    "curved, paper, reduced quadrature": {"continuity": "local"},
    "straight, 4 nodes": {"elements_shape": "straight"},
    "straight, 2 nodes": {"elements_shape": "straight", "nodes": 2},
}
MESHES = {
    "curved": (1, 2, 3, 4, 5, 6, 8),
    "curved, paper, full quadrature": (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    "curved, paper, reduced quadrature": (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    "straight, 4 nodes": (4, 6, 8, 10, 12, 15, 16, 20, 24, 32, 48, 64),
    "straight, 2 nodes": (8, 12, 15, 20, 24, 32, 36, 40, 64, 96),
}
INTEGRATORS = {"generalized-alpha, 1e-3 s": PAPER_SCHEME, "IDA, rtol 1e-6": WITNESS}
BEAMS = [(subtended, shape) for subtended in (30.0, 60.0) for shape in ("circular", "parabolic")]
CRITERIA = (0.01, 0.001)
# Table 2 of the paper, and its text: 6 curved elements at 60 degrees.
PAPER = {
    ("curved", 30.0): (4, 6.0),
    ("straight", 30.0): (15, 70.0),
    ("curved", 60.0): (8, 12.0),
    ("straight", 60.0): (20, 80.0),
}
COLUMNS = ["deformation.u [m]", "deformation.v [m]"]
KEYS = ["integrator", "subtended [deg]", "shape", "elements"]


def tip(integrator: str, rows: float = 4e-3, **parameters: object) -> np.ndarray:
    """Deformation (u, v) of the tip over the 2 s."""
    method = INTEGRATORS[integrator]
    return solved(hub_beam(**parameters), 2.0, rows, method).observed[COLUMNS].to_numpy()


def limits(integrator: str, subtended: float, shape: str) -> dict[str, np.ndarray]:
    """Tip deformation of ever finer meshes: 24 curved elements, and straight ones extrapolated.

    The two differ a little: the quadratic part of eq. (5) leaves the curvature out, (u'^2 + v'^2)/2
    in place of ((u' - v/R)^2 + (v' + u/R)^2)/2, and straight elements have none to leave out.
    """
    beam = {"subtended": subtended, "shape": shape}
    coarse, fine = (
        tip(integrator, elements=n, **ELEMENTS["straight, 4 nodes"], **beam) for n in (32, 64)
    )
    return {
        "curved": tip(integrator, elements=24, **beam),
        "straight": fine + (fine - coarse) / 3.0,
    }


def errors(
    integrator: str,
    subtended: float,
    shape: str,
    names: tuple[str, ...] = tuple(ELEMENTS),
    meshes: tuple[int, ...] | None = None,
) -> dict[str, pd.DataFrame]:
    """Largest error of the tip deformation over its amplitude, by element type and their number.

    Against the limit of curved or straight elements by the same integrator: no error in time.
    """
    beam = {"subtended": subtended, "shape": shape}
    exact = limits(integrator, **beam)
    key = {"integrator": integrator, "subtended [deg]": subtended, "shape": shape}
    lines = []
    for name in names:
        for n in meshes or MESHES[name]:
            found = tip(integrator, elements=n, **ELEMENTS[name], **beam)
            error = deviation(found, exact[name.split(",")[0]])
            lines.append({**key, "elements": name, "number": n, "error [-]": error})
    apart = deviation(exact["curved"], exact["straight"])
    return {
        "table_2_errors": pd.DataFrame(lines),
        "table_2_limits": pd.DataFrame([{**key, "curved against straight [-]": apart}]),
    }


def needed(curve: pd.DataFrame, criterion: float) -> float:
    """Smallest number of elements tried from which on every error is within the criterion."""
    ordered = curve.sort_values("number")
    beyond = ordered["number"][ordered["error [-]"] > criterion]
    within = (
        ordered["number"][ordered["number"] > beyond.max()] if len(beyond) else ordered["number"]
    )
    return float(within.min()) if len(within) else np.nan


def table(curves: pd.DataFrame) -> pd.DataFrame:
    """Elements needed by each criterion, beside the paper's numbers and our error with those."""
    lines = []
    for key, curve in curves.groupby(KEYS, sort=False):
        line = dict(zip(KEYS, key, strict=True))
        number, _ = PAPER[line["elements"].split(",")[0], line["subtended [deg]"]]
        at_paper = curve["error [-]"][curve["number"] == number]
        line |= {f"needed for {c:.1%}": needed(curve, c) for c in CRITERIA}
        line |= {"paper": number, "error with the paper's number [-]": float(at_paper.iloc[0])}
        lines.append(line)
    return pd.DataFrame(lines)


def times(repetitions: int = 3) -> pd.DataFrame:
    """Wall time of the paper's runs (its numbers of elements, its scheme) beside its CPU time."""
    kinds = {
        "curved": ELEMENTS["curved, paper, full quadrature"],
        "straight": ELEMENTS["straight, 4 nodes"],
    }
    lines = []
    for (kind, subtended), (number, cpu) in PAPER.items():
        parameters = {"elements": number, "subtended": subtended, **kinds[kind]}
        for integrator in (bd.GeneralizedAlpha(step=1e-3), bd.Ida(rtol=1e-5)):
            runs = [
                solved(hub_beam(**parameters), 2.0, 2e-3, integrator).statistics
                for _ in range(repetitions)
            ]
            wall = float(np.median([run.wall_time for run in runs]))
            lines.append(
                {
                    "subtended [deg]": subtended,
                    "elements": kind,
                    "number": number,
                    "integrator": integrator.label,
                    "steps": runs[0].steps,
                    "residual calls": runs[0].residual_calls,
                    "paper CPU time, 2012 [s]": cpu,
                    "wall time [s]": wall,
                    "paper / wall": cpu / wall,
                }
            )
    return pd.DataFrame(lines).sort_values(["subtended [deg]", "number"], ignore_index=True)


DEFAULT, PRINTED = "curved", "curved, paper, full quadrature"
STRAIGHT, LINEAR_STRAIGHT = "straight, 4 nodes", "straight, 2 nodes"


def numbers_needed(
    tables: Tables, elements: str, criterion: float
) -> dict[tuple[float, str], float]:
    """Elements needed with the paper's scheme, by subtended angle and shape."""
    table = tables["table_2"]
    rows = table[table["integrator"].str.startswith("gen") & (table["elements"] == elements)]
    keys = zip(rows["subtended [deg]"], rows["shape"], strict=True)
    return dict(zip(keys, rows[f"needed for {criterion:.1%}"], strict=True))


def error_of(tables: Tables, elements: str, subtended: float, number: int) -> float:
    """Error of the circular beam with the paper's scheme."""
    table = tables["table_2_errors"]
    row = table[
        table["integrator"].str.startswith("gen")
        & (table["shape"] == "circular")
        & (table["elements"] == elements)
        & (table["subtended [deg]"] == subtended)
        & (table["number"] == number)
    ]
    return float(row["error [-]"].iloc[0])


@claim(
    "4 curved elements (30 degrees) and 6 (60 degrees) converge",
    "text, Table 2",
    "4; 6 in the text, 8 in the table",
)
def curved_elements(tables: Tables) -> Judgement:
    one = numbers_needed(tables, DEFAULT, 0.01)
    printed = [error_of(tables, PRINTED, *key) for key in ((30.0, 4), (60.0, 6), (60.0, 8))]
    ours = (
        f"1 %: {one[30.0, 'circular']:g} and {one[60.0, 'circular']:g} with the default elements; "
        f"as printed (full quadrature), error {printed[0]:.2%} with 4, {printed[1]:.2%} with 6, "
        f"{printed[2]:.2%} with 8"
    )
    enough = max(one.values()) <= 4 and max(printed) < 0.015
    return Judgement(ours, agrees(enough), "the criterion is not stated; about 1 % fits")


@claim(
    "At least 15 (30 degrees) and 20 (60 degrees) straight ones are needed",
    "text, Table 2",
    "15; 20",
)
def straight_elements(tables: Tables) -> Judgement:
    parts = []
    for name in (STRAIGHT, LINEAR_STRAIGHT):
        one = numbers_needed(tables, name, 0.01)
        at = error_of(tables, name, 30.0, 15), error_of(tables, name, 60.0, 20)
        parts.append(
            f"{name}: {one[30.0, 'circular']:g} and {one[60.0, 'circular']:g} for 1 %, "
            f"error {at[0]:.2%} with 15, {at[1]:.2%} with 20"
        )
    return Judgement(
        "; ".join(parts), OPEN, "neither the element nor the criterion is stated, none gives both"
    )


@claim(
    "The curved element is more efficient than the straight one",
    "conclusions, Table 2",
    "4 of 15 = 0.27; 8 of 20 = 0.40",
)
def a_third(tables: Tables) -> Judgement:
    ratios = [
        curved / numbers_needed(tables, STRAIGHT, criterion)[beam]
        for criterion in CRITERIA
        for beam, curved in numbers_needed(tables, DEFAULT, criterion).items()
    ]
    # A criterion that no straight mesh tried has met counts as one that needs still more.
    worst = float(np.nanmax(ratios))
    return Judgement(
        f"at most {worst:.2f} over both angles, shapes and criteria (1 %, 0.1 %)",
        agrees(worst <= 1.0 / 3.0),
        "ratio of the elements needed for equal error, default curved against straight 4-node",
    )


@claim(
    "The beam with the larger curvature needs more elements",
    "text, Table 2",
    "4 to 6 or 8; 15 to 20",
)
def more_curvature(tables: Tables) -> Judgement:
    parts, found = [], {}
    for name in (PRINTED, STRAIGHT, LINEAR_STRAIGHT):
        one = numbers_needed(tables, name, 0.01)
        found[name] = one[30.0, "circular"], one[60.0, "circular"]
        parts.append(f"{name}: {found[name][0]:g}, {found[name][1]:g}")
    more = all(found[name][1] > found[name][0] for name in (PRINTED, STRAIGHT))
    return Judgement(
        "; ".join(parts),
        agrees(more),
        "elements needed for 1 % at 30, 60 degrees; the error of straight elements with 2 nodes is "
        "set by their linear shape functions, not by the curvature",
    )


@claim(
    "The formulation serves circular and parabolic beams",
    "title, eqs. 25, 26",
    "-",
)
def both_shapes(tables: Tables) -> Judgement:
    parts, alike = [], True
    for criterion in CRITERIA:
        found = numbers_needed(tables, DEFAULT, criterion)
        for angle in (30.0, 60.0):
            pair = found[angle, "circular"], found[angle, "parabolic"]
            parts.append(f"{criterion:.1%}, {angle:g} degrees: {pair[0]:g}, {pair[1]:g}")
            alike &= abs(pair[0] - pair[1]) <= 1
    return Judgement("; ".join(parts), agrees(alike), "elements needed: circular, parabolic")


@claim(
    "Curved elements save computing time",
    "Table 2",
    "6 s against 70 s; 12 s against 80 s",
)
def computing_time(tables: Tables) -> Judgement:
    times = tables["table_2_times"]
    times = times[times["integrator"].str.startswith("Gen")]
    wall = times.set_index(["subtended [deg]", "elements"])["wall time [s]"]
    save = {angle: wall[angle, "straight"] / wall[angle, "curved"] for angle in (30.0, 60.0)}
    faster = times["paper / wall"].min()
    return Judgement(
        f"{save[30.0]:.1f} and {save[60.0]:.1f} times as fast; all four runs at least {faster:.0f} "
        "times as fast as the paper's",
        agrees(min(save.values()) > 1.0),
        "the same numbers of elements and the same scheme; here an element costs little beside a "
        "step, so fewer of them save less",
    )


CLAIMS = (
    curved_elements,
    straight_elements,
    a_third,
    more_curvature,
    both_shapes,
    computing_time,
)
