"""Table 2: elements and CPU time until the tip deformation of the hub beam has converged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from hub_beam import hub_beam

import beamdae as bd
from pan_liu_2012.claims import NEAR
from pan_liu_2012.runs import PAPER_SCHEME, WITNESS, deviation, solved

DEFAULT = "curved, default"
FULL, REDUCED = "curved, paper's continuity, full", "curved, paper's continuity, reduced"
STRAIGHT, STRAIGHT_TWO_NODES = "straight, 4 nodes", "straight, 2 nodes"
CURVED = (DEFAULT, FULL, REDUCED)
ELEMENTS: dict[str, dict[str, object]] = {
    DEFAULT: {},
    FULL: {"continuity": "local", "quadrature": "full"},
    REDUCED: {"continuity": "local"},
    STRAIGHT: {"elements_shape": "straight"},
    STRAIGHT_TWO_NODES: {"elements_shape": "straight", "nodes": 2},
}
MESHES = {
    DEFAULT: (1, 2, 3, 4, 5, 6, 8),
    FULL: (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    REDUCED: (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    STRAIGHT: (4, 6, 8, 10, 12, 15, 16, 20, 24, 32, 48, 64),
    STRAIGHT_TWO_NODES: (8, 12, 15, 20, 24, 32, 36, 40, 64, 96),
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
    in place of Green's ((u' - v/R)^2 + (v' + u/R)^2)/2, and straight elements have none to leave
    out. Curved elements with Green's strain meet them.
    """
    beam = {"subtended": subtended, "shape": shape}
    coarse, fine = (tip(integrator, elements=n, **ELEMENTS[STRAIGHT], **beam) for n in (32, 64))
    return {
        "curved": tip(integrator, elements=24, **beam),
        "straight": fine + (fine - coarse) / 3.0,
        "green": tip(integrator, elements=24, strain="green", **beam),
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
    apart = {
        "curved against straight [-]": deviation(exact["curved"], exact["straight"]),
        "curved, Green's strain, against straight [-]": deviation(
            exact["green"], exact["straight"]
        ),
    }
    return {
        "table_2_errors": pd.DataFrame(lines),
        "table_2_limits": pd.DataFrame([key | apart]),
    }


def needed(curve: pd.DataFrame, criterion: float) -> float:
    """Smallest number of elements tried from which on every error is within the criterion."""
    ordered = curve.sort_values("number")
    beyond = ordered["number"][ordered["error [-]"] > criterion]
    within = (
        ordered["number"][ordered["number"] > beyond.max()] if len(beyond) else ordered["number"]
    )
    return float(within.min()) if len(within) else np.nan


def marked(curve: pd.DataFrame, criterion: float) -> str:
    """The number needed; both, '2 or 3', where an error is within five percent of the criterion."""
    strict, loose = (needed(curve, criterion * (1.0 + k * NEAR)) for k in (-1.0, 1.0))
    low, high = (f"{n:g}" if np.isfinite(n) else "more" for n in (loose, strict))
    return low if low == high else f"{low} or {high}"


def table(curves: pd.DataFrame) -> pd.DataFrame:
    """Elements needed by each criterion, beside the paper's numbers and our error with those."""
    lines = []
    for key, curve in curves.groupby(KEYS, sort=False):
        line = dict(zip(KEYS, key, strict=True))
        number, _ = PAPER[line["elements"].split(",")[0], line["subtended [deg]"]]
        at_paper = curve["error [-]"][curve["number"] == number]
        line |= {f"needed for {c:.1%}": needed(curve, c) for c in CRITERIA}
        line |= {f"needed for {c:.1%}, marked": marked(curve, c) for c in CRITERIA}
        line |= {"paper": number, "error with the paper's number [-]": float(at_paper.iloc[0])}
        lines.append(line)
    return pd.DataFrame(lines)


def times(repetitions: int = 5) -> pd.DataFrame:
    """Wall time of the paper's runs (its numbers of elements, its scheme) beside its CPU time.

    And of as many curved elements as it has straight ones. The least of several, taken in turns.
    """
    runs = [(*key, number, cpu) for key, (number, cpu) in PAPER.items()]
    runs += [("curved", angle, PAPER["straight", angle][0], np.nan) for angle in (30.0, 60.0)]
    schemes = (bd.GeneralizedAlpha(step=1e-3), bd.Ida(rtol=1e-5))
    kinds = {"curved": ELEMENTS[FULL], "straight": ELEMENTS[STRAIGHT]}
    measured: dict[tuple[str, float, int, float, Any], list[Any]] = {}
    for _ in range(repetitions):
        for kind, subtended, number, cpu in runs:
            for scheme in schemes:
                mechanism = hub_beam(elements=number, subtended=subtended, **kinds[kind])
                found = solved(mechanism, 2.0, 2e-3, scheme).statistics
                measured.setdefault((kind, subtended, number, cpu, scheme), []).append(found)
    lines = []
    for (kind, subtended, number, cpu, scheme), found in measured.items():
        wall = min(run.wall_time for run in found)
        lines.append(
            {
                "subtended [deg]": subtended,
                "elements": kind,
                "number": number,
                "integrator": scheme.label,
                "steps": found[0].steps,
                "residual calls": found[0].residual_calls,
                "paper CPU time, 2012 [s]": cpu,
                "wall time [s]": wall,
                "paper / wall": cpu / wall,
            }
        )
    return pd.DataFrame(lines).sort_values(["subtended [deg]", "number"], ignore_index=True)
