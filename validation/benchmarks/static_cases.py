"""Beams in equilibrium with published or closed-form results from independent sources."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from benchmarks.reference_case import ReferenceCase, beam_case
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import beamdae as bd

# Closed forms ---------------------------------------------------------------------------------


def elastica(load: float) -> tuple[float, float, float, float]:
    """Return u / L, w / L, the slope of the tip [rad] and M L / EI at the clamp.

    The cantilever is inextensible, under a transverse dead force P: `load` = P L^2 / EI =
    (K(k) - F(d, k))^2 with the amplitude d = asin(1 / (k sqrt(2))).
    """

    def residual(k: float) -> float:
        return (ellipk(k**2) - ellipkinc(_amplitude(k), k**2)) ** 2 - load

    k = brentq(residual, np.sqrt(0.5) + 1e-12, 1.0 - 1e-12, xtol=1e-15)
    slope = 2.0 * (0.25 * np.pi - np.arccos(k))
    lever = np.sqrt(2.0 * np.sin(slope) / load)
    arc = ellipe(k**2) - ellipeinc(_amplitude(k), k**2)
    return 1.0 - lever, 1.0 - 2.0 * arc / np.sqrt(load), slope, load * lever


def _amplitude(k: float) -> float:
    return float(np.arcsin(np.sqrt(0.5) / k))


def quarter_circle(radius: float, section: bd.Section) -> dict[str, float]:
    """Return tip displacements of a clamped quarter circle under unit tip loads (Castigliano)."""
    R, EI, EA, GA = radius, section.EI, section.EA, section.GA
    stretch = np.pi * R / 4.0 * (1.0 / EA + 1.0 / GA)
    across = -(R**3) / (2.0 * EI) + R / 2.0 * (1.0 / EA - 1.0 / GA)
    along = R**2 / EI * (0.5 * np.pi - 1.0)
    return {
        "radial by radial": np.pi * R**3 / (4.0 * EI) + stretch,
        "tangential by radial": across,
        "turn by radial": -(R**2) / EI,
        "radial by tangential": across,
        "tangential by tangential": R**3 / EI * (0.75 * np.pi - 2.0) + stretch,
        "turn by tangential": along,
        "radial by moment": -(R**2) / EI,
        "tangential by moment": along,
        "turn by moment": np.pi * R / (2.0 * EI),
    }


def pinched_ring(radius: float, section: bd.Section) -> dict[str, float]:
    """Return the approach of the loaded points of a pinched ring and its transverse growth."""
    R, EI, EA, GA = radius, section.EI, section.EA, section.GA
    approach = R**3 / EI * (0.25 * np.pi - 2.0 / np.pi) + 0.25 * np.pi * R * (1.0 / EA + 1.0 / GA)
    growth = R**3 / EI * (2.0 / np.pi - 0.5) - 0.5 * R / EA + 0.5 * R / GA
    return {"approach": approach, "growth": growth}


# Cases ----------------------------------------------------------------------------------------

# Displacements of the central differences, relative to the radius; their error is the square.
_SMALL_DISPLACEMENT = 1e-5


def solve_small_displacements(mech: bd.Mechanism) -> dict[str, float]:
    """Return changes of the observed columns, to first order in the loads.

    They are central differences of equilibria, whose rounding errors do not grow with slenderness;
    the stiffness matrix of a thin beam loses (R/h)^2 times the rounding errors of its entries.
    """
    forward, backward = (bd.equilibrium(mech, to=to, step=1.0) for to in (1.0, -1.0))
    assert forward.status.success
    assert backward.status.success
    return {
        name: 0.5 * (column[-1] - backward.columns[name][-1])
        for name, column in forward.columns.items()
    }


FORMULATIONS: dict[str, dict[str, Any]] = {
    "exact": {"formulation": "exact"},
    "exact strain in a frame": {"strain": "exact", "frame": "tangent"},
}
SLENDERNESS = (4, 20, 100, 500, 2500, 100_000)

static_case = partial(beam_case, formulations=FORMULATIONS)


def section_from_stiffness(EI: float, EA: float, GA: float) -> bd.Section:
    """Return a section with the given bending, axial and shear stiffness."""
    material = bd.Material(E=EA, nu=0.0, rho=1.0)
    return bd.Section(material, 1.0, second_moment=EI / EA, shear_coefficient=2.0 * GA / EA)


def cantilever(
    length: float,
    section: bd.Section,
    elements: int,
    settings: Mapping[str, Any],
    force: tuple[float, float] = (0.0, 0.0),
    moment: float = 0.0,
) -> bd.Mechanism:
    """Return a straight beam clamped at the origin under loads at its end."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements, **settings))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("force", beam.end, force))
    mech.add(bd.Moment("moment", beam.end, moment))
    mech.observe("quarter", beam.at(0.25 * length))
    mech.observe("tip", beam.end)
    mech.observe("clamp", clamp.reaction)
    return mech


