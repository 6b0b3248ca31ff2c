"""Equilibrium paths with published or independent references: elastica, limit and branch points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import minimize_scalar

import beamdae as bd
from benchmarks.static_cases import section_from_stiffness
from benchmarks.summary_rows import make_row

Array = np.ndarray

shallow_arch = bd.load_model(str(Path(__file__).parents[2] / "models" / "shallow_arch.py"))


class PathResult(NamedTuple):
    """A computed number of an equilibrium path and its reference.

    Attributes
    ----------
    setting, quantity
        Labels of the row.
    reference, computed
        Reference value and computed value.
    points
        Number of points of the path.
    """

    setting: str
    quantity: str
    reference: float
    computed: float
    points: int


@dataclass(frozen=True)
class PathCase:
    """A structure and a generator of its compared results."""

    name: str
    results: Callable[[], Iterator[PathResult]]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield one row per result; "steps" counts the points of the path."""
        for x in self.results():
            values = x.reference, x.computed
            yield make_row(self.name, x.setting, x.quantity, *values, steps=x.points)


# The elastica -------------------------------------------------------------------------------------

# P L^2 / EI: shortening and deflection of the tip over L, its slope [rad]. K. Mattiasson, Int. J.
# Numer. Methods Eng. 17 (1981) 145, by elliptic integrals.
ELASTICA = {
    1: (0.05643, 0.30172, 0.461352),
    2: (0.16064, 0.49346, 0.781750),
    3: (0.25442, 0.60325, 0.986017),
    4: (0.32894, 0.66996, 1.121239),
    5: (0.38763, 0.71379, 1.215368),
    6: (0.43459, 0.74457, 1.283697),
    7: (0.47293, 0.76737, 1.334960),
    8: (0.50483, 0.78498, 1.374432),
    9: (0.53182, 0.79906, 1.405465),
    10: (0.55500, 0.81061, 1.430286),
}


