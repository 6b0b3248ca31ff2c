"""Circular rings under uniform pressure of three kinds."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

import beamdae as bd
from benchmarks.critical_loads.case import EXACT_STRAINS, branches
from benchmarks.critical_loads.frame_stability import BeamStiffness
from benchmarks.critical_loads.structures import LENGTH, stiffness, strip

FLUID, DEAD, CENTRAL = "fluid", "dead", "central"


def ring_determinant(pressure: str, beam: BeamStiffness, load: float, waves: int) -> float:
    """Return the determinant of small motions cos(n phi) of a ring of radius 1 under `load`.

    Section forces and displacements refer to the sections of the compressed ring, which stays
    circular; the load acts per undeformed length. "fluid" loads stay normal to the sections, "dead"
    loads keep their direction, and "central" loads point to the center.
    """
    P = load
    stretch = 1.0 - P / beam.EA
    # z' = A z for z = (u, w, theta, N, Q, M).
    A = np.zeros((6, 6))
    A[0, [1, 3]] = 1.0, 1.0 / beam.EA
    A[1, [0, 2, 4]] = -1.0, stretch, 1.0 / beam.GA
    A[2, 5] = 1.0
    A[3, 4] = 1.0
    A[4, [3, 5]] = -1.0, P
    A[5, 4] = -(stretch + P / beam.GA)
    if pressure != FLUID:
        A[3, 2] -= load
    if pressure == CENTRAL:
        A[3, 0] += load / stretch
    # u, theta and Q are sines, w, N and M cosines.
    shape = A.astype(complex) - 1j * waves * np.eye(6)
    scale = np.array([1.0, 1.0, 1.0, beam.EA, beam.GA, 1.0])
    value = np.linalg.det(shape * scale / np.maximum(1.0, scale[:, None]))
    return float(value.real if abs(value.real) > abs(value.imag) else value.imag)


def ring_load(pressure: str, beam: BeamStiffness, waves: int) -> float:
    """Return the critical pressure [EI / R^3] of the mode with `waves` waves, at least 2."""
    slender = {
        FLUID: waves**2 - 1.0,
        DEAD: float(waves**2),
        CENTRAL: (waves**2 - 1.0) ** 2 / (waves**2 - 2.0),
    }[pressure]
    function = partial(ring_determinant, pressure, beam, waves=waves)
    return float(brentq(function, 0.7 * slender, 1.1 * slender, xtol=1e-12, rtol=1e-13))


def build_ring(
    pressure: str, share: float, slenderness: float, elements: int, settings: Mapping[str, Any]
) -> bd.Mechanism:
    """Return a quarter, a half or a whole ring of radius L under a pressure of EI / R^3."""
    radius, section = LENGTH, strip(slenderness)
    p = section.EI / radius**3
    mech = bd.Mechanism()
    # A ring is closed by two halves, because a joint connects two bodies.
    halves = 2 if share == 1.0 else 1
    length = 2.0 * np.pi * share * radius / halves
    parts = []
    for k in range(halves):
        angle = k * length / radius
        start = (radius * np.cos(angle), radius * np.sin(angle))
        arc = bd.Arc(radius, length, start=start, angle=angle + 0.5 * np.pi)
        parts.append(mech.add(bd.Beam(f"ring {k}", arc, section, elements, **settings)))
    first, last = parts[0], parts[-1]
    if share == 0.25:
        mech.add(bd.Prismatic("side", mech.ground.at(radius, 0.0), first.start, (1.0, 0.0)))
        mech.add(bd.Prismatic("top", mech.ground.at(0.0, radius), last.end, (0.0, 1.0)))
    else:
        mech.add(bd.Weld("side", mech.ground.at(radius, 0.0), first.start))
    if share == 0.5:
        far = mech.ground.at(-radius, 0.0)
        mech.add(bd.Prismatic("far side", far, last.end, (1.0, 0.0)))
    if share == 1.0:
        mech.add(bd.Weld("middle", first.end, last.start))
        mech.add(bd.Weld("closure", first.start, last.end))

    def dead(s: Any, x: Any, y: Any, t: Any) -> tuple[Any, Any]:
        return -p * np.cos(s / radius), -p * np.sin(s / radius)

    def central(s: Any, x: Any, y: Any, t: Any) -> tuple[Any, Any]:
        distance = np.sqrt(x**2 + y**2)
        return -p * x / distance, -p * y / distance

    law: Any = {FLUID: (0.0, p), DEAD: dead, CENTRAL: central}[pressure]
    axes = "section" if pressure == FLUID else "inertial"
    for k, part in enumerate(parts):
        mech.add(bd.DistributedForce(f"pressure {k}", part, law, axes=axes))
    return mech


def ring(end: float, pressure: str, share: float, waves: tuple[int, ...]) -> dict[str, Any]:
    """Return the fields of the case of a part of a ring."""
    return {
        "build": partial(build_ring, pressure, share),
        "reference": lambda slenderness, strain: branches(
            ring_load(pressure, stiffness(slenderness), n) for n in waves
        ),
        "path": lambda slenderness: {"to": end},
        "phase": lambda load: min(2.0 * np.pi * share, np.pi) * np.sqrt(load + 1.0),
        "order": 4,
        "mesh_constant": 1e-3,
        "formulations": EXACT_STRAINS,
    }
