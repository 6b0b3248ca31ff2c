"""Stated and true errors of natural frequencies.

References have four times as many elements, at least eight, and are geometrically exact; modes of
the reference are those of equal order. Where bending modes are far too fast, an axial mode may have
the right frequency but a wrong number.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from error_statements.cases import Comparison, judge_columns
from error_statements.mechanisms import EXACT, FLOATING, PLASTIC, RUBBER, STEEL

import beamdae as bd

COUNT = 3  # modes
Drawn = tuple[bd.Mechanism, Any]


def _add_strip(
    mech: bd.Mechanism, end: tuple[float, float], section: bd.Section, settings: dict[str, Any]
) -> bd.Beam:
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), end), section, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    return beam


def cantilever(rng: np.random.Generator, **settings: Any) -> Drawn:
    length, mech = rng.uniform(0.2, 1.3), bd.Mechanism()
    height = length * 10.0 ** rng.uniform(-2.5, -1.0)
    beam = _add_strip(
        mech, (length, 0.0), bd.Section.rectangle(STEEL, 2 * height, height), settings
    )
    mech.add(bd.PointMass("bob", rng.uniform(0.1, 1.0) * height**2 * length * STEEL.rho, beam.end))
    return mech, "reference"


def arch(rng: np.random.Generator, **settings: Any) -> Drawn:
    turn, length = rng.uniform(0.4, 2.2), rng.uniform(0.3, 1.0)
    section = bd.Section.rectangle(STEEL, 0.02, length * rng.uniform(0.004, 0.015))
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("arch", bd.Arc(length / turn, length), section, **settings))
    mech.add(bd.Weld("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Revolute("right", mech.ground.at(*beam.end.point), beam.end))
    return mech, "reference"


def bent(rng: np.random.Generator, **settings: Any) -> Drawn:
    section, mech = bd.Section.rectangle(PLASTIC, 0.02, rng.uniform(0.005, 0.015)), bd.Mechanism()
    beam = _add_strip(mech, (0.5, 0.0), section, settings)
    load = rng.uniform(0.5, 4.0) * section.EI / 0.5**2
    mech.add(bd.Force("load", beam.end, (0.0, -load)))
    return mech, "equilibrium" if rng.uniform() < 0.5 else bd.equilibrium(mech)


def stretched(rng: np.random.Generator, **settings: Any) -> Drawn:
    section, mech = bd.Section.rectangle(RUBBER, 0.02, 0.01), bd.Mechanism()
    beam = _add_strip(mech, (0.4, 0.0), section, settings)
    mech.add(bd.PointMass("bob", rng.uniform(0.1, 0.4), beam.end))
    mech.add(bd.Force("pull", beam.end, (rng.uniform(0.02, 0.1) * section.EA, 0.0)))
    return mech, "equilibrium"


def blade(rng: np.random.Generator, **settings: Any) -> Drawn:
    length, section = rng.uniform(0.3, 0.7), bd.Section.rectangle(PLASTIC, 0.03, 0.008)
    speed = rng.uniform(1.0, 8.0) * 3.516 * np.sqrt(section.EI / section.rhoA) / length**2
    mech = bd.Mechanism()
    center = mech.ground.at(0.0, 0.0)
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.1, mass=2.0))
    mech.add(bd.Revolute("bearing", center, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", center, hub.at(0.0, 0.0), lambda t: speed * t))
    line = bd.Line((0.1, 0.0), (0.1 + length, 0.0))
    beam = mech.add(bd.Beam("blade", line, section, **settings))
    mech.add(bd.Weld("root", hub.at(0.1, 0.0), beam.start))
    return mech, bd.rotation(speed)


def column(rng: np.random.Generator, **settings: Any) -> Drawn:
    section, length = bd.Section.rectangle(STEEL, 0.02, 0.012), rng.uniform(0.6, 1.5)
    critical = np.pi**2 * section.EI / length**2
    strain = rng.uniform(0.5, 0.99) * critical / (1.0 + critical / section.GA) / section.EA
    line, free = (bd.Line((0.0, 0.0), (x, 0.0)) for x in (length, length * (1.0 + strain)))
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("column", line, section, free_curve=free, **settings))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Revolute("right", mech.ground.at(length, 0.0), beam.end))
    return mech, "equilibrium"


MODELS = (cantilever, arch, bent, stretched, blade, column)

MESHES = ((1, FLOATING), (1, EXACT), (2, FLOATING), (3, EXACT), (6, FLOATING), (8, EXACT))


def judge(model: Callable[..., Drawn], seed: int, elements: int, formulation: str) -> Comparison:
    """Compare the stated errors of frequencies with the true ones."""
    fine = {"elements": max(4 * elements, 8), "formulation": EXACT}
    exact, mech = (
        model(np.random.default_rng([7, seed]), **settings)
        for settings in (fine, {"elements": elements, "formulation": formulation})
    )
    modes, reference = (bd.modes(*x, n=COUNT + 1) for x in (mech, exact))
    true = pd.Series(np.abs(modes.frequencies / reference.frequencies - 1.0)[:COUNT])
    return judge_columns(true, true, true, pd.Series(modes.errors.total[:COUNT]))


def list_cases() -> dict[str, Callable[[], Comparison]]:
    """Return the cases by name."""
    cases = [(x, 10 * i + k, *y) for i, x in enumerate(MODELS) for k, y in enumerate(MESHES)]
    return {
        f"{model.__name__}, seed={seed}, {elements} elements, {formulation}": partial(
            judge, model, seed, elements, formulation
        )
        for model, seed, elements, formulation in cases
    }
