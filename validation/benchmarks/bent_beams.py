"""Beams at rest with published or closed-form answers, none of them by this project."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import beamdae as bd
from benchmarks.bent_closed_forms import elastica, pinched_ring, quarter_circle
from benchmarks.small_displacements import small_displacements

FORMULATIONS: dict[str, dict[str, Any]] = {
    "exact": {"formulation": "exact"},
    "exact strain in a frame": {"strain": "exact", "frame": "tangent"},
}
SLENDERNESS = (4, 20, 100, 500, 2500)


@dataclass(frozen=True, eq=False)
class KnownRest:
    """A beam, and what is known of it at rest.

    Attributes
    ----------
    known
        Published numbers by name.
    within
        Relative error that is to be met with these `elements`.
    ours
        The same of (elements, words of the formulation).
    """

    name: str
    source: str
    elements: int
    known: Mapping[str, float]
    within: float
    ours: Callable[[int, Mapping[str, Any]], Mapping[str, float]]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Those by every formulation."""
        for label in FORMULATIONS:
            yield from self.rows_by(label)

    def rows_by(self, label: str) -> Iterator[dict[str, Any]]:
        """A row for each of the numbers, by a formulation."""
        found = self.ours(self.elements, FORMULATIONS[label])
        for quantity, known in self.known.items():
            error = abs(found[quantity] - known)
            yield {
                "case": self.name,
                "setting": f"{label}, {self.elements} elements",
                "quantity": quantity,
                "published": f"{known:.13g}",
                "ours": f"{found[quantity]:.13g}",
                "error": f"{error:.2e}",
                "relative": f"{error / abs(known):.2e}",
                "ended": "",
            }


def section(EI: float, EA: float, GA: float) -> bd.Section:
    """A section by its stiffnesses."""
    material = bd.Material(E=EA, nu=0.0, rho=1.0)
    return bd.Section(material, 1.0, second_moment=EI / EA, shear_coefficient=2.0 * GA / EA)


