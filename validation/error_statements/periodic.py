"""Stated and true errors of periodic motions.

Mechanisms are drawn from seeds; motions of exact beams with four times the elements are the truth.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd
from error_statements.cases import Comparison, compare_rows, judge_columns
from error_statements.mechanisms import PLASTIC, STEEL

import beamdae as bd

SEEDS = range(8)
ALLOY = bd.Material(E=7.1e10, nu=0.33, rho=2740.0)
Build = Callable[..., bd.Mechanism]


def shaken_blade(seed: int) -> tuple[Build, float]:
    """Return a tapered cantilever on a shaker near its first or second resonance."""
    rng = np.random.default_rng([71, seed])
    material, length = [STEEL, ALLOY, PLASTIC][seed % 3], rng.uniform(0.2, 0.6)
    height, ratio = length * rng.uniform(0.006, 0.02), 10.0 ** rng.uniform(-2.6, -1.5)
    count, mode = int(rng.choice([1, 2, 3, 3, 8])), int(rng.integers(0, 3))
    first = 3.516 * np.sqrt(material.E / material.rho * height**2 / 12.0) / length**2
    shares = rng.uniform([0.6, 0.97, 5.8], [0.95, 1.03, 6.5])
    rate, taper = first * shares[mode], rng.uniform(0.0, 0.4)
    travel = rng.uniform(0.05, 0.2) * length * ratio * (4.0 if mode == 2 else 1.0)

    def build(factor: int = 1, strain: str = "nonlinear") -> bd.Mechanism:
        mech = bd.Mechanism()
        slide = mech.add(bd.RigidBody("slide", mass=1.0, inertia=0.01))
        ground, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
        mech.add(bd.Prismatic("guide", ground, slide.at(0.0, 0.0), direction=up))
        law = bd.sine(travel * (first / rate) ** 2, rate / (2.0 * np.pi))
        mech.add(bd.TranslationalDriver("shaker", ground, slide.at(0.0, 0.0), law, direction=up))

        def section(s: float) -> bd.Section:
            size = height * (1.0 - taper * s / length)
            return bd.Section.rectangle(material, 0.02, size, damping=2.0 * ratio / first)

        line = bd.Line((0.0, 0.0), (length, 0.0))
        beam = mech.add(bd.Beam("blade", line, section, count * factor, strain=strain))
        mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), beam.start))
        mech.observe("tip", beam.end)
        mech.observe("stress", beam.stress(0.05 * length, "top"))
        mech.observe("root", beam.section_forces(0.0))
        return mech

    return build, 2.0 * np.pi / rate


def pressed_strut(seed: int) -> tuple[Build, float]:
    """Return a column under 30 to 93 % of Euler's load that a distributed force shakes."""
    rng = np.random.default_rng([72, seed])
    length, load, count = rng.uniform(0.4, 0.9), rng.uniform(0.3, 0.93), int(rng.choice([1, 2, 6]))
    height, damping = length * rng.uniform(0.004, 0.01), 10.0 ** rng.uniform(-3.5, -2.5)
    section = bd.Section.rectangle([STEEL, ALLOY][seed % 2], 0.02, height, damping=damping)
    euler = np.pi**2 * section.EI / length**2
    rate = (np.pi / length) ** 2 * np.sqrt((1.0 - load) * section.EI / section.rhoA)
    rate *= rng.uniform(0.3, 1.1)
    size = rng.uniform(0.04, 0.2) * euler * (1.0 - load) / length / 10.0

    def build(factor: int = 1, strain: str = "nonlinear") -> bd.Mechanism:
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (length, 0.0))
        rod = mech.add(bd.Beam("rod", line, section, count * factor, strain=strain))
        mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), rod.start))
        mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
        mech.add(bd.Force("press", rod.end, (-load * euler, 0.0)))
        mech.add(bd.DistributedForce("shake", rod, (0.0, bd.sine(size, rate / (2.0 * np.pi)))))
        mech.observe("middle", rod.at(0.5 * length))
        mech.observe("stress", rod.stress(0.4 * length, "top"))
        return mech

    return build, 2.0 * np.pi / rate


def judge(draw: Callable[[int], tuple[Build, float]], seed: int) -> Comparison:
    """Compare the stated errors of the columns of a motion with the true ones.

    Raises
    ------
    RuntimeError
        If the motion or its reference is not found.
    """
    build, period = draw(seed)
    motion, exact = (bd.periodic(x, period, bd.Radau(1e-7)) for x in (build(), build(4, "exact")))
    if not (motion.status.success and exact.status.success):
        raise RuntimeError("no periodic motion was found")
    errors = compare_rows(motion.solution.observed, exact.solution.observed)
    true = errors[["peak", "rms"]].max(axis=1)
    stated = pd.Series(motion.errors.total[: len(true)], true.index)
    return judge_columns(true, errors.min(axis=1), errors.max(axis=1), stated)


def list_cases() -> dict[str, Callable[[], Comparison]]:
    """Return the cases by name."""
    drawn = [(draw, seed) for draw in (shaken_blade, pressed_strut) for seed in SEEDS]
    return {f"{draw.__name__}, seed={seed}": partial(judge, draw, seed) for draw, seed in drawn}
