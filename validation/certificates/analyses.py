"""Coverage, tightness and cost of the certificates of equilibria, modes and periodic motions.

    python validation/certificates/analyses.py [--summary] [CASE ...]

Each case is certified at 1 % and 0.1 %, periodic motions at 0.1 %. The reference is a closed form,
Reissner's cantilever by shooting, or the same model with at least 32 geometrically exact elements
per beam (16 for periodic motions) that end at the attachments. Columns at rest are left out.
Results are in results/analyses.csv (a row per column).
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

VALIDATION = Path(__file__).parents[1]
sys.path[:0] = [str(VALIDATION), str(VALIDATION.parent / "models")]

import numpy as np
import pandas as pd
from formulations.shooting import solve_cantilever
from shallow_arch import shallow_arch
from tolerances.flexible_mechanisms import tuning_fork

import beamdae as bd
from beamdae.beams.remeshing import choose_base_meshes, with_meshes
from beamdae.results.columns import largest_of_kind

RESULTS = Path(__file__).parent / "results"
ACCURACIES = (0.01, 0.001)
STATIC_ELEMENTS, PERIODIC_ELEMENTS = 32, 16  # of the references
PERIODIC_SETTINGS = {"integrator": bd.Radau(1e-6), "settle": 0}
REST_RATIO = 1e-9  # scale relative to the largest one in the same unit
STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
STRIP = bd.Section.rectangle(STEEL, width=0.02, height=0.004, damping=1e-4)
BLOCK = bd.Section.rectangle(STEEL, width=0.02, height=0.1)  # a thick beam
LENGTH = 1.0


@dataclass(frozen=True)
class AnalysisCase:
    """An analysis with a reference.

    Attributes
    ----------
    name
        Name of the case.
    build
        Returns the mechanism.
    certify
        Certifies a mechanism with a given accuracy.
    analyze
        Returns the values of a mechanism by column, without a certificate.
    closed_form
        Values of the columns for which a reference without finite elements exists, or None.
    elements
        Number of elements of each beam of the reference by finite elements.
    accuracies
        Required accuracies.
    """

    name: str
    build: Callable[[], bd.Mechanism]
    certify: Callable[[bd.Mechanism, float], bd.AnalysisCertificate]
    analyze: Callable[[bd.Mechanism], dict[str, float]]
    closed_form: Callable[[], dict[str, float]] | None = None
    elements: int = STATIC_ELEMENTS
    accuracies: tuple[float, ...] = ACCURACIES

    def reference(self) -> dict[str, float]:
        """Return the reference values by column."""
        if self.closed_form is not None:
            return self.closed_form()
        mechanism = self.build()
        meshes = {}
        for name, base in choose_base_meshes(mechanism, 2).items():
            halvings = int(np.ceil(np.log2(self.elements / base.mesh.elements)))
            meshes[name] = base.refined(halvings)
        return self.analyze(with_meshes(mechanism, meshes, dict.fromkeys(meshes, "exact")))


def clamped_strip(force=(0.0, 0.0), moment=0.0, section=STRIP, curve=None) -> bd.Mechanism:
    """Return a cantilever with a force [N] and a moment [N m] at its end."""
    mech = bd.Mechanism()
    curve = bd.Line((0.0, 0.0), (LENGTH, 0.0)) if curve is None else curve
    beam = mech.add(bd.Beam("beam", curve, section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(*curve.point(0.0)), beam.start))
    mech.add(bd.Force("force", beam.end, force))
    mech.add(bd.Moment("moment", beam.end, moment))
    mech.observe("tip", beam.end)
    return mech


def loaded_span() -> bd.Mechanism:
    """Return a strip clamped at one end and simply supported elsewhere, loaded at two sections."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (LENGTH, 0.0)), STRIP, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("support", mech.ground.at(0.0, 0.0), beam.at(0.62), (1.0, 0.0)))
    mech.add(bd.Force("load", beam.at(0.3), (0.0, -60.0)))
    mech.add(bd.PointMass("mass", 0.5, on=beam.end))
    mech.observe("loaded", beam.at(0.3))
    mech.observe("tip", beam.end)
    return mech


