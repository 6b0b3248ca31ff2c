"""Order of convergence of each formulation, of cantilevers bent by a force and a moment.

    python validation/formulations/orders.py

Straight, an arc, a parabola and a curve with an inflection, 1 m long, bent by about a radian. What
has Reissner's strains is compared with a solution by shooting; strains of moderate rotations get a
fifth of the loads, and are compared with their own solution by 128 elements. Errors of energy, of
the tip's displacement and of the moment at 15 sections, relative to the energy, the displacement
and the largest moment.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import pandas as pd

import beamdae as bd
from beamdae.equations.measures import balance_rows
from formulations.shooting import CantileverSolution, solve_cantilever

Array = np.ndarray

TABLE = Path(__file__).parent / "results" / "orders.csv"
SECTION = bd.Section.rectangle(bd.Material(E=1e7, nu=0.3, rho=1e3), width=1.0, height=0.01)
FORCE, MOMENT = 1.5 * SECTION.EI, 0.5 * SECTION.EI
CURVES = {
    "straight": bd.Line((0.0, 0.0), (1.0, 0.0)),
    "arc": bd.Arc(radius=0.8, length=1.0),
    "parabola": bd.Parabola(span=0.9, rise=-0.2),
    "inflection": bd.Curve(lambda x: 0.1 * np.sin(2.0 * np.pi * x), x=(0.0, 0.9)),
}
EXACT = {"formulation": "exact"}
FORMULATIONS: dict[str, dict[str, Any]] = {
    "exact": EXACT,
    "exact, full": EXACT | {"quadrature": "full"},
    "exact, 3 nodes": EXACT | {"nodes": 3},
    "exact, 2 nodes": EXACT | {"nodes": 2},
    "frame, exact strain": {"strain": "exact"},
    "frame, green": {"strain": "green"},
    "frame, nonlinear": {"strain": "nonlinear", "frame": "tangent"},
    "frame, nonlinear, local": {"strain": "nonlinear", "frame": "tangent", "continuity": "local"},
}
ELEMENTS = (4, 8, 16, 32)
FINEST = 128
QUANTITIES = ("energy", "tip", "moment")
# Where moments are looked at: so far along these parts of the length, in the same places of an
# element whatever the mesh.
LENGTH_FRACTIONS, ELEMENT_POSITIONS = (
    np.array([0.0, 0.25, 0.5, 0.75, 1.0]),
    np.array([0.07, 0.5, 0.9]),
)
POSITIONS = {
    n: np.ravel((np.minimum(LENGTH_FRACTIONS * n, n - 1)[:, None] + ELEMENT_POSITIONS) / n).tolist()
    for n in ELEMENTS
}
ALL_POSITIONS = sorted({share for shares in POSITIONS.values() for share in shares})


def is_exact(words: Mapping[str, Any]) -> bool:
    """Whether a formulation has Reissner's strains."""
    return "exact" in words.values()


def end_loads(words: Mapping[str, Any]) -> tuple[tuple[float, float], float]:
    """Force and moment of the end."""
    share = 1.0 if is_exact(words) else 0.2
    return (0.0, share * FORCE), share * MOMENT


def _cantilever(curve: Any, elements: int, words: Mapping[str, Any]) -> bd.Mechanism:
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", curve, SECTION, elements, **words))
    mech.add(bd.Weld("clamp", mech.ground.at(*curve.point(0.0)), beam.start))
    force, moment = end_loads(words)
    mech.add(bd.Force("force", beam.end, force))
    mech.add(bd.Moment("moment", beam.end, moment))
    mech.observe("tip", beam.end)
    for k, share in enumerate(ALL_POSITIONS):
        mech.observe(f"at {k}", beam.section_forces(share * curve.length))
    return mech


def solve_equilibrium(curve: Any, elements: int, words: Mapping[str, Any]) -> CantileverSolution:
    """The cantilever by so many elements."""
    with warnings.catch_warnings():
        # Of coarse meshes, and that it bends farther than strains of moderate rotations reach.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        found = bd.equilibrium(_cantilever(curve, elements, words))
    assert found.status.success, found.status.sentence
    columns = found.columns
    tip = [columns[f"tip.{name}"][-1] for name in ("x [m]", "y [m]", "angle [rad]")]
    q, still = found.q[-1:], np.zeros((1, found.q.shape[1]))
    books = balance_rows(found.equations)(np.zeros((1, 2)), q, still, still, found.lam[-1:])
    moments = [columns[f"at {k}.M [N m]"][-1] for k in range(len(ALL_POSITIONS))]
    return CantileverSolution(np.array(tip), float(books[0, 1]), np.array(moments))


@cache
def reference_solution(curve: str, formulation: str) -> CantileverSolution:
    """What a formulation converges to: Reissner's beam, or its own."""
    words, axis = FORMULATIONS[formulation], CURVES[curve]
    if not is_exact(words):
        return solve_equilibrium(axis, FINEST, words)
    found = solve_cantilever(
        axis, SECTION, *end_loads(words), np.append(ALL_POSITIONS, 1.0) * axis.length
    )
    return found._replace(moments=found.moments[:-1])


def relative_errors(curve: str, formulation: str, elements: int) -> tuple[float, float, float]:
    """Of energy, tip and moment, relative."""
    right, axis = reference_solution(curve, formulation), CURVES[curve]
    ours = solve_equilibrium(axis, elements, FORMULATIONS[formulation])
    own = np.searchsorted(ALL_POSITIONS, POSITIONS[elements])
    moved = np.linalg.norm(right.tip[:2] - axis.point(axis.length))
    return (
        abs(ours.energy - right.energy) / right.energy,
        float(np.linalg.norm((ours.tip - right.tip)[:2]) / moved),
        float(np.max(np.abs(ours.moments - right.moments)[own]) / np.max(np.abs(right.moments))),
    )


def fit_order(found: Array) -> float:
    """Slope over the finer meshes, down to where rounding begins."""
    x, y = np.log(ELEMENTS), np.log(np.maximum(found, 1e-300))
    good = np.asarray(found) > 3e-11
    last = np.flatnonzero(good)[-3:]
    return float(-np.polyfit(x[last], y[last], 1)[0]) if len(last) > 1 else float("nan")


def tabulate(curve: str, formulation: str) -> list[dict[str, Any]]:
    """A row for each quantity: errors by number of elements, and the order."""
    found = np.array([relative_errors(curve, formulation, n) for n in ELEMENTS]).T
    return [
        {
            "curve": curve,
            "formulation": formulation,
            "quantity": quantity,
            **{f"{n} elements": f"{e:.1e}" for n, e in zip(ELEMENTS, own, strict=True)},
            "order": f"{fit_order(own):.1f}",
        }
        for quantity, own in zip(QUANTITIES, found, strict=True)
    ]


def main() -> None:
    table = pd.DataFrame([row for c in CURVES for f in FORMULATIONS for row in tabulate(c, f)])
    table.to_csv(TABLE, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
