"""Orders of convergence of the beam formulations for cantilevers under a force and a moment.

    python validation/formulations/orders.py

The axes are a straight line, an arc, a parabola and a curve with an inflection, all about 1 m long;
the loads bend them by about one radian. Formulations with Reissner's strains are compared with a
solution by shooting. Strains for moderate rotations are tested with a fifth of the loads, and
compared with a solution of the same formulation with 128 elements. The table lists errors of the
energy, of the tip displacement and of the moment (largest error at 15 sections), relative to the
energy, the displacement and the largest moment.
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
from beamdae.equations.measures import BalanceRows
from formulations.shooting import CantileverSolution, solve_cantilever

Array = np.ndarray

TABLE = Path(__file__).parent / "results" / "orders.csv"
SECTION = bd.Section.rectangle(bd.Material(E=1e7, nu=0.3, rho=1e3), width=1.0, height=0.01)
FORCE = 1.5 * SECTION.EI  # [N]
MOMENT = 0.5 * SECTION.EI  # [N m]
# Factor of the loads for strains that assume moderate rotations.
MODERATE_LOAD_FACTOR = 0.2
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
REFERENCE_ELEMENTS = 128  # of formulations that do not converge to Reissner's beam
# Smallest relative error that is not dominated by rounding.
ROUNDING_LEVEL = 3e-11
QUANTITIES = ("energy", "tip", "moment")
# Moments are compared in the elements at these fractions of the length, and in each of them at the
# same relative positions in every mesh.
LENGTH_FRACTIONS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
ELEMENT_POSITIONS = np.array([0.07, 0.5, 0.9])
POSITIONS = {
    n: np.ravel((np.minimum(LENGTH_FRACTIONS * n, n - 1)[:, None] + ELEMENT_POSITIONS) / n).tolist()
    for n in ELEMENTS
}
ALL_POSITIONS = sorted({position for positions in POSITIONS.values() for position in positions})


def is_exact(settings: Mapping[str, Any]) -> bool:
    """Return True for formulations with Reissner's strains."""
    return "exact" in settings.values()


def end_loads(settings: Mapping[str, Any]) -> tuple[tuple[float, float], float]:
    """Return force [N] and moment [N m] at the end."""
    factor = 1.0 if is_exact(settings) else MODERATE_LOAD_FACTOR
    return (0.0, factor * FORCE), factor * MOMENT


def _cantilever(curve: Any, elements: int, settings: Mapping[str, Any]) -> bd.Mechanism:
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", curve, SECTION, elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(*curve.point(0.0)), beam.start))
    force, moment = end_loads(settings)
    mech.add(bd.Force("force", beam.end, force))
    mech.add(bd.Moment("moment", beam.end, moment))
    mech.observe("tip", beam.end)
    for k, position in enumerate(ALL_POSITIONS):
        mech.observe(f"at {k}", beam.section_forces(position * curve.length))
    return mech


def solve_equilibrium(curve: Any, elements: int, settings: Mapping[str, Any]) -> CantileverSolution:
    """Return the equilibrium of the cantilever with the given mesh and formulation."""
    with warnings.catch_warnings():
        # Warnings about coarse meshes, and about rotations beyond the range of moderate strains.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        equilibrium = bd.equilibrium(_cantilever(curve, elements, settings))
    assert equilibrium.status.success, equilibrium.status.sentence
    columns = equilibrium.columns
    tip = [columns[f"tip.{name}"][-1] for name in ("x [m]", "y [m]", "angle [rad]")]
    q, zero = equilibrium.q[-1:], np.zeros((1, equilibrium.q.shape[1]))
    energies = BalanceRows(equilibrium.equations)(
        np.zeros((1, 2)), q, zero, zero, equilibrium.lam[-1:]
    )
    moments = [columns[f"at {k}.M [N m]"][-1] for k in range(len(ALL_POSITIONS))]
    return CantileverSolution(np.array(tip), float(energies[0, 1]), np.array(moments))


@cache
def reference_solution(curve: str, formulation: str) -> CantileverSolution:
    """Return the limit of a formulation: Reissner's beam, or its own on the finest mesh."""
    settings, axis = FORMULATIONS[formulation], CURVES[curve]
    if not is_exact(settings):
        return solve_equilibrium(axis, REFERENCE_ELEMENTS, settings)
    solution = solve_cantilever(
        axis, SECTION, *end_loads(settings), np.append(ALL_POSITIONS, 1.0) * axis.length
    )
    return solution._replace(moments=solution.moments[:-1])


def relative_errors(curve: str, formulation: str, elements: int) -> tuple[float, float, float]:
    """Return the relative errors of energy, tip and moment."""
    reference, axis = reference_solution(curve, formulation), CURVES[curve]
    computed = solve_equilibrium(axis, elements, FORMULATIONS[formulation])
    rows = np.searchsorted(ALL_POSITIONS, POSITIONS[elements])
    displacement = np.linalg.norm(reference.tip[:2] - axis.point(axis.length))
    return (
        abs(computed.energy - reference.energy) / reference.energy,
        float(np.linalg.norm((computed.tip - reference.tip)[:2]) / displacement),
        float(
            np.max(np.abs(computed.moments - reference.moments)[rows])
            / np.max(np.abs(reference.moments))
        ),
    )


def fit_order(errors: Array) -> float:
    """Return the order over the finest three meshes above the rounding level."""
    x, y = np.log(ELEMENTS), np.log(np.maximum(errors, 1e-300))
    above_rounding = np.asarray(errors) > ROUNDING_LEVEL
    finest = np.flatnonzero(above_rounding)[-3:]
    return float(-np.polyfit(x[finest], y[finest], 1)[0]) if len(finest) > 1 else float("nan")


def tabulate(curve: str, formulation: str) -> list[dict[str, Any]]:
    """Return one row per quantity: errors by number of elements, and the order."""
    table = np.array([relative_errors(curve, formulation, n) for n in ELEMENTS]).T
    return [
        {
            "curve": curve,
            "formulation": formulation,
            "quantity": quantity,
            **{f"{n} elements": f"{e:.1e}" for n, e in zip(ELEMENTS, errors, strict=True)},
            "order": f"{fit_order(errors):.1f}",
        }
        for quantity, errors in zip(QUANTITIES, table, strict=True)
    ]


def main() -> None:
    table = pd.DataFrame([row for c in CURVES for f in FORMULATIONS for row in tabulate(c, f)])
    table.to_csv(TABLE, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