def portal() -> bd.Mechanism:
    """Return a portal frame of three strips under a load at an eave and at the middle."""
    mech = bd.Mechanism()
    corners = ((0.0, 0.0), (0.0, 0.6), (0.8, 0.6), (0.8, 0.0))
    names = ("left", "top", "right")
    sides = zip(names, corners, corners[1:], strict=False)
    beams = [mech.add(bd.Beam(n, bd.Line(a, b), STRIP, elements=2)) for n, a, b in sides]
    mech.add(bd.Weld("left foot", mech.ground.at(*corners[0]), beams[0].start))
    mech.add(bd.Weld("left eave", beams[0].end, beams[1].start))
    mech.add(bd.Weld("right eave", beams[1].end, beams[2].start))
    mech.add(bd.Weld("right foot", mech.ground.at(*corners[3]), beams[2].end))
    mech.add(bd.Force("wind", beams[0].end, (25.0, 0.0)))
    mech.add(bd.Force("snow", beams[1].at(0.4), (0.0, -40.0)))
    mech.observe("eave", beams[0].end)
    mech.observe("middle", beams[1].at(0.4))
    return mech


def pinned_block() -> bd.Mechanism:
    """Return a thick beam between a pin and a roller."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (LENGTH, 0.0)), BLOCK, elements=2))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("roller", mech.ground.at(0.0, 0.0), beam.end, (1.0, 0.0)))
    mech.observe("middle", beam.at(0.5 * LENGTH))
    return mech


def shaken_strip() -> bd.Mechanism:
    """Return a cantilever with a mass whose harmonic load bends it by a sixth of its length."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.004, damping=1e-3)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (LENGTH, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointMass("mass", 0.2, on=beam.at(0.7)))
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(3.0, frequency=4.0))))
    mech.observe("tip", beam.end)
    return mech


def pinned_block_frequencies() -> dict[str, float]:
    """Return bending frequencies of the Timoshenko beam and longitudinal ones, in order [Hz]."""
    mass, inertia = STEEL.rho * BLOCK.area, STEEL.rho * BLOCK.EI / STEEL.E
    frequencies = []
    for n in range(1, 8):
        k = n * np.pi / LENGTH
        # (mass w^2 - GA k^2)(inertia w^2 - EI k^2 - GA) - (GA k)^2 = 0
        a = mass * inertia
        b = -(mass * (BLOCK.EI * k**2 + BLOCK.GA) + inertia * BLOCK.GA * k**2)
        c = BLOCK.GA * BLOCK.EI * k**4
        frequencies += np.sqrt(np.roots([a, b, c])).tolist()
        # Longitudinal: fixed at the pin, free at the roller.
        frequencies.append((n - 0.5) * np.pi / LENGTH * np.sqrt(BLOCK.EA / mass))
    ordered = np.sort(np.real(frequencies)) / (2.0 * np.pi)
    return {f"mode {k} [Hz]": float(f) for k, f in enumerate(ordered[:6], start=1)}


def tip_columns(tip: np.ndarray) -> dict[str, float]:
    """Return the position and rotation of the end by column."""
    return dict(zip(("tip.x [m]", "tip.y [m]", "tip.angle [rad]"), tip.tolist(), strict=True))


def shoot(force, moment, section=STRIP, curve=None) -> dict[str, float]:
    """Return the end of a cantilever from the differential equations of the beam."""
    curve = bd.Line((0.0, 0.0), (LENGTH, 0.0)) if curve is None else curve
    positions = np.array([0.0, curve.length])
    return tip_columns(solve_cantilever(curve, section, force, moment, positions).tip)


def equilibrium_case(name: str, build: Any, closed_form: Any = None) -> AnalysisCase:
    def analyze(mechanism: bd.Mechanism) -> dict[str, float]:
        path = bd.equilibrium(mechanism)
        return {column: float(values[-1]) for column, values in path.columns.items()}

    return AnalysisCase(name, build, bd.certify_equilibrium, analyze, closed_form)


def modes_case(name: str, build: Any, closed_form: Any = None, count: int = 6) -> AnalysisCase:
    def certify(mechanism: bd.Mechanism, accuracy: float) -> bd.AnalysisCertificate:
        return bd.certify_modes(mechanism, accuracy, n=count)

    def analyze(mechanism: bd.Mechanism) -> dict[str, float]:
        frequencies = bd.modes(mechanism, n=count).frequencies.tolist()
        return {f"mode {k} [Hz]": f for k, f in enumerate(frequencies, start=1)}

    return AnalysisCase(name, build, certify, analyze, closed_form)


def periodic_case(name: str, build: Any, period: float) -> AnalysisCase:
    def certify(mechanism: bd.Mechanism, accuracy: float) -> bd.AnalysisCertificate:
        return bd.certify_periodic(mechanism, period, accuracy, **PERIODIC_SETTINGS)

    def analyze(mechanism: bd.Mechanism) -> dict[str, float]:
        motion = bd.periodic(mechanism, period, **PERIODIC_SETTINGS)
        return motion.amplitudes()["half range"].to_dict()

    # A search takes up to a minute; both accuracies need the same meshes.
    settings = {"elements": PERIODIC_ELEMENTS, "accuracies": (min(ACCURACIES),)}
    return AnalysisCase(name, build, certify, analyze, **settings)


