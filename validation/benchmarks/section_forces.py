"""Section forces of beams with closed-form references."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.static_cases import build_pinched_ring, static_case

import beamdae as bd

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
BAR = bd.Section.rectangle(STEEL, width=0.1, height=0.1)
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
GRAVITY = 9.81  # [m/s^2]
WEIGHT = BAR.rhoA * GRAVITY  # per length [N/m]
SPEED = 400.0  # of the rotating rod [rad/s]
RADIUS = 2.0  # of the ring [m]
THICKNESS = 0.1  # of the ring and of the hooks [m]
RING_SPEED = 20.0  # [rad/s]
HOOK_RATIOS = (2.0, 5.0, 10.0)  # radius of curvature / height
IMPACT_SPEED = 1.0  # [m/s]
IMPACT_STRESS = IMPACT_SPEED * np.sqrt(STEEL.E * STEEL.rho)  # E v / c [Pa]


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


def _solve_rotating_ring(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the hoop stress of a free ring once strong damping has ended its vibrations."""
    section = bd.Section.rectangle(STEEL, width=THICKNESS, height=THICKNESS, damping=5e-4)
    mech, quarters = bd.Mechanism(), []
    for k in range(4):
        angle = 0.5 * np.pi * k
        start = RADIUS * np.array([np.cos(angle), np.sin(angle)])
        axis = bd.Arc(RADIUS, 0.5 * np.pi * RADIUS, start=tuple(start), angle=angle + 0.5 * np.pi)
        motion: dict[str, Any] = {
            "velocity": (-RING_SPEED * start[1], RING_SPEED * start[0]),
            "angular_velocity": RING_SPEED,
        }
        beam = bd.Beam(f"quarter {k}", axis, section, elements, **motion, **settings)
        quarters.append(mech.add(beam))
    for k, quarter in enumerate(quarters):
        mech.add(bd.Weld(f"weld {k}", quarter.end, quarters[(k + 1) % 4].start))
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=0.02, output_step=0.02)
    forces = run.section_forces(quarters[1], t=0.02)
    stresses = forces.stress(0.0)["sigma [Pa]"] / (STEEL.rho * (RING_SPEED * RADIUS) ** 2)
    return {"smallest stress": stresses.min(), "largest stress": stresses.max()}


def _ring_stress() -> float:
    """Return sigma / (rho v^2) with the speed v before the ring expands.

    The expansion by epsilon reduces the stress to E epsilon = rho v^2 / (1 + epsilon)^3, because
    the angular momentum is constant.
    """
    initial = STEEL.rho * (RING_SPEED * RADIUS) ** 2 / STEEL.E
    expansion = initial
    for _ in range(10):
        expansion = initial / (1.0 + expansion) ** 3
    return expansion / initial


