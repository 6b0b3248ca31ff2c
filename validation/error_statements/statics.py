"""Stated and true errors of equilibria and buckling loads: `python .../statics.py [TEXT]`.

The cases are drawn at random; references have exact beams with eight times as many elements. Prints
a row per case: largest true error of its values, stated error of the same value, numbers of values
with true errors above 4 %, of those stated, of those within a factor of two, and of accurate values
(below 1 %) with a stated error; and the time of the check relative to that of the analysis.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]

import numpy as np
import pandas as pd

import beamdae as bd

WRONG, ACCURATE, FINER = 0.04, 0.01, 8
STEEL = bd.Material.of("steel")
Build = Callable[..., bd.Mechanism]


def cantilever(curve: Any, slenderness: float, force: tuple[float, float], shared: int) -> Build:
    """Return a builder of clamped beams under a force relative to EI / L^2 at their end."""
    section = bd.Section.rectangle(STEEL, 0.02, curve.length / slenderness)
    unit = section.EI / curve.length**2

    def build(elements: int, **options: Any) -> bd.Mechanism:
        mech = bd.Mechanism()
        beams = [mech.add(bd.Beam("beam", curve, section, elements, **options))]
        mech.add(bd.Weld("clamp", mech.ground.at(*curve.start), beams[0].start))
        load = tuple(unit * x for x in force)
        if shared:
            end = np.asarray(beams[0].end.point)
            foot = (float(end[0]) + 0.3, float(end[1]) - 0.4)
            line = bd.Line(tuple(map(float, end)), foot)
            other = mech.add(bd.Beam("tie", line, section, elements, **options))
            mech.add(bd.Weld("corner", beams[0].end, other.start))
            mech.add(bd.Revolute("foot", mech.ground.at(*foot), other.end))
        mech.add(bd.Force("load", beams[0].end, load))
        mech.observe("tip", beams[0].end)
        mech.observe("clamp", beams[0].section_forces(0.0))
        mech.observe("middle", beams[0].section_forces(0.4 * curve.length))
        return mech

    return build


def arch(rise: float, slenderness: float, offset: float) -> Build:
    """Return a builder of arches of 1 m that are clamped at both ends, under a force."""

    def build(elements: int, **options: Any) -> bd.Mechanism:
        mech, angle = bd.Mechanism(), 4.0 * np.arctan(2.0 * rise)
        section = bd.Section.rectangle(STEEL, 0.02, 1.0 / slenderness)
        curve = bd.Arc(
            -0.5 / np.sin(0.5 * angle), angle * 0.5 / np.sin(0.5 * angle), angle=angle / 2
        )
        beam = mech.add(bd.Beam("arch", curve, section, 2 * elements, **options))
        mech.add(bd.Weld("left", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Weld("right", mech.ground.at(*map(float, beam.end.point)), beam.end))
        mech.add(bd.Force("load", beam.at(0.5 * curve.length + offset), (0.0, -section.EI)))
        mech.observe("crown", beam.at(0.5 * curve.length))
        mech.observe("left", beam.section_forces(0.0))
        return mech

    return build


def column(slenderness: float, ends: str, tilt: float, lateral: float) -> Build:
    """Return a builder of columns of 1 m under a force of EI / L^2, with a lateral force."""

    def build(elements: int, **options: Any) -> bd.Mechanism:
        mech, top = bd.Mechanism(), (tilt, 1.0)
        section = bd.Section.rectangle(STEEL, 0.02, 1.0 / slenderness)
        beam = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), top), section, elements, **options))
        joint = bd.Weld if ends[0] == "c" else bd.Revolute
        mech.add(joint("foot", mech.ground.at(0.0, 0.0), beam.start))
        if ends[1] == "h":
            mech.add(bd.PointOnLine("top", mech.ground.at(*top), beam.end, (0.0, 1.0)))
        mech.add(bd.Force("press", beam.end, (lateral * section.EI, -section.EI)))
        mech.observe("middle", beam.at(0.5))
        mech.observe("foot", beam.section_forces(0.0))
        return mech

    return build


def draw_cases(seed: int) -> list[tuple[str, Build, int, dict[str, Any], Callable[[Any], Any]]]:
    """Return names, builders, numbers of elements, options of beams and analyses."""
    rng, cases = np.random.default_rng(seed), []
    options: list[dict[str, Any]] = [{}, {"formulation": "exact"}, {"strain": "exact"}]
    for k in range(24):
        load, angle = 10.0 ** rng.uniform(-1.5, 0.7), rng.uniform(-np.pi, np.pi)
        line = bd.Line((0.0, 0.0), (0.5, 0.1))
        curve = bd.Arc(0.3, 0.5, angle=0.3) if k % 3 == 2 else line
        force = (load * np.cos(angle), load * np.sin(angle))
        build = cantilever(curve, 10.0 ** rng.uniform(1.0, 2.5), force, k % 2)
        elements = int(rng.choice([1, 1, 2, 3, 8]))
        cases.append((f"frame {k}", build, elements, options[k // 2 % 3], bd.equilibrium))
    for k in range(6):
        build = arch(rng.uniform(0.04, 0.12), rng.uniform(60.0, 200.0), rng.uniform(0.0, 0.03))
        to = {"crown.y": -rng.uniform(0.01, 0.05)}
        cases.append(
            (
                f"arch {k}",
                build,
                1 + k % 3,
                options[k % 3],
                lambda m, to=to: bd.equilibrium(m, to=to),
            )
        )
    for k in range(12):
        ends = ("cf", "hh", "ch")[k % 3]
        critical = {"cf": 2.467, "hh": 9.87, "ch": 20.19}[ends]
        if k < 6:
            build, to = (
                column(100.0, ends, 0.0, rng.uniform(0.05, 0.2)),
                critical * rng.uniform(0.7, 0.97),
            )
            run = lambda m, to=to: bd.equilibrium(m, to=to)  # noqa: E731
        else:
            build, run = (
                column(10.0 ** rng.uniform(1.0, 2.5), ends, 0.0, 0.0),
                lambda m: bd.buckling(m, 3),
            )
        cases.append((f"column {k}", build, 1 + k // 3 % 3, options[k % 3], run))
    return cases


def read_values(result: Any) -> dict[str, float]:
    """Return the values of a result by header."""
    if isinstance(result, bd.Buckling):
        return {
            f"load factor of mode {k + 1} [-]": x for k, x in enumerate(result.factors.tolist())
        }
    values = {header: float(x[-1]) for header, x in result.columns.items()}
    if isinstance(result.settings["to"], dict):
        values["load factor [-]"] = result.factor
    for point in result.critical[:1]:
        values[f"{point.kind} 1 [-]"] = point.factor
    return values


def judge(
    name: str, build: Build, elements: int, options: dict[str, Any], run: Any
) -> dict[str, Any]:
    """Return the row of a case."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begin = time.perf_counter()
        result = run(build(elements, **options))
        spent = time.perf_counter() - begin
        fine = read_values(run(build(FINER * elements, formulation="exact")))
        begin = time.perf_counter()
        table = result.errors.table() if elements else None
        cost = (time.perf_counter() - begin) / spent
    assert table is not None
    scales = 1.15 * (table["value"] - table["companion"]).abs() / table["total"]
    true = (
        pd.Series({x: abs(y - fine.get(x, np.nan)) for x, y in read_values(result).items()})
        / scales
    )
    true, stated = true.dropna(), table["total"].reindex(true.dropna().index)
    wrong, accurate = true > WRONG, true < ACCURATE
    named = wrong & (stated > WRONG)
    sized = wrong & (stated.clip(upper=1.0) / true.clip(upper=1.0)).between(0.5, 2.0)
    worst = true.idxmax() if len(true) else ""
    return {
        "case": name,
        "elements": elements,
        **{"options": " ".join(map(str, options.values()))},
        "value": worst,
        "true": true.max(),
        "stated": stated.get(worst),
        "wrong": wrong.sum(),
        "named": named.sum(),
        "sized": sized.sum(),
        "false": (accurate & (stated > WRONG)).sum(),
        "values": len(true),
        "cost": cost,
    }


def main(text: str = "", seed: str = "1") -> None:
    rows = [judge(*case) for case in draw_cases(int(seed)) if text in case[0]]
    table = pd.DataFrame(rows)
    print(table.to_string(float_format="%.3g"))
    print(table[["wrong", "named", "sized", "false", "values"]].sum().to_string())
    print("median and 90 % cost:", *table["cost"].quantile([0.5, 0.9]).round(2))


if __name__ == "__main__":
    main(*sys.argv[1:])