_ARC = bd.Arc(0.5, 0.5 * np.pi * 0.5)
CASES = (
    equilibrium_case(
        "cantilever_moment",
        lambda: clamped_strip(moment=-40.0),
        lambda: shoot((0.0, 0.0), -40.0),
    ),
    equilibrium_case(
        "cantilever_force",
        lambda: clamped_strip((0.0, -60.0)),
        lambda: shoot((0.0, -60.0), 0.0),
    ),
    equilibrium_case(
        "cantilever_thick",
        lambda: clamped_strip((0.0, -2e5), section=BLOCK),
        lambda: shoot((0.0, -2e5), 0.0, section=BLOCK),
    ),
    equilibrium_case(
        "cantilever_arc",
        lambda: clamped_strip((30.0, -40.0), 5.0, curve=_ARC),
        lambda: shoot((30.0, -40.0), 5.0, curve=_ARC),
    ),
    equilibrium_case("loaded_span", loaded_span),
    equilibrium_case("portal", portal),
    equilibrium_case("shallow_arch", shallow_arch),
    modes_case("pinned_block", pinned_block, pinned_block_frequencies),
    modes_case("cantilever", clamped_strip),
    modes_case("cantilever_arc_modes", lambda: clamped_strip(curve=_ARC)),
    modes_case("loaded_span_modes", loaded_span),
    modes_case("portal_modes", portal),
    modes_case("shallow_arch_modes", lambda: shallow_arch(load=0.0, damping=0.0)),
    modes_case("tuning_fork", tuning_fork),
    periodic_case("shaken_strip", shaken_strip, 0.25),
)


def run_case(case: AnalysisCase) -> list[dict]:
    """Return one row per column and accuracy."""
    rows = []
    begin = time.perf_counter()
    reference = case.reference()
    reference_seconds = time.perf_counter() - begin
    for accuracy in case.accuracies:
        begin = time.perf_counter()
        certificate = case.certify(case.build(), accuracy)
        seconds = time.perf_counter() - begin
        budget = certificate.budget
        scales = budget["scale"].to_numpy()
        moves = scales > REST_RATIO * largest_of_kind(budget.index, scales)
        for column in budget.index[moves]:
            row = budget.loc[column]
            true = abs(reference.get(column, np.nan) - row["value"]) / row["scale"]
            rows.append(
                {
                    "case": case.name,
                    "analysis": certificate.name,
                    "accuracy": accuracy,
                    "column": column,
                    "status": certificate.status.kind,
                    "value": row["value"],
                    "scale": row["scale"],
                    "mesh": row["mesh"],
                    "true error": true,
                    "reference": "closed form" if case.closed_form else "fine mesh",
                    "certified": row["certified"],
                    "elements": sum(certificate.elements.values()),
                    "meshes": certificate.meshes,
                    "seconds": seconds,
                    "reference seconds": reference_seconds,
                }
            )
    return rows


def summarize(table: pd.DataFrame) -> pd.DataFrame:
    """Return coverage and tightness by analysis and accuracy."""
    rows = []
    required = table[(table["certified"] == "yes") & table["true error"].notna()]
    for (analysis, accuracy), x in required.groupby(["analysis", "accuracy"], sort=False):
        ratio = x["mesh"] / x["true error"]
        rows.append(
            {
                "analysis": analysis,
                "accuracy": accuracy,
                "cases": x["case"].nunique(),
                "columns": len(x),
                "within budget": float((x["true error"] <= x["mesh"]).mean()),
                "within accuracy": float((x["true error"] <= accuracy).mean()),
                "budget / error, median": float(ratio.median()),
                "meshes, median": float(x.groupby("case")["meshes"].first().median()),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help="names of cases")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--summary", action="store_true", help="print the stored results")
    arguments = parser.parse_args()
    if arguments.summary:
        print(summarize(pd.read_csv(arguments.out / "analyses.csv")).T.to_string())
        return
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    rows = []
    for case in CASES:
        if arguments.cases and case.name not in arguments.cases:
            continue
        begin = time.perf_counter()
        try:
            rows += run_case(case)
        except bd.BeamdaeError as problem:
            print(f"{case.name}: {problem}", flush=True)
            continue
        print(case.name, f"{time.perf_counter() - begin:.1f} s", flush=True)
        arguments.out.mkdir(exist_ok=True)
        pd.DataFrame(rows).to_csv(arguments.out / "analyses.csv", index=False)
    print(summarize(pd.DataFrame(rows)).T.to_string())


if __name__ == "__main__":
    main()
