"""Equilibria with published or independent answers: limit loads, branch points, the elastica."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import minimize_scalar

import beamdae as bd

Array = np.ndarray

# From a `Model` of models/.
ARCH = bd.load_model(str(Path(__file__).parents[2] / "models" / "shallow_arch.py"))


class Answer(NamedTuple):
    """A number that is known of an equilibrium path.

    Attributes
    ----------
    setting, quantity
        Which.
    known, ours
        What is known, and what was found.
    points
        Of the path.
    """

    setting: str
    quantity: str
    known: float
    ours: float
    points: int


@dataclass(frozen=True)
class KnownPath:
    """A structure, and what is known of its equilibria."""

    name: str
    answers: Callable[[], Iterator[Answer]]

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each of the numbers; a step is a point of the path."""
        for one in self.answers():
            error = abs(one.ours - one.known)
            yield {
                "case": self.name,
                "setting": one.setting,
                "quantity": one.quantity,
                "published": f"{one.known:.12g}",
                "ours": f"{one.ours:.12g}",
                "error": f"{error:.2e}",
                "relative": f"{error / abs(one.known):.2e}",
                "steps": one.points,
                "ended": "",
            }


def by_stiffness(EI: float, EA: float, GA: float) -> bd.Section:
    """A section of these stiffnesses."""
    return bd.Section(bd.Material(E=EA, nu=0.0, rho=1.0), 1.0, EI / EA, 2.0 * GA / EA)


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
    """A cantilever without stretch or shear to 1e-8, of length and EI one, under a dead load."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    own = by_stiffness(1.0, 1e8, 1e8)
    beam = mech.add(bd.Beam("beam", line, own, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.end, (0.0, 1.0)))
    mech.observe("tip", beam.end)
    return mech


def elastica_path(elements: int = 8) -> bd.Equilibrium:
    """The loads of the table."""
    return bd.equilibrium(elastica(elements), to=list(ELASTICA))


def elastica_rows(path: bd.Equilibrium) -> Array:
    """The table as it was found."""
    at = [int(np.flatnonzero(path.factors[:, 0] == load)[0]) for load in ELASTICA]
    x, y, angle = (path.columns[f"tip.{name}"][at] for name in ("x [m]", "y [m]", "angle [rad]"))
    return np.stack([1.0 - x, y, angle], axis=1)


def elastica_answers() -> Iterator[Answer]:
    """Where each column of the table is off most."""
    path = elastica_path()
    ours, known = elastica_rows(path), np.array(list(ELASTICA.values()))
    for k, name in enumerate(("shortening / L", "deflection / L", "slope [rad]")):
        row = int(np.argmax(np.abs(ours - known)[:, k]))
        yield Answer(
            "8 exact elements",
            f"{name} at {list(ELASTICA)[row]} EI / L^2",
            known[row, k],
            ours[row, k],
            len(path.q),
        )


# A shallow arch -----------------------------------------------------------------------------------


def shallow_arch_path(elements: int = 8, formulation: str = "exact") -> bd.Equilibrium:
    """The arch of models/, through both of its limit loads to where it hangs."""
    model = ARCH(elements=elements, formulation=formulation)
    return bd.equilibrium(model, to={"crown.y": -0.01})


class ShallowArch:
    """Reissner's equations of half the arch of models/, by collocation, at any height of its crown.

    Reissner, J. Appl. Math. Phys. 23 (1972) 795; symmetry holds slope and place of the crown.
    """

    def __init__(self) -> None:
        arch = ARCH().parts["arch"]
        self.curve, self.section = arch.curve, arch.section
        self.load = float(ARCH.parameters["load"])
        self._s = np.linspace(0.0, 0.5 * self.curve.length, 41)
        still = np.zeros_like(self._s)
        self._guess = np.vstack([self.curve.point(self._s).T, still, still])
        self._force = np.zeros(2)

    def factor(self, height: float) -> float:
        """The load factor that holds the crown at a height [m]; heights close to the last."""
        x = self.section

        def slope(s: Array, y: Array, force: Array) -> Array:
            turn = self.curve.tangent_angle(s) + y[2]
            c, d = np.cos(turn), np.sin(turn)
            fx, fy = force
            stretch, shear = 1.0 + (c * fx + d * fy) / x.EA, (c * fy - d * fx) / x.GA
            along, up = stretch * c - shear * d, stretch * d + shear * c
            return np.stack([along, up, y[3] / x.EI, up * fx - along * fy])

        def ends(a: Array, b: Array, _: Array) -> Array:
            clamp = self.curve.point(0.0)
            return np.array([a[0] - clamp[0], a[1] - clamp[1], a[2], b[0], b[1] - height, b[2]])

        found = solve_bvp(slope, ends, self._s, self._guess, self._force, tol=1e-8, max_nodes=9000)
        if not found.success:
            raise ArithmeticError(found.message)
        self._guess, self._force = found.sol(self._s), found.p
        return -2.0 * float(found.p[1]) / self.load

    def limits(self) -> dict[str, tuple[float, float]]:
        """Load factor and height of the crown [m] at both limit loads."""
        found = {}
        for name, sign, way in (("first", -1.0, (7.5e-3, 4e-3)), ("second", 1.0, (0.0, -3e-3))):
            heights = np.linspace(*way, 15)
            factors = [self.factor(height) for height in heights]
            k = int(np.argmin(sign * np.array(factors)))
            # Back there in small steps.
            for height in heights[:k:-1]:
                self.factor(height)
            least = minimize_scalar(
                lambda height, sign=sign: sign * self.factor(height),
                bounds=(heights[k + 1], heights[k - 1]),
                method="bounded",
                options={"xatol": 1e-8},
            )
            found[name] = (sign * float(least.fun), float(least.x))
            self.factor(heights[k])
        return found


def shallow_arch_answers() -> Iterator[Answer]:
    """Both limit loads, and how far the crown is down at the first."""
    known = ShallowArch().limits()
    for elements, formulation in ((8, "exact"), (16, "exact"), (8, "floating frame")):
        path = shallow_arch_path(elements, formulation)
        setting = f"{elements} elements, {formulation}"
        for (name, (load, height)), one in zip(known.items(), path.critical, strict=True):
            points = len(path.q)
            yield Answer(setting, f"{name} limit load", load, one.factor, points)
            down = path.columns["crown.y [m]"][one.row]
            what = f"height of the crown at it [m], {name}"
            yield Answer(setting, what, height, float(down), points)


# Published critical loads -------------------------------------------------------------------------


def deep_arch(elements: int = 16) -> bd.Mechanism:
    """DaDeppo and Schmidt's circular arch of 215 degrees, hinged right and clamped left.

    J. Appl. Mech. 42 (1975) 894: it holds 8.97 EI / R^2 at its crown.
    """
    radius, half = 100.0, np.deg2rad(107.5)
    start = (radius * np.sin(half), radius * np.cos(half))
    arc = bd.Arc(radius, 2.0 * half * radius, start=start, angle=np.pi - half)
    mech = bd.Mechanism()
    own = by_stiffness(1e6, 1e8, 1e8)
    arch = mech.add(bd.Beam("arch", arc, own, elements, formulation="exact"))
    mech.add(bd.Revolute("hinge", mech.ground.at(*arch.start.point), arch.start))
    mech.add(bd.Weld("clamp", mech.ground.at(*arch.end.point), arch.end))
    crown = arch.at(0.5 * arch.length)
    mech.add(bd.Force("press", crown, (0.0, -1e6 / radius**2)))
    mech.observe("crown", crown)
    return mech


def lee_frame(elements: int = 8) -> bd.Mechanism:
    """The hinged right-angle frame of Lee, Manuel and Rossow.

    ASCE J. Eng. Mech. Div. 94 (1968) 521. Members of 120 with EI = 1.44e7, the load at a fifth of
    the upper one: the load turns, and where it acts turns back.
    """
    side, own = 120.0, by_stiffness(1.44e7, 4.32e7, 2.16e7)
    mech = bd.Mechanism()
    corners = {
        "column": ((0.0, 0.0), (0.0, side), elements),
        "short": ((0.0, side), (0.2 * side, side), max(elements // 4, 1)),
        "long": ((0.2 * side, side), (side, side), elements),
    }
    column, short, long = (
        mech.add(bd.Beam(name, bd.Line(a, b), own, k, formulation="exact"))
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
    """A slender column clamped at its foot, of length, EI and mass one, pressed at its top."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.0, 1.0))
    own = by_stiffness(1.0, 1e7, 1e7)
    beam = mech.add(bd.Beam("column", line, own, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -load), axes=axes))
    mech.observe("top", beam.end)
    return mech


