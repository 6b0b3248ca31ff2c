"""Columns under follower loads, distributed loads and with varying sections."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np

import beamdae as bd
from benchmarks.critical_loads.case import (
    EXACT_STRAINS,
    FLUTTER,
    CriticalLoad,
    branches,
)
from benchmarks.critical_loads.column_dynamics import Column, divergence_loads, flutter_load
from benchmarks.critical_loads.structures import LENGTH, STEEL, WIDTH, stiffness, strip

# Sections of a tapered column at s: width and height relative to s = 0.
Taper = Callable[[float], tuple[float, float]]


def build_column(
    column: Column,
    taper: Taper | None,
    slenderness: float,
    elements: int,
    settings: Mapping[str, Any],
) -> bd.Mechanism:
    """Return the column under its loads times EI / L^2."""
    height, section = LENGTH / slenderness, strip(slenderness)
    unit = section.EI / LENGTH**2
    period = np.sqrt(section.rhoA * LENGTH**4 / section.EI)
    sections: Any = strip(slenderness, damping=column.damping * period)
    if taper is not None:

        def sections(s: float) -> bd.Section:
            width, factor = taper(s / LENGTH)
            return bd.Section.rectangle(STEEL, width=WIDTH * width, height=height * factor)

    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.0, LENGTH))
    beam = mech.add(bd.Beam("column", line, sections, elements, **settings))
    foot, head = mech.ground.at(0.0, 0.0), mech.ground.at(0.0, LENGTH)
    joint = bd.Weld if column.start == "clamped" else bd.Revolute
    mech.add(joint("foot", foot, beam.start))
    if column.end == "hinged":
        mech.add(bd.PointOnLine("head", head, beam.end, (0.0, 1.0)))
    elif column.end == "clamped":
        mech.add(bd.Prismatic("head", head, beam.end, (0.0, 1.0)))
    if column.end_mass:
        mech.add(bd.PointMass("mass", column.end_mass * section.rhoA * LENGTH, on=beam.end))
    P = column.end_load * unit
    if column.line_of_action:
        mech.add(bd.Force("load", beam.end, (0.0, -P)))
        # The offset of the line of action from the end is -x: its moment is -(-x) (-P).
        mech.add(bd.ForceLaw("offset", beam.end, lambda end, t: (0.0, 0.0, P * end.position[0])))
    elif np.isfinite(column.cable):
        anchor = LENGTH * (1.0 - column.cable)

        def pull(end: Any, t: Any) -> tuple[Any, Any]:
            x, y = end.position
            distance = np.sqrt(x**2 + (y - anchor) ** 2)
            return -P * x / distance, -P * (y - anchor) / distance

        mech.add(bd.ForceLaw("load", beam.end, pull))
    else:
        for name, axes, share in (
            ("dead load", "inertial", 1.0 - column.follower_end),
            ("follower load", "body", column.follower_end),
        ):
            if P * share:
                mech.add(bd.Force(name, beam.end, (0.0, -P * share), axes=axes))
    if column.distributed:

        def density(s: Any) -> Any:
            load = unit / LENGTH
            return sum(c * load * (s / LENGTH) ** k for k, c in enumerate(column.distributed))

        # Uniform loads are constants, which every formulation takes.
        uniform = len(column.distributed) == 1
        if column.follower_distributed:
            law = (-density(0.0), 0.0) if uniform else lambda s, x, y, t: (-density(s), 0.0 * s)
            mech.add(bd.DistributedForce("drag", beam, law, axes="section"))
        else:
            law = (0.0, -density(0.0)) if uniform else lambda s, x, y, t: (0.0 * s, -density(s))
            mech.add(bd.DistributedForce("weight", beam, law))
    if column.foundation:
        modulus = column.foundation * unit / LENGTH**2
        mech.add(
            bd.DistributedForce("foundation", beam, lambda s, x, y, t: (-modulus * x, 0.0 * y))
        )
    return mech


@cache
def _flutter_near(column: Column, near: tuple[float, float], slenderness: float) -> tuple:
    """Follow the onset of flutter from slender columns, where it is `near`, to thicker ones."""
    for value in (1e6, *(s for s in (1e2, 3e1, 2e1, 1.4e1) if s > slenderness), slenderness):
        near = flutter_load(column, stiffness(value), near)
    return near


def _phase(column: Column, load: float, frequency: float = 0.0) -> float:
    """Return the largest wave number over the column, of motions with an angular frequency."""
    P, EI = abs(load) * column.compression(0.0), 1.0
    if column.bending:
        EI = min(column.bending(s)[0] for s in (0.0, 1.0))
    return float(np.sqrt(0.5 * P + np.sqrt(0.25 * P**2 + frequency**2)) / np.sqrt(EI))


def flutter(
    end: None, /, near: tuple[float, float], loads: list[str] | None = None, **column: Any
) -> dict[str, Any]:
    """Return the fields of a `Column` that flutters at the load and frequency `near` if slender."""
    described = Column(**column)
    return {
        "build": partial(build_column, described, None),
        "reference": lambda slenderness, strain: (
            CriticalLoad(FLUTTER, _flutter_near(described, near, slenderness)[0]),
        ),
        "path": lambda slenderness: {"to": 1.1 * near[0], "loads": loads},
        "phase": lambda load: _phase(described, load, near[1]),
        # The frequencies coincide in a double root.
        "formulations": EXACT_STRAINS,
    }


def divergence(
    end: float, /, loads: list[str] | None = None, taper: Taper | None = None, **column: Any
) -> dict[str, Any]:
    """Return the fields of a `Column` that buckles statically, loaded up to `end` [EI / L^2]."""
    described = Column(**column)
    return {
        "build": partial(build_column, described, taper),
        "reference": lambda slenderness, strain: branches(
            divergence_loads(described, stiffness(slenderness), end)
        ),
        "path": lambda slenderness: {"to": end, "loads": loads},
        "phase": partial(_phase, described),
        "formulations": EXACT_STRAINS,
    }


def tapered(end: float, taper: tuple[float, float]) -> dict[str, Any]:
    """Return the fields of a column whose width and height decrease by these fractions."""

    def sizes(s: float) -> tuple[float, float]:
        return 1.0 - taper[0] * s, 1.0 - taper[1] * s

    def ratios(s: float) -> tuple[float, float, float]:
        width, height = sizes(s)
        return width * height**3, width * height, width * height

    # Sections vary along the elements as well.
    return divergence(end, taper=sizes, bending=ratios) | {"mesh_constant": 1e-4}