def elastica(elements: int = 8) -> bd.Mechanism:
    """Return a cantilever of unit length and EI, rigid to 1e-8 otherwise, under a dead load."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    section = section_from_stiffness(1.0, 1e8, 1e8)
    beam = mech.add(bd.Beam("beam", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.end, (0.0, 1.0)))
    mech.observe("tip", beam.end)
    return mech


def solve_elastica(elements: int = 8) -> bd.results.Equilibrium:
    """Return the equilibria at the loads of the table."""
    return bd.equilibrium(elastica(elements), to=list(ELASTICA))


def tabulate_tip(path: bd.results.Equilibrium) -> Array:
    """Return shortening, deflection and slope of the tip, one row per load of the table."""
    rows = [int(np.flatnonzero(path.factors[:, 0] == load)[0]) for load in ELASTICA]
    x, y, angle = (path.columns[f"tip.{name}"][rows] for name in ("x [m]", "y [m]", "angle [rad]"))
    return np.stack([1.0 - x, y, angle], axis=1)


def compare_elastica() -> Iterator[PathResult]:
    """Yield the largest error of each column of the table."""
    path = solve_elastica()
    computed, reference = tabulate_tip(path), np.array(list(ELASTICA.values()))
    for k, name in enumerate(("shortening / L", "deflection / L", "slope [rad]")):
        row = int(np.argmax(np.abs(computed - reference)[:, k]))
        yield PathResult(
            "8 exact elements",
            f"{name} at {list(ELASTICA)[row]} EI / L^2",
            reference[row, k],
            computed[row, k],
            len(path.q),
        )


# A shallow arch -----------------------------------------------------------------------------------


def solve_shallow_arch(elements: int = 8, formulation: str = "exact") -> bd.results.Equilibrium:
    """Follow the arch of models/ through both limit points to its inverted position."""
    model = shallow_arch(elements=elements, formulation=formulation)
    return bd.equilibrium(model, to={"crown.y": -0.01})


class ShallowArchCollocation:
    """Reissner's equations of half the arch of models/, by collocation at a given crown height.

    Reissner, J. Appl. Math. Phys. 23 (1972) 795; symmetry fixes slope and x of the crown.
    """

    def __init__(self) -> None:
        arch = shallow_arch().parts["arch"]
        self.curve, self.section = arch.curve, arch.section
        self.load = float(shallow_arch.parameters["load"])
        self._s = np.linspace(0.0, 0.5 * self.curve.length, 41)
        zero = np.zeros_like(self._s)
        self._guess = np.vstack([self.curve.point(self._s).T, zero, zero])
        self._force = np.zeros(2)

    def load_factor(self, height: float) -> float:
        """Return the load factor at a crown height [m], which must be close to the last one."""
        section = self.section

        def slope(s: Array, y: Array, force: Array) -> Array:
            angle = self.curve.tangent_angle(s) + y[2]
            c, d = np.cos(angle), np.sin(angle)
            fx, fy = force
            stretch, shear = 1.0 + (c * fx + d * fy) / section.EA, (c * fy - d * fx) / section.GA
            along, up = stretch * c - shear * d, stretch * d + shear * c
            return np.stack([along, up, y[3] / section.EI, up * fx - along * fy])

        def boundary_residual(a: Array, b: Array, _: Array) -> Array:
            clamp = self.curve.point(0.0)
            return np.array([a[0] - clamp[0], a[1] - clamp[1], a[2], b[0], b[1] - height, b[2]])

        solution = solve_bvp(
            slope,
            boundary_residual,
            self._s,
            self._guess,
            self._force,
            tol=1e-8,
            max_nodes=9000,
        )
        if not solution.success:
            raise ArithmeticError(solution.message)
        self._guess, self._force = solution.sol(self._s), solution.p
        return -2.0 * float(solution.p[1]) / self.load

    def limit_points(self) -> dict[str, tuple[float, float]]:
        """Return load factor and crown height [m] of both limit points by name."""
        points = {}
        for name, sign, bounds in (("first", -1.0, (7.5e-3, 4e-3)), ("second", 1.0, (0.0, -3e-3))):
            heights = np.linspace(*bounds, 15)
            factors = [self.load_factor(height) for height in heights]
            k = int(np.argmin(sign * np.array(factors)))
            # Return to the extremum in small steps; collocation starts from the last solution.
            for height in heights[:k:-1]:
                self.load_factor(height)
            least = minimize_scalar(
                lambda height, sign=sign: sign * self.load_factor(height),
                bounds=(heights[k + 1], heights[k - 1]),
                method="bounded",
                options={"xatol": 1e-8},
            )
            points[name] = (sign * float(least.fun), float(least.x))
            self.load_factor(heights[k])
        return points


def compare_shallow_arch() -> Iterator[PathResult]:
    """Yield the load factors and crown heights of both limit points."""
    reference = ShallowArchCollocation().limit_points()
    for elements, formulation in ((8, "exact"), (16, "exact"), (8, "floating frame")):
        path = solve_shallow_arch(elements, formulation)
        setting = f"{elements} elements, {formulation}"
        for (name, (load, height)), point in zip(reference.items(), path.critical, strict=True):
            points = len(path.q)
            yield PathResult(setting, f"{name} limit load", load, point.factor, points)
            computed_height = path.columns["crown.y [m]"][point.row]
            quantity = f"height of the crown at it [m], {name}"
            yield PathResult(setting, quantity, height, float(computed_height), points)


# Published critical loads -------------------------------------------------------------------------


def deep_arch(elements: int = 16) -> bd.Mechanism:
    """Return DaDeppo and Schmidt's circular arch of 215 degrees, hinged right and clamped left.

    J. Appl. Mech. 42 (1975) 894: the limit load at the crown is 8.97 EI / R^2.
    """
    radius, half = 100.0, np.deg2rad(107.5)
    start = (radius * np.sin(half), radius * np.cos(half))
    arc = bd.Arc(radius, 2.0 * half * radius, start=start, angle=np.pi - half)
    mech = bd.Mechanism()
    section = section_from_stiffness(1e6, 1e8, 1e8)
    arch = mech.add(bd.Beam("arch", arc, section, elements, formulation="exact"))
    mech.add(bd.Revolute("hinge", mech.ground.at(*arch.start.point), arch.start))
    mech.add(bd.Weld("clamp", mech.ground.at(*arch.end.point), arch.end))
    crown = arch.at(0.5 * arch.length)
    mech.add(bd.Force("press", crown, (0.0, -1e6 / radius**2)))
    mech.observe("crown", crown)
    return mech


def lee_frame(elements: int = 8) -> bd.Mechanism:
    """Return the hinged right-angle frame of Lee, Manuel and Rossow.

    ASCE J. Eng. Mech. Div. 94 (1968) 521. Members of length 120 with EI = 1.44e7, the load at a
    fifth of the upper one. Load and displacement both reverse along the path.
    """
    side, section = 120.0, section_from_stiffness(1.44e7, 4.32e7, 2.16e7)
    mech = bd.Mechanism()
    corners = {
        "column": ((0.0, 0.0), (0.0, side), elements),
        "short": ((0.0, side), (0.2 * side, side), max(elements // 4, 1)),
        "long": ((0.2 * side, side), (side, side), elements),
    }
    column, short, long = (
        mech.add(bd.Beam(name, bd.Line(a, b), section, k, formulation="exact"))
        for name, (a, b, k) in corners.items()
    )
    mech.add(bd.Revolute("foot", mech.ground.at(0.0, 0.0), column.start))
    mech.add(bd.Weld("corner", column.end, short.start))
    mech.add(bd.Weld("under the load", short.end, long.start))
    mech.add(bd.Revolute("end", long.end, mech.ground.at(side, side)))
    mech.add(bd.Force("press", short.end, (0.0, -1.44e7 / side**2)))
    mech.observe("load", short.end)
    return mech


def column(axes: str, load: float, elements: int = 8) -> bd.Mechanism:
    """Return a slender column, clamped at its foot and compressed, of unit length, EI and mass."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.0, 1.0))
    section = section_from_stiffness(1.0, 1e7, 1e7)
    beam = mech.add(bd.Beam("column", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -load), axes=axes))
    mech.observe("top", beam.end)
    return mech


def compare_deep_arch() -> Iterator[PathResult]:
    """Yield the limit load against the published value."""
    path = bd.equilibrium(deep_arch(), to={"crown.y": -15.0}, control="arc length")
    factor = path.critical[0].factor
    yield PathResult("16 exact elements", "limit load [EI / R^2]", 8.97, factor, len(path.q))


def compare_euler_column() -> Iterator[PathResult]:
    """Yield the buckling load relative to Euler's load."""
    path = bd.equilibrium(column("inertial", 0.25 * np.pi**2), to=1.2)
    factor = path.critical[0].factor
    yield PathResult("8 exact elements", "branch point", 1.0, factor, len(path.q))


def compare_beck_column() -> Iterator[PathResult]:
    """Yield the follower load of the flutter point; M. Beck, ZAMP 3 (1952) 225."""
    path = bd.equilibrium(column("body", 1.0), to=25.0)
    factor = path.critical[0].factor
    yield PathResult("8 exact elements", "flutter point [EI / L^2]", 20.05, factor, len(path.q))


PATH_CASES = (
    PathCase("elastica cantilever", compare_elastica),
    PathCase("shallow arch", compare_shallow_arch),
    PathCase("deep arch", compare_deep_arch),
    PathCase("Euler column", compare_euler_column),
    PathCase("Beck column", compare_beck_column),
)
