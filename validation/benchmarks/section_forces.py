"""Section forces of beams with closed-form references."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import beamdae as bd
from benchmarks.static_cases import StaticCase

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
BAR = bd.Section.rectangle(STEEL, width=0.1, height=0.1)
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
GRAVITY = 9.81  # [m/s^2]
WEIGHT = BAR.rhoA * GRAVITY  # per length [N/m]
SPEED = 400.0  # of the rotating rod [rad/s]
RADIUS = 2.0  # of the ring [m]
THICKNESS = 0.1  # of the ring [m]


def _solve_heavy_cantilever(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return shear forces and moments; deflection under gravity changes them by 1e-8 only."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    beam = mech.add(bd.Beam("beam", LINE, BAR, elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    forces = bd.equilibrium(mech).section_forces(beam, s=[0.0, 0.3])
    return {
        "Q at the clamp": -forces.Q[0, 0],
        "M at the clamp": forces.M[0, 0],
        "Q at 0.3 L": -forces.Q[0, 1],
        "M at 0.3 L": forces.M[0, 1],
    }


def _solve_rotating_rod(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return axial forces once strong damping has ended the vibrations relative to the rod."""
    mech = bd.Mechanism()
    section = replace(BAR, damping=2e-3)
    beam = mech.add(bd.Beam("beam", LINE, section, elements, angular_velocity=SPEED, **settings))
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", axle, beam.start))
    mech.add(bd.Driver("drive", axle, beam.start, lambda t: SPEED * t))
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=0.05, output_step=0.05)
    forces = run.section_forces(beam, t=0.05, s=[0.0, 0.5])
    return {"N at the axle": forces.N[0, 0], "N at 0.5 L": forces.N[0, 1]}


def _rod_force(s: float) -> float:
    """Return N = EA (cos k s / cos k L - 1), k = speed sqrt(rho / E), of an extensible rod."""
    k = SPEED * np.sqrt(STEEL.rho / STEEL.E)
    return float(BAR.EA * (np.cos(k * s) / np.cos(k) - 1.0))


def _solve_pinched_ring(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the forces of a quarter ring on two guides; the load bends it by 1e-6 of R."""
    section = bd.Section.rectangle(STEEL, width=THICKNESS, height=THICKNESS)
    load = 1e-5 * section.EI / RADIUS**2
    mech = bd.Mechanism()
    axis = bd.Arc(RADIUS, 0.5 * np.pi * RADIUS, start=(RADIUS, 0.0), angle=0.5 * np.pi)
    beam = mech.add(bd.Beam("ring", axis, section, elements, **settings))
    mech.add(bd.Prismatic("side", mech.ground.at(RADIUS, 0.0), beam.start, (1.0, 0.0)))
    mech.add(bd.Prismatic("top", mech.ground.at(0.0, RADIUS), beam.end, (0.0, 1.0)))
    mech.add(bd.Force("load", beam.end, (0.0, -0.5 * load)))
    forces = bd.equilibrium(mech, step=1.0).section_forces(beam, s=[0.0, axis.length])
    (side, top), N, Q = forces.M[0] / (load * RADIUS), forces.N[0] / load, forces.Q[0] / load
    return {
        "M / P R under the load": abs(top),
        "M / P R at the sides": abs(side),
        "N / P at the sides": -N[0],
        "Q / P under the load": abs(Q[1]),
    }


SECTION_FORCE_CASES = (
    StaticCase(
        "cantilever under its weight",
        "w (L - s), w (L - s)^2 / 2",
        4,
        {
            "Q at the clamp": WEIGHT,
            "M at the clamp": 0.5 * WEIGHT,
            "Q at 0.3 L": 0.7 * WEIGHT,
            "M at 0.3 L": 0.5 * 0.7**2 * WEIGHT,
        },
        1e-7,
        _solve_heavy_cantilever,
    ),
    StaticCase(
        "rotating rod",
        "EA (cos k s / cos k L - 1)",
        4,
        {"N at the axle": _rod_force(0.0), "N at 0.5 L": _rod_force(0.5)},
        1e-6,
        _solve_rotating_rod,
    ),
    StaticCase(
        "ring under a diametral load",
        "Castigliano's theorem: 1 / pi, 1 / 2 - 1 / pi",
        4,
        {
            "M / P R under the load": 1.0 / np.pi,
            "M / P R at the sides": 0.5 - 1.0 / np.pi,
            "N / P at the sides": 0.5,
            "Q / P under the load": 0.5,
        },
        1e-5,
        _solve_pinched_ring,
    ),
)
