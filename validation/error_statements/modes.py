"""Compare stated with true errors of natural frequencies: `python validation/.../modes.py`.

Prints the summary, and writes results/modes.csv. References have four times as many elements, at
least eight, and are geometrically exact; modes of the reference are those of equal order. Where
bending modes are far too fast, an axial mode may have the right frequency but a wrong number.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "models"), str(ROOT / "validation")]

import numpy as np
import pandas as pd

import beamdae as bd
from error_statements.mechanisms import EXACT, FLOATING, PLASTIC, RUBBER, STEEL
from error_statements.statements import ACCURATE, FACTOR, WRONG

TABLE = Path(__file__).parent / "results" / "modes.csv"
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


def compare(model: Callable[..., Drawn], seed: int, elements: int, formulation: str) -> Any:
    """Return one row per frequency: true and stated errors, and the cost over the modes."""
    fine = {"elements": max(4 * elements, 8), "formulation": EXACT}
    exact, mech = (
        model(np.random.default_rng([7, seed]), **settings)
        for settings in (fine, {"elements": elements, "formulation": formulation})
    )
    begin = time.process_time()
    modes, reference = (bd.modes(*x, n=COUNT + 1) for x in (mech, exact))
    middle = time.process_time()
    errors = modes.errors
    spent = time.process_time() - middle
    name = f"{model.__name__}, seed={seed}, {elements} elements, {formulation}"
    for k in range(COUNT):
        true = modes.frequencies[k] / reference.frequencies[k] - 1.0
        yield name, errors.headers[k], abs(true), errors.total[k], spent / (middle - begin)


def main() -> None:
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    meshes = ((1, FLOATING), (1, EXACT), (2, FLOATING), (3, EXACT), (6, FLOATING), (8, EXACT))
    cases = [(x, 10 * i + k, *y) for i, x in enumerate(MODELS) for k, y in enumerate(meshes)]
    rows = [row for case in cases for row in compare(*case)]
    table = pd.DataFrame(rows, columns=["case", "column", "true", "stated", "cost"])
    table.to_csv(TABLE, index=False, float_format="%.3g")
    true, stated = table["true"].clip(upper=1.0), table["stated"].clip(upper=1.0)
    wrong = true > WRONG
    is_right = (stated >= true / FACTOR) & (stated <= true * FACTOR)
    print(
        f"frequencies {len(table)}, wrong {wrong.sum()}, named {(wrong & (stated > WRONG)).sum()}"
    )
    print(f"of these, size right {(wrong & is_right).sum()}")
    cases = table["case"]
    detected = set(cases[wrong]) & set(cases[stated > WRONG])
    print(f"cases {cases.nunique()}, wrong {cases[wrong].nunique()}, detected {len(detected)}")
    print(f"false {((true < ACCURATE) & (stated > WRONG)).sum()}")
    print(table[wrong & ~is_right].to_string())


if __name__ == "__main__":
    main()
