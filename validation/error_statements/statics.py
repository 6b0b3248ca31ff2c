"""Stated and true errors of equilibria and buckling loads.

Mechanisms are drawn at random; references have geometrically exact beams and eight times the
elements.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from error_statements.cases import Comparison, judge_columns
from error_statements.mechanisms import STEEL

import beamdae as bd

SEEDS, FINER = (1, 2), 8
OPTIONS: list[dict[str, Any]] = [{"strain": "green"}, {"formulation": "exact"}, {}]


class Case(NamedTuple):
    """Name, builder of a mechanism, settings of its beams, and the analysis."""

    name: str
    build: Callable[..., bd.Mechanism]
    elements: int
    options: dict[str, Any]
    run: Callable[[bd.Mechanism], Any]


def frame(curve: Any, slenderness: float, force: tuple[float, ...], has_tie: bool) -> Any:
    """Return a builder of clamped beams, perhaps tied, under a force relative to EI / L^2."""
    section = bd.Section.rectangle(STEEL, 0.02, curve.length / slenderness)

    def build(elements: int, **options: Any) -> bd.Mechanism:
        mech = bd.Mechanism()
        beam = mech.add(bd.Beam("beam", curve, section, elements, **options))
        mech.add(bd.Weld("clamp", mech.ground.at(*curve.start), beam.start))
        if has_tie:
            top = tuple(map(float, beam.end.point))
            foot = (top[0] + 0.3, top[1] - 0.4)
            tie = mech.add(bd.Beam("tie", bd.Line(top, foot), section, elements, **options))
            mech.add(bd.Weld("corner", beam.end, tie.start))
            mech.add(bd.Revolute("foot", mech.ground.at(*foot), tie.end))
        unit = section.EI / curve.length**2
        mech.add(bd.Force("load", beam.end, (unit * force[0], unit * force[1])))
        mech.observe("tip", beam.end)
        mech.observe("clamp", beam.section_forces(0.0))
        mech.observe("middle", beam.section_forces(0.4 * curve.length))
        return mech

    return build


def arch(rise: float, slenderness: float, offset: float) -> Any:
    """Return a builder of clamped arches under a force beside the crown."""
    angle, section = 4.0 * np.arctan(2.0 * rise), bd.Section.rectangle(STEEL, 0.02, 1 / slenderness)
    radius = 0.5 / np.sin(0.5 * angle)
    curve = bd.Arc(-radius, radius * angle, angle=0.5 * angle)

    def build(elements: int, **options: Any) -> bd.Mechanism:
        mech = bd.Mechanism()
        beam = mech.add(bd.Beam("arch", curve, section, 2 * elements, **options))
        mech.add(bd.Weld("left", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Weld("right", mech.ground.at(*map(float, beam.end.point)), beam.end))
        mech.add(bd.Force("load", beam.at(0.5 * curve.length + offset), (0.0, -section.EI)))
        mech.observe("crown", beam.at(0.5 * curve.length))
        mech.observe("left", beam.section_forces(0.0))
        return mech

    return build


def draw_cases(seed: int) -> Iterator[Case]:
    """Yield the cases of a seed."""
    rng = np.random.default_rng(seed)
    for k in range(24):
        load, angle = 10.0 ** rng.uniform(-1.5, 0.7), rng.uniform(-np.pi, np.pi)
        curve = bd.Arc(0.3, 0.5, angle=0.3) if k % 3 == 2 else bd.Line((0.0, 0.0), (0.5, 0.1))
        force = (load * np.cos(angle), load * np.sin(angle))
        build = frame(curve, 10.0 ** rng.uniform(1.0, 2.5), force, k % 2 == 1)
        elements = int(rng.choice([1, 1, 2, 3, 8]))
        yield Case(f"frame {k}", build, elements, OPTIONS[k // 2 % 3], bd.equilibrium)
    for k in range(6):
        build = arch(rng.uniform(0.04, 0.12), rng.uniform(60.0, 200.0), rng.uniform(0.0, 0.03))
        to = {"crown.y": -rng.uniform(0.01, 0.05)}
        run = lambda mech, to=to: bd.equilibrium(mech, to=to)  # noqa: E731
        yield Case(f"arch {k}", build, 1 + k % 3, OPTIONS[k % 3], run)
    for k in range(12):
        side = rng.uniform(0.01, 0.1) * (k % 2)
        column = bd.Line((0.0, 0.0), (0.0, 1.0))
        build = frame(column, 10.0 ** rng.uniform(1.3, 2.3), (side, -1.0), k % 4 > 1)
        to = 2.467 * rng.uniform(0.7, 0.97)
        run = lambda mech, to=to: bd.equilibrium(mech, to=to)  # noqa: E731
        run = run if side else lambda mech: bd.buckling(mech, 3)
        yield Case(f"column {k}", build, 1 + k % 3, OPTIONS[k % 3], run)


def read_values(result: Any) -> dict[str, float]:
    """Return the values of a result by header."""
    if isinstance(result, bd.results.Buckling):
        return {f"load factor of mode {k} [-]": x for k, x in enumerate(result.factors, 1)}
    values = {header: float(x[-1]) for header, x in result.columns.items()}
    points = {f"{x.kind} 1 [-]": x.factor for x in result.critical[:1]}
    return values | points | {"load factor [-]": result.factor}


def judge(case: Case) -> Comparison:
    """Compare the stated errors of the values of a case with the true ones."""
    table = case.run(case.build(case.elements, **case.options)).errors.table()
    fine = read_values(case.run(case.build(FINER * case.elements, formulation="exact")))
    scales = 1.15 * (table["value"] - table["companion"]).abs() / table["total"]
    true = ((table["value"] - pd.Series(fine)).abs() / scales).dropna()
    return judge_columns(true, true, true, table["total"].reindex(true.index))


def list_cases() -> dict[str, Callable[[], Comparison]]:
    """Return the cases by name."""
    drawn = {f"{case.name}, seed={seed}": case for seed in SEEDS for case in draw_cases(seed)}
    return {name: partial(judge, case) for name, case in drawn.items()}
