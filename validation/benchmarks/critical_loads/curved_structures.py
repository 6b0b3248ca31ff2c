"""Critical loads of arches and rings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from benchmarks.critical_loads.case import (
    EXACT_STRAINS,
    LENGTH,
    CriticalLoad,
    branches,
    stiffness,
    strip,
)
from benchmarks.critical_loads.frame_stability import BeamStiffness
from benchmarks.critical_loads.shooting import (
    BRANCH,
    LIMIT,
    Chain,
    CriticalState,
    Segment,
    Shooting,
)
from scipy.optimize import brentq

import beamdae as bd

# Half waves of buckled bars that are considered.
_MAX_HALF_WAVES = 10

FLUID, DEAD, CENTRAL = "fluid", "dead", "central"


@dataclass(frozen=True)
class BentStructure:
    """Chain of beams and the part of its path that is compared.

    Attributes
    ----------
    chain
        Maps the slenderness to the chain.
    end
        Last load factor, under load control; None if the path is followed by arc length to `drop`.
    drop
        Maps the slenderness to the deflection of the first loaded point, over L, at which the path
        ends; positive downward.
    """

    chain: Callable[[float], Chain]
    end: float | None = None
    drop: Callable[[float], float] | None = None

    def path(self, slenderness: float) -> dict[str, Any]:
        """Return the arguments of `bd.equilibrium`."""
        if self.drop is None:
            return {"to": self.end}
        chain = self.chain(slenderness)
        height = chain.position(chain.loaded)[1]
        target = (height - self.drop(slenderness)) * LENGTH
        return {"to": {"load.y": target}, "control": "arc length"}

    def trace(self, slenderness: float) -> list[CriticalState]:
        """Return the critical states of the path at a slenderness."""
        chain, beam = self.chain(slenderness), stiffness(slenderness)

        def is_complete(z: np.ndarray) -> bool:
            if self.drop is None:
                return bool(z[3] > self.end)
            height = chain.position(chain.loaded)[1]
            now = chain.position(chain.loaded, beam, z)[1]
            return bool(height - now > self.drop(slenderness))

        return Shooting(chain, beam).trace(is_complete)


def build_chain(
    chain: Chain, slenderness: float, elements: int, settings: Mapping[str, Any]
) -> bd.Mechanism:
    """Return the chain under its loads times EI / L^2, one beam per segment.

    The first loaded point is observed as "load".
    """
    section = strip(slenderness)
    unit = section.EI / LENGTH**2
    mech = bd.Mechanism()
    place, angle, before = np.zeros(2), chain.angle, None
    for k, segment in enumerate(chain.segments):
        angle += segment.turn
        curve = _curve(segment, tuple(place), angle)
        beam = mech.add(bd.Beam(f"part {k}", curve, section, elements, **settings))
        if before is None:
            joint = bd.Weld if chain.start == "clamped" else bd.Revolute
            mech.add(joint("start", mech.ground.at(*beam.start.point), beam.start))
        else:
            mech.add(bd.Weld(f"joint {k}", before.end, beam.start))
        if any(segment.load):
            force = tuple(x * unit for x in segment.load)
            mech.add(bd.Force(f"load {k}", beam.start, force))
        if segment.couple:
            mech.add(bd.Moment(f"couple {k}", beam.start, segment.couple * unit * LENGTH))
        if segment.pressure:
            pressure = (0.0, segment.pressure * unit / LENGTH)
            mech.add(bd.DistributedForce(f"pressure {k}", beam, pressure, axes="section"))
        if segment.dead is not None:
            mech.add(bd.DistributedForce(f"load {k}", beam, _dead_law(segment.dead, unit / LENGTH)))
        if k == chain.loaded and k:
            mech.observe("load", beam.start)
        place, before = np.array(beam.end.point), beam
        angle = float(curve.tangent_angle(curve.length))
    joint = bd.Weld if chain.end == "clamped" else bd.Revolute
    mech.add(joint("end", mech.ground.at(*before.end.point), before.end))
    return mech


def _curve(segment: Segment, start: tuple[float, float], angle: float) -> Any:
    if callable(segment.curvature):
        curvature = segment.curvature
        return bd.IntrinsicCurve(
            lambda s: curvature(s / LENGTH) / LENGTH, segment.length * LENGTH, start, angle
        )
    if segment.curvature:
        return bd.Arc(LENGTH / segment.curvature, segment.length * LENGTH, start, angle)
    end = (
        start[0] + segment.length * LENGTH * np.cos(angle),
        start[1] + segment.length * LENGTH * np.sin(angle),
    )
    return bd.Line(start, end)


def _dead_law(dead: Callable[[Any], tuple[Any, Any]], unit: float) -> Callable[..., Any]:
    def law(s: Any, x: Any, y: Any, t: Any) -> tuple[Any, Any]:
        fx, fy = dead(s / LENGTH)
        return fx * unit + 0.0 * s, fy * unit + 0.0 * s

    return law


def arch(half_angle: float, start: str, end: str, share: float = 0.5, couple: float = 0.0) -> Chain:
    """Return an arch of radius 1 under a vertical load at `share` of its length."""
    length = 2.0 * half_angle
    parts = (
        Segment(share * length, -1.0),
        Segment((1.0 - share) * length, -1.0, load=(0.0, -1.0), couple=couple),
    )
    return Chain(parts, half_angle, start, end)


def pressed_arch(half_angle: float, start: str, end: str, dead: bool = False) -> Chain:
    """Return an arch of radius 1 under uniform pressure, following or of fixed direction."""
    if dead:

        def toward_center(s: Any) -> tuple[Any, Any]:
            return np.sin(half_angle - s), -np.cos(half_angle - s)

        part = Segment(2.0 * half_angle, -1.0, dead=toward_center)
    else:
        part = Segment(2.0 * half_angle, -1.0, pressure=-1.0)
    return Chain((part,), half_angle, start, end)


def lee_frame() -> Chain:
    """Return the hinged right-angle frame loaded at a fifth of its beam."""
    parts = (Segment(1.0), Segment(0.2, turn=-0.5 * np.pi), Segment(0.8, load=(0.0, -1.0)))
    return Chain(parts, 0.5 * np.pi, "hinged", "hinged")


def roorda_frame(eccentricity: float) -> Chain:
    """Return the hinged right-angle frame loaded at its corner, off-center by a fraction of L."""
    parts = (
        Segment(1.0),
        Segment(1.0, turn=-0.5 * np.pi, load=(0.0, -1.0), couple=-eccentricity),
    )
    return Chain(parts, 0.5 * np.pi, "hinged", "hinged")


def toggle(slenderness: float, rise: float, ends: str) -> Chain:
    """Return two bars of unit span with a rise of `rise` heights of the section, welded."""
    slope = np.arctan(rise / slenderness / 0.5)
    bar = 0.5 / np.cos(slope)
    parts = (Segment(bar), Segment(bar, turn=-2.0 * slope, load=(0.0, -1.0)))
    return Chain(parts, slope, ends, ends)


def sine_arch(slenderness: float, rise: float) -> Chain:
    """Return a hinged arch of tangent angle a cos(pi s) under a load sin(pi s).

    Its rise a / pi is `rise` radii of gyration h / sqrt(12).
    """
    slope = np.pi * rise / (np.sqrt(12.0) * slenderness)

    def part(begin: float) -> Segment:
        # The chord differs from L by the square of the slope.
        return Segment(
            0.5,
            lambda s: -slope * np.pi * np.sin(np.pi * (begin + s)),
            dead=lambda s: (0.0 * s, -np.sin(np.pi * (begin + s))),
        )

    return Chain((part(0.0), part(0.5)), slope, "hinged", "hinged")


def sine_arch_loads(slenderness: float, rise: float) -> tuple[CriticalLoad, ...]:
    """Return all critical points of the thin sine arch, in order along its path.

    With the radius of gyration r, the rise a and the amplitude w of the deformed axis, the load is
    q = (pi / L)^4 (EI (a - w) + EA (a^2 - w^2) w / 4). Limits are at 3 w^2 = a^2 - 4 r^2, and the
    second mode branches off at w^2 = a^2 - 16 r^2 (Y. C. Fung, A. Kaplan, NACA TN 2840 (1952)).
    """
    limit, branch = np.sqrt((rise**2 - 4.0) / 3.0), np.sqrt(max(rise**2 - 16.0, 0.0))
    amplitudes = [(limit, LIMIT), (-limit, LIMIT)]
    amplitudes += [(branch, BRANCH), (-branch, BRANCH)] if rise > 4.0 else []
    unit = np.pi**4 / (np.sqrt(12.0) * slenderness)
    return tuple(
        CriticalLoad(kind, float(unit * ((rise - w) + 0.25 * (rise**2 - w**2) * w)))
        for w, kind in sorted(amplitudes, reverse=True)
    )


def build_truss(
    rise: float, slenderness: float, elements: int, settings: Mapping[str, Any]
) -> bd.Mechanism:
    """Return von Mises's truss: two hinged bars, unit span, a rise of `rise` section heights."""
    section = strip(slenderness)
    unit = section.EI / LENGTH**2
    top = (0.5 * LENGTH, rise / slenderness * LENGTH)
    mech = bd.Mechanism()
    left = mech.add(bd.Beam("left", bd.Line((0.0, 0.0), top), section, elements, **settings))
    right = mech.add(bd.Beam("right", bd.Line(top, (LENGTH, 0.0)), section, elements, **settings))
    mech.add(bd.Revolute("left foot", mech.ground.at(0.0, 0.0), left.start))
    mech.add(bd.Revolute("right foot", mech.ground.at(LENGTH, 0.0), right.end))
    mech.add(bd.Revolute("apex", left.end, right.start))
    mech.add(bd.Force("load", left.end, (0.0, -unit)))
    mech.observe("load", left.end)
    return mech


