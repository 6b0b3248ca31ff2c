"""Orders of convergence of the beam formulations for cantilevers under a force and a moment.

The axes are a straight line, an arc, a parabola and a curve with an inflection, all about 1 m long;
the loads bend them by about one radian. Formulations with Reissner's strains are compared with a
solution by shooting. Strains for moderate rotations are tested with a fifth of the loads, and
compared with a solution of the same formulation with 128 elements.
"""

import warnings
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import newton

import beamdae as bd
from beamdae.equations.measures import BalanceRows

Array = np.ndarray

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


class CantileverSolution(NamedTuple):
    """Tip (x, y, angle), strain energy [J] and moments [N m] of a cantilever in equilibrium."""

    tip: Array
    energy: float
    moments: Array


def solve_cantilever(
    curve: Any, section: bd.Section, force: tuple[float, float], moment: float, positions: Array
) -> CantileverSolution:
    """Return the equilibrium under a dead force and a moment at the end, to 1e-12.

    x' = (1 + N / EA) t + Q / GA n, psi' = psi0' + m / EI, m' = -(x' x F), along the curve;
    beamdae's moment is -m. The moment at the clamp is adjusted until the moment at the end is met.
    `positions` are arc lengths [m]; the last one is the end.
    """
    fx, fy = force

    def slopes(s: float, y: Array) -> list[float]:
        c, d = np.cos(y[2]), np.sin(y[2])
        N, Q, m = c * fx + d * fy, c * fy - d * fx, y[3]
        stretch, shear = 1.0 + N / section.EA, Q / section.GA
        along, up = stretch * c - shear * d, stretch * d + shear * c
        energy = 0.5 * (N**2 / section.EA + Q**2 / section.GA + m**2 / section.EI)
        curvature = float(curve.curvature(s)) + m / section.EI
        return [along, up, curvature, up * fx - along * fy, energy]

    def integrate(clamp_moment: float) -> Any:
        start = [*curve.point(0.0), float(curve.tangent_angle(0.0)), clamp_moment, 0.0]
        ends = (0.0, curve.length)
        return solve_ivp(slopes, ends, start, "DOP853", positions, rtol=1e-13, atol=1e-14)

    lever = np.subtract(curve.point(curve.length), curve.point(0.0))
    guess = moment + lever[0] * fy - lever[1] * fx
    end = len(positions) - 1
    root = newton(
        lambda m: integrate(m).y[3, end] - moment, guess, x1=0.9 * guess, tol=1e-12 * abs(guess)
    )
    states = integrate(float(root)).y
    return CantileverSolution(states[:3, end], float(states[4, end]), -states[3])


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


def observe_orders(curve: str, formulation: str) -> Array:
    """Return the orders of energy, tip and moment over the finest meshes above rounding errors.

    They are NaN if fewer than two meshes have errors above the level of rounding.
    """
    table = np.array([relative_errors(curve, formulation, n) for n in ELEMENTS])
    return np.array([_fit_order(errors) for errors in table.T])


def _fit_order(errors: Array) -> float:
    finest = np.flatnonzero(errors > ROUNDING_LEVEL)[-3:]
    if len(finest) < 2:
        return float("nan")
    return float(-np.polyfit(np.log(ELEMENTS)[finest], np.log(errors[finest]), 1)[0])