def deep_arch_answers() -> Iterator[Answer]:
    """The load it gives way at."""
    path = bd.equilibrium(deep_arch(), to={"crown.y": -15.0}, control="arc length")
    found = path.critical[0].factor
    yield Answer("16 exact elements", "limit load [EI / R^2]", 8.97, found, len(path.q))


def euler_column_answers() -> Iterator[Answer]:
    """The load it gives way at."""
    path = bd.equilibrium(column("inertial", 0.25 * np.pi**2), to=1.2)
    found = path.critical[0].factor
    yield Answer("8 exact elements", "branch point", 1.0, found, len(path.q))


def beck_column_answers() -> Iterator[Answer]:
    """The follower load it flutters at; M. Beck, ZAMP 3 (1952) 225."""
    path = bd.equilibrium(column("body", 1.0), to=25.0)
    found = path.critical[0].factor
    yield Answer("8 exact elements", "flutter point [EI / L^2]", 20.05, found, len(path.q))


KNOWN_PATHS = (
    KnownPath("elastica cantilever", elastica_answers),
    KnownPath("shallow arch", shallow_arch_answers),
    KnownPath("deep arch", deep_arch_answers),
    KnownPath("Euler column", euler_column_answers),
    KnownPath("Beck column", beck_column_answers),
)