def cantilever(
    length: float,
    own: bd.Section,
    elements: int,
    words: Mapping[str, Any],
    force: tuple[float, float] = (0.0, 0.0),
    moment: float = 0.0,
) -> bd.Mechanism:
    """A straight beam clamped at the origin under loads of its end."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("beam", line, own, elements, **words))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("force", beam.end, force))
    mech.add(bd.Moment("moment", beam.end, moment))
    mech.observe("quarter", beam.at(0.25 * length))
    mech.observe("tip", beam.end)
    mech.observe("clamp", clamp.reaction)
    return mech


def tip(mech: bd.Mechanism, **settings: Any) -> tuple[float, float, float]:
    """Position and angle of the tip at rest."""
    found = bd.equilibrium(mech, **settings)
    assert found.status.success, found.status.sentence
    x, y, angle = (found.columns[f"tip.{k}"][-1] for k in ("x [m]", "y [m]", "angle [rad]"))
    return x, y, angle


def _rolled_up(turns: int, elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    own = section(1.0, 1e4, 4e3)
    mech = cantilever(10.0, own, elements, words, moment=0.2 * np.pi * turns)
    found = bd.equilibrium(mech, step=0.1 / turns)
    x, angle, rise = (
        found.columns[name][-1] for name in ("tip.x [m]", "tip.angle [rad]", "quarter.y [m]")
    )
    return {"tip u": x - 10.0, "angle of the tip": angle, "y of a quarter of it": rise}


def _roll_up(turns: int) -> KnownRest:
    radius = 5.0 / (np.pi * turns)
    known = {
        "tip u": -10.0,
        "angle of the tip": 2.0 * np.pi * turns,
        "y of a quarter of it": radius * (1.0 - np.cos(0.5 * np.pi * turns)),
    }
    name, source = f"roll-up, circles: {turns}", "M = 2 pi n EI / L"
    return KnownRest(name, source, 8 * turns, known, 1e-6, partial(_rolled_up, turns))


def _elastica(elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    # Inextensible and stiff in shear to 1e-8 of the bending.
    mech = cantilever(1.0, section(1.0, 1e8, 1e8), elements, words, force=(0.0, 10.0))
    path = bd.equilibrium(mech, to=[0.1 * k for k in range(1, 11)])
    found = {}
    for k in range(1, 11):
        row = int(np.argmin(np.abs(path.factors[:, 0] - 0.1 * k)))
        x, y, angle = (path.columns[f"tip.{c}"][row] for c in ("x [m]", "y [m]", "angle [rad]"))
        moment = abs(path.columns["clamp.M [N m]"][row])
        values = (1.0 - x, y, angle, moment)
        found |= dict(zip(elastica_names(k), values, strict=True))
    return found


def elastica_names(load: int) -> list[str]:
    """Names of shortening, deflection, slope and moment at P L^2 / EI = `load`."""
    return [f"{what} at {load}" for what in ("u / L", "w / L", "slope", "M L / EI")]


# EI and EA of a bar of 2 m, 0.1 m thick, and GA with the shear of a square.
_EI, _EA = 2.07e11 * 0.1**4 / 12.0, 2.07e11 * 0.01
_GA = _EA / 2.6 * (10.0 * 1.3) / (12.0 + 11.0 * 0.3)


def _timoshenko(GA: float, elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    mech = cantilever(2.0, section(_EI, _EA, GA), elements, words, force=(0.0, -0.75 * _EI))
    x, y, _ = tip(mech)
    return {"u": x - 2.0, "v": y}


def _bernoulli(elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    """Without shear: up to the third power of EA / GA by three of them (Richardson)."""
    stiff, stiffer, stiffest = (_timoshenko(f * _EA, elements, words) for f in (10.0, 20.0, 40.0))
    return {k: (8.0 * stiffest[k] - 6.0 * stiffer[k] + stiff[k]) / 3.0 for k in ("u", "v")}


def _thick(elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    own = section(9.346e6, 4.8e8, 3.231e8)
    x, y, angle = tip(cantilever(5.0, own, elements, words, force=(0.0, -600e3)))
    return {"w": y, "u": x - 5.0, "rotation": -angle}


def _square(radius: float, slenderness: float) -> bd.Section:
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    return bd.Section.rectangle(steel, width=radius / slenderness, height=radius / slenderness)


def _quarter_circle(
    slenderness: float, elements: int, words: Mapping[str, Any]
) -> dict[str, float]:
    found = {}
    for name in ("radial", "tangential", "moment"):
        own = _square(2.0, slenderness)
        axis = bd.Arc(2.0, np.pi, start=(2.0, 0.0), angle=0.5 * np.pi)
        mech = bd.Mechanism()
        beam = mech.add(bd.Beam("beam", axis, own, elements, **words))
        mech.add(bd.Weld("clamp", mech.ground.at(2.0, 0.0), beam.start))
        if name == "moment":
            mech.add(bd.Moment(name, beam.end, 1.0))
        else:
            mech.add(bd.Force(name, beam.end, (0.0, 1.0) if name == "radial" else (-1.0, 0.0)))
        mech.observe("tip", beam.end)
        x, y, turn = small_displacements(mech)[:3]
        compliances = dict(zip(("radial", "tangential", "turn"), (y, -x, turn), strict=True))
        found |= {f"{k} by {name}": c for k, c in compliances.items()}
    return found


def _pinched_ring(slenderness: float, elements: int, words: Mapping[str, Any]) -> dict[str, float]:
    """A quarter of it, on two guides."""
    mech = bd.Mechanism()
    axis = bd.Arc(2.0, np.pi, start=(2.0, 0.0), angle=0.5 * np.pi)
    beam = mech.add(bd.Beam("ring", axis, _square(2.0, slenderness), elements, **words))
    mech.add(bd.Prismatic("side", mech.ground.at(2.0, 0.0), beam.start, (1.0, 0.0)))
    mech.add(bd.Prismatic("top", mech.ground.at(0.0, 2.0), beam.end, (0.0, 1.0)))
    mech.add(bd.Force("load", beam.end, (0.0, -0.5)))
    mech.observe("top", beam.end)
    mech.observe("side", beam.start)
    found = small_displacements(mech)
    return {"approach": -2.0 * found[1], "growth": 2.0 * found[6]}


KNOWN_RESTS = (
    *(_roll_up(turns) for turns in (1, 2)),
    KnownRest(
        "elastica",
        "K. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145, by elliptic integrals",
        8,
        {
            name: value
            for load in range(1, 11)
            for name, value in zip(elastica_names(load), elastica(load), strict=True)
        },
        2e-6,
        _elastica,
    ),
    KnownRest(
        "Exudyn cantilever",
        "Exudyn, pythonDev/Examples/ANCFcantileverTest.py, converged; the same by shooting",
        48,
        {"u": -0.508537304326, "v": -1.207239854550},
        1e-12,
        _bernoulli,
    ),
    KnownRest(
        "Exudyn cantilever with shear",
        "by shooting",
        48,
        {"u": -0.509464717745, "v": -1.208822829560},
        1e-12,
        partial(_timoshenko, _GA),
    ),
    KnownRest(
        "Geradin & Cardona cantilever",
        "M. Geradin, A. Cardona, Flexible Multibody Dynamics (Wiley 2001); SHARPy, tests/xbeam",
        8,
        {"w": -2.159, "u": -0.596, "rotation": 0.6720},
        1e-3,
        _thick,
    ),
    KnownRest(
        "Geradin & Cardona cantilever, more digits",
        "by shooting",
        16,
        {"w": -2.1596938945, "u": -0.5964712722, "rotation": 0.6720060638},
        1e-10,
        _thick,
    ),
    *(
        KnownRest(
            f"quarter circle, R/h {slenderness}",
            "Castigliano's theorem",
            8,
            quarter_circle(2.0, _square(2.0, slenderness)),
            3e-6,
            partial(_quarter_circle, slenderness),
        )
        for slenderness in SLENDERNESS
    ),
    *(
        KnownRest(
            f"pinched ring, R/h {slenderness}",
            "Castigliano's theorem",
            8,
            pinched_ring(2.0, _square(2.0, slenderness)),
            3e-6,
            partial(_pinched_ring, slenderness),
        )
        for slenderness in SLENDERNESS
    ),
)