def _solve_bent_hooks(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return stresses of clamped arcs under an end moment, relative to M / W."""
    stresses = {}
    for ratio in HOOK_RATIOS:
        radius, moment = ratio * THICKNESS, 1e-3 * STEEL.E * THICKNESS**3
        section = bd.Section.rectangle(STEEL, width=THICKNESS, height=THICKNESS)
        axis = bd.Arc(radius, 0.5 * np.pi * radius)
        mech = bd.Mechanism()
        with warnings.catch_warnings():
            # About the stiffness of thick arcs, which does not affect these stresses.
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            beam = mech.add(bd.Beam("hook", axis, section, elements, **settings))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Moment("load", beam.end, moment))
        forces = bd.equilibrium(mech).section_forces(beam, s=[0.5 * axis.length])
        for side, surface in (("inner", "top"), ("outer", "bottom")):
            stress = abs(forces.stress(surface)["sigma [Pa]"][0])
            modulus = section.second_moment / (0.5 * THICKNESS)
            stresses[f"{side}, R / h = {ratio:g}"] = stress * modulus / moment
    return stresses


def _winkler_stresses() -> dict[str, float]:
    """Return sigma W / M = h (r - r_n) / (6 e r), r_n = h / ln(r_o / r_i), e = R - r_n."""
    stresses = {}
    for ratio in HOOK_RATIOS:
        inner, outer = ratio - 0.5, ratio + 0.5
        neutral = 1.0 / np.log(outer / inner)
        for side, r in (("inner", inner), ("outer", outer)):
            stress = abs(r - neutral) / (6.0 * (ratio - neutral) * r)
            stresses[f"{side}, R / h = {ratio:g}"] = float(stress)
    return stresses


def _elastic_stresses() -> dict[str, float]:
    """Return sigma W / M of the plane problem of elasticity (Golovin 1881)."""
    stresses = {}
    for ratio in HOOK_RATIOS:
        a, b = ratio - 0.5, ratio + 0.5
        log = np.log(b / a)
        scale = (b**2 - a**2) ** 2 - 4.0 * (a * b * log) ** 2
        for side, r in (("inner", a), ("outer", b)):
            terms = -((a * b / r) ** 2) * log + b**2 * np.log(r / b) + a**2 * np.log(a / r)
            stresses[f"{side}, R / h = {ratio:g}"] = float(
                abs(4.0 / scale * (terms + b**2 - a**2)) / 6.0
            )
    return stresses


def _solve_impact(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the stress after a moving rod has been stopped at one end, with little damping."""
    section = replace(BAR, damping=5e-7)
    mech = bd.Mechanism()
    velocity = (-IMPACT_SPEED, 0.0)
    beam = mech.add(bd.Beam("rod", LINE, section, elements, velocity=velocity, **settings))
    mech.add(bd.Weld("wall", mech.ground.at(0.0, 0.0), beam.start))
    crossing = np.sqrt(STEEL.rho / STEEL.E)  # time in which waves cross the rod, length 1 m [s]
    run = bd.simulate(mech, bd.Radau(1e-6), t_end=3.0 * crossing, output_step=0.1 * crossing)
    times = crossing * np.array([1.0, 2.0, 3.0])
    N = run.section_forces(beam, t=times, s=[0.0, 0.5]).N / BAR.area
    return {
        "at the wall before the reflection": N[0, 0],
        "in the middle before the reflection": N[0, 1],
        "at the wall after the reflection": N[2, 0],
    }


def _solve_falling_chimney(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return moment and shear force of a falling chimney, relative to its weight."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    # The closed form has neither rotary inertia, which reduces the angular acceleration by
    # h^2 / (4 L^2), nor deflection, by which the weight bends slender chimneys further.
    section = replace(BAR, damping=1e-3, rotary_inertia_per_length=1e-6 * BAR.rhoI)
    # 0.3 rad from the vertical.
    line = bd.Line((0.0, 0.0), (np.sin(0.3), np.cos(0.3)))
    beam = mech.add(bd.Beam("chimney", line, section, elements, **settings))
    mech.add(bd.Revolute("base", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("top", beam.end)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=0.3, output_step=0.3)
    scale = section.rhoA * GRAVITY * run.columns["top.x [m]"][-1]
    forces = run.section_forces(beam, t=0.3, s=np.linspace(0.0, 1.0, 301))
    moments = np.abs(forces.M[0])
    return {
        "largest M": moments.max() / scale,
        "s of the largest M": forces.s[moments.argmax()],
        "Q at the base": abs(forces.Q[0, 0]) / scale,
    }


def _solve_pinched_ring(elements: int, settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the forces of a quarter ring on two guides; the load bends it by 1e-6 of R."""
    section = bd.Section.rectangle(STEEL, width=THICKNESS, height=THICKNESS)
    load = 1e-5 * section.EI / RADIUS**2
    mech, beam = build_pinched_ring(RADIUS, section, load, elements, settings)
    forces = bd.equilibrium(mech, step=1.0).section_forces(beam, s=[0.0, beam.length])
    (side, top), N, Q = forces.M[0] / (load * RADIUS), forces.N[0] / load, forces.Q[0] / load
    return {
        "M / P R under the load": abs(top),
        "M / P R at the sides": abs(side),
        "N / P at the sides": -N[0],
        "Q / P under the load": abs(Q[1]),
    }


SECTION_FORCE_CASES = (
    static_case(
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
    static_case(
        "rotating rod",
        "EA (cos k s / cos k L - 1)",
        4,
        {"N at the axle": _rod_force(0.0), "N at 0.5 L": _rod_force(0.5)},
        1e-6,
        _solve_rotating_rod,
    ),
    static_case(
        "rotating ring",
        "rho v^2, corrected for the expansion",
        4,
        {"smallest stress": _ring_stress(), "largest stress": _ring_stress()},
        2e-5,
        _solve_rotating_ring,
    ),
    static_case(
        "stresses of curved bars",
        "Winkler and Bach",
        4,
        _winkler_stresses(),
        1e-6,
        _solve_bent_hooks,
    ),
    static_case(
        "stresses of curved bars by plane elasticity",
        "Golovin 1881; Timoshenko & Goodier, Theory of Elasticity, section 29",
        4,
        _elastic_stresses(),
        6e-3,  # error of the theory at R / h = 2
        _solve_bent_hooks,
    ),
    static_case(
        "impact wave",
        "E v / c",
        16,
        {
            "at the wall before the reflection": -IMPACT_STRESS,
            "in the middle before the reflection": -IMPACT_STRESS,
            "at the wall after the reflection": IMPACT_STRESS,
        },
        1e-3,
        _solve_impact,
    ),
    static_case(
        "falling chimney",
        "m g L sin / 27 at L / 3, m g sin / 4",
        4,
        {"largest M": 1.0 / 27.0, "s of the largest M": 1.0 / 3.0, "Q at the base": 0.25},
        1e-4,
        _solve_falling_chimney,
    ),
    static_case(
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