def solve_tip(mech: bd.Mechanism, **settings: Any) -> tuple[float, float, float]:
    """Return position [m] and angle [rad] of the tip in equilibrium."""
    equilibrium = bd.equilibrium(mech, **settings)
    assert equilibrium.status.success, equilibrium.status.sentence
    x, y, angle = (equilibrium.columns[f"tip.{k}"][-1] for k in ("x [m]", "y [m]", "angle [rad]"))
    return x, y, angle


def _solve_roll_up(turns: int, elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    section = section_from_stiffness(1.0, 1e4, 4e3)
    mech = cantilever(10.0, section, elements, settings, moment=0.2 * np.pi * turns)
    equilibrium = bd.equilibrium(mech, step=0.1 / turns)
    x, angle, rise = (
        equilibrium.columns[name][-1] for name in ("tip.x [m]", "tip.angle [rad]", "quarter.y [m]")
    )
    return {"tip u": x - 10.0, "angle of the tip": angle, "y of a quarter of it": rise}


def _roll_up_case(turns: int) -> ReferenceCase:
    radius = 5.0 / (np.pi * turns)
    reference = {
        "tip u": -10.0,
        "angle of the tip": 2.0 * np.pi * turns,
        "y of a quarter of it": radius * (1.0 - np.cos(0.5 * np.pi * turns)),
    }
    name, source = f"roll-up, circles: {turns}", "M = 2 pi n EI / L"
    return static_case(name, source, 8 * turns, reference, 1e-6, partial(_solve_roll_up, turns))


def _solve_elastica(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    # Extension and shear are negligible: their strains are 1e-8 of the bending strains.
    mech = cantilever(
        1.0, section_from_stiffness(1.0, 1e8, 1e8), elements, settings, force=(0.0, 10.0)
    )
    path = bd.equilibrium(mech, to=[0.1 * k for k in range(1, 11)])
    values = {}
    for k in range(1, 11):
        row = int(np.argmin(np.abs(path.factors[:, 0] - 0.1 * k)))
        x, y, angle = (path.columns[f"tip.{c}"][row] for c in ("x [m]", "y [m]", "angle [rad]"))
        moment = abs(path.columns["clamp.M [N m]"][row])
        numbers = (1.0 - x, y, angle, moment)
        values |= dict(zip(elastica_names(k), numbers, strict=True))
    return values


def elastica_names(load: int) -> list[str]:
    """Return the names of shortening, deflection, slope and moment at P L^2 / EI = `load`."""
    return [f"{quantity} at {load}" for quantity in ("u / L", "w / L", "slope", "M L / EI")]


# Stiffnesses of a square bar 0.1 m thick and 2 m long.
_EI, _EA = 2.07e11 * 0.1**4 / 12.0, 2.07e11 * 0.01
_GA = _EA / 2.6 * (10.0 * 1.3) / (12.0 + 11.0 * 0.3)


def _solve_timoshenko(GA: float, elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    mech = cantilever(
        2.0, section_from_stiffness(_EI, _EA, GA), elements, settings, force=(0.0, -0.75 * _EI)
    )
    x, y, _ = solve_tip(mech)
    return {"u": x - 2.0, "v": y}


def _extrapolate_bernoulli(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Extrapolate to infinite shear stiffness up to (EA / GA)^3 (Richardson)."""
    coarse, medium, fine = (
        _solve_timoshenko(f * _EA, elements, settings) for f in (10.0, 20.0, 40.0)
    )
    return {k: (8.0 * fine[k] - 6.0 * medium[k] + coarse[k]) / 3.0 for k in ("u", "v")}


def _solve_thick_cantilever(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    section = section_from_stiffness(9.346e6, 4.8e8, 3.231e8)
    x, y, angle = solve_tip(cantilever(5.0, section, elements, settings, force=(0.0, -600e3)))
    return {"w": y, "u": x - 5.0, "rotation": -angle}


def _square_section(radius: float, slenderness: float) -> bd.Section:
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    return bd.Section.rectangle(steel, width=radius / slenderness, height=radius / slenderness)


def _solve_quarter_circle(
    slenderness: float, elements: int, settings: Mapping[str, Any]
) -> dict[str, float]:
    section = _square_section(2.0, slenderness)
    force = _SMALL_DISPLACEMENT * section.EI / 2.0**2
    axis = bd.Arc(2.0, np.pi, start=(2.0, 0.0), angle=0.5 * np.pi)
    values = {}
    for name in ("radial", "tangential", "moment"):
        mech = bd.Mechanism()
        beam = mech.add(bd.Beam("beam", axis, section, elements, **settings))
        mech.add(bd.Weld("clamp", mech.ground.at(2.0, 0.0), beam.start))
        if name == "moment":
            mech.add(bd.Moment(name, beam.end, force))
        else:
            direction = (0.0, force) if name == "radial" else (-force, 0.0)
            mech.add(bd.Force(name, beam.end, direction))
        mech.observe("tip", beam.end)
        change = solve_small_displacements(mech)
        values[f"radial by {name}"] = change["tip.y [m]"] / force
        values[f"tangential by {name}"] = -change["tip.x [m]"] / force
        values[f"turn by {name}"] = change["tip.angle [rad]"] / force
    return values


def build_pinched_ring(
    radius: float, section: bd.Section, load: float, elements: int, settings: Mapping[str, Any]
) -> tuple[bd.Mechanism, bd.Beam]:
    """Return a quarter of a ring on two guides, and its beam."""
    mech = bd.Mechanism()
    axis = bd.Arc(radius, 0.5 * np.pi * radius, start=(radius, 0.0), angle=0.5 * np.pi)
    beam = mech.add(bd.Beam("ring", axis, section, elements, **settings))
    mech.add(bd.Prismatic("side", mech.ground.at(radius, 0.0), beam.start, (1.0, 0.0)))
    mech.add(bd.Prismatic("top", mech.ground.at(0.0, radius), beam.end, (0.0, 1.0)))
    mech.add(bd.Force("load", beam.end, (0.0, -0.5 * load)))
    return mech, beam


def _solve_pinched_ring(
    slenderness: float, elements: int, settings: Mapping[str, Any]
) -> dict[str, float]:
    """Return the deformation of a ring."""
    section = _square_section(2.0, slenderness)
    force = _SMALL_DISPLACEMENT * section.EI / 2.0**2
    mech, beam = build_pinched_ring(2.0, section, force, elements, settings)
    mech.observe("top", beam.end)
    mech.observe("side", beam.start)
    change = solve_small_displacements(mech)
    return {
        "approach": -2.0 * change["top.y [m]"] / force,
        "growth": 2.0 * change["side.x [m]"] / force,
    }


STATIC_CASES = (
    *(_roll_up_case(turns) for turns in (1, 2)),
    static_case(
        "elastica",
        "K. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145, by elliptic integrals",
        8,
        {
            name: value
            for load in range(1, 11)
            for name, value in zip(elastica_names(load), elastica(load), strict=True)
        },
        2e-6,
        _solve_elastica,
    ),
    static_case(
        "Exudyn cantilever",
        "Exudyn, pythonDev/Examples/ANCFcantileverTest.py, converged; the same by shooting",
        48,
        {"u": -0.508537304326, "v": -1.207239854550},
        1e-12,
        _extrapolate_bernoulli,
    ),
    static_case(
        "Exudyn cantilever with shear",
        "by shooting",
        48,
        {"u": -0.509464717745, "v": -1.208822829560},
        1e-12,
        partial(_solve_timoshenko, _GA),
    ),
    static_case(
        "Geradin & Cardona cantilever",
        "M. Geradin, A. Cardona, Flexible Multibody Dynamics (Wiley 2001); SHARPy, tests/xbeam",
        8,
        {"w": -2.159, "u": -0.596, "rotation": 0.6720},
        1e-3,
        _solve_thick_cantilever,
    ),
    static_case(
        "Geradin & Cardona cantilever, more digits",
        "by shooting",
        16,
        {"w": -2.1596938945, "u": -0.5964712722, "rotation": 0.6720060638},
        1e-10,
        _solve_thick_cantilever,
    ),
    *(
        static_case(
            f"quarter circle, R/h {slenderness}",
            "Castigliano's theorem",
            8,
            quarter_circle(2.0, _square_section(2.0, slenderness)),
            1e-6,
            partial(_solve_quarter_circle, slenderness),
        )
        for slenderness in SLENDERNESS
    ),
    *(
        static_case(
            f"pinched ring, R/h {slenderness}",
            "Castigliano's theorem",
            8,
            pinched_ring(2.0, _square_section(2.0, slenderness)),
            1e-6,
            partial(_solve_pinched_ring, slenderness),
        )
        for slenderness in SLENDERNESS
    ),
)