def truss_loads(rise: float, slenderness: float, strain: str) -> tuple[CriticalLoad, ...]:
    """Return all critical points of von Mises's truss up to its inverted position.

    F = 2 EA sin b (1 - cos a / cos b) with the slope b of the bars, a undeformed. Limits are at
    cos^3 b = cos a. Bars buckle as hinged columns at P (1 - P / EA + P / GA) = (n pi / l)^2 EI
    with P = EA (1 - cos a / cos b), on the way to and from the position where both are in line.
    """
    beam = stiffness(slenderness)
    undeformed = np.arctan(2.0 * rise / slenderness)
    bar = 0.5 / np.cos(undeformed)

    def load(slope: float) -> float:
        shortening = 1.0 - np.cos(undeformed) / np.cos(slope)
        return float(2.0 * beam.EA * np.sin(slope) * shortening)

    limit = np.arccos(np.cos(undeformed) ** (1.0 / 3.0))
    points = [(limit, LIMIT), (-limit, LIMIT)]
    factor = 1.0 / beam.GA - 1.0 / beam.EA
    for waves in range(1, _MAX_HALF_WAVES):
        euler = (waves * np.pi / bar) ** 2
        P = 2.0 * euler / (1.0 + np.sqrt(1.0 + 4.0 * factor * euler))
        cosine = np.cos(undeformed) / (1.0 - P / beam.EA)
        if cosine < 1.0:
            slope = np.arccos(cosine)
            points += [(slope, BRANCH)] * 2 + [(-slope, BRANCH)] * 2
    return tuple(CriticalLoad(kind, load(slope)) for slope, kind in sorted(points, reverse=True))


def _chain(structure: BentStructure, **fields: Any) -> dict[str, Any]:
    """Return the fields of the case of a chain, followed as `structure` says."""
    longest = max(one.length for one in structure.chain(1e2).segments)
    return {
        "build": lambda slenderness, *mesh: build_chain(
            structure.chain(slenderness), slenderness, *mesh
        ),
        "path": structure.path,
        "reference": lambda slenderness, strain: tuple(
            CriticalLoad(state.kind, state.load) for state in structure.trace(slenderness)
        ),
        # Arches: the error of the interpolated tangent angle.
        "order": 4,
        "mesh_constant": 2e-4,
        "phase": lambda load: longest * np.sqrt(abs(load) + 1.0),
        "formulations": EXACT_STRAINS,
        **fields,
    }


def _dropped(chain: Chain, drop: float, **fields: Any) -> dict[str, Any]:
    return _chain(BentStructure(lambda s: chain, drop=lambda s: drop), **fields)


def _pressed(
    end: float, degrees: float, ends: tuple[str, str], dead: bool = False
) -> dict[str, Any]:
    """Low arches of R / h = 10 snap through in the range of loads of the cases as well."""
    chain = pressed_arch(np.deg2rad(degrees), *ends, dead)
    return _chain(BentStructure(lambda s: chain, end))


def _crown(
    end: None, degrees: float, ends: tuple[str, str], drop: float, **load: float
) -> dict[str, Any]:
    return _dropped(arch(np.deg2rad(degrees), *ends, **load), drop)


def _sine(end: None, rise: float) -> dict[str, Any]:
    structure = BentStructure(
        partial(sine_arch, rise=rise), drop=lambda s: 2.0 * rise / (np.sqrt(12.0) * s)
    )
    return _chain(
        structure,
        reference=lambda slenderness, strain: sine_arch_loads(slenderness, rise),
        # Squares of slopes up to pi rise / (sqrt(12) s).
        departure=5.0 * rise**2,
        axial_force=lambda load: 1.0,
        phase=lambda load: np.pi,
    )


def _truss(end: None, rise: float) -> dict[str, Any]:
    return {
        "build": partial(build_truss, rise),
        "reference": partial(truss_loads, rise),
        "path": lambda s: {"to": {"load.y": -1.2 * rise / s * LENGTH}, "control": "arc length"},
        # Bars of a rise of 4 heights buckle in up to three half waves, near the largest force.
        "phase": lambda load: 3.0 * np.pi,
        "mesh_constant": 1e-4,
        "axial_force": lambda load: 1.0,
        "formulations": EXACT_STRAINS,
    }


BENT = {
    "pressed arch": _pressed,
    "arch": _crown,
    "sine arch": _sine,
    "truss": _truss,
    "Lee frame": lambda end, drop: _dropped(lee_frame(), drop, order=6),
    "Roorda frame": lambda end, drop, eccentricity: _dropped(
        roorda_frame(eccentricity), drop, order=6
    ),
}


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
