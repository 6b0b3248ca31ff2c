"""Problems for timing both codes, in the form of `record/problem.schema.json`."""

import sys
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1] / "record"))

import record
from adapters.beamdae_adapter import build_mechanism
from geometry import make_curve

import beamdae as bd

Problem = dict[str, Any]
ARCH_ANGLE, ARCH_RADIUS = radians(215.0), 0.5  # m


def load_motion(name: str, damping: float, end: float) -> Problem:
    """Return a problem of the record with another damping and end [s], and its first output."""
    problem: Problem = record.load_problem(name)
    problem["time"] = {"end": end, "output_step": 0.01}
    problem["outputs"] = problem["outputs"][:1]
    for section in problem["sections"].values():
        section["damping_time"] = damping
    return problem


def build(problem: Problem, elements: int) -> bd.Mechanism:
    """Return the mechanism of a problem with exact beams."""
    return build_mechanism(problem, elements, formulation="exact")[0]


def make_structure(
    *curves: dict[str, Any],
    height: float = 0.005,
    force: tuple[float, float] = (0.0, 0.0),
    moment: float = 0.0,
    loaded: float = 1.0,
    gravity: float = 0.0,
    is_hinged: bool = False,
) -> Problem:
    """Return welded beams of steel, clamped at the start of the first one, with one load.

    `force` [EI / m^2] and `moment` [EI / m] act at the fraction `loaded` of the last beam, whose
    end may be hinged; `height` [m] is that of the section.
    """
    steel, width = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}, 0.02
    area, second_moment = width * height, width * height**3 / 12.0
    section = {"material": "steel", "area": area, "second_moment": second_moment}
    unit, last = steel["E"] * second_moment, f"beam {len(curves) - 1}"
    before: dict[str, Any] = {"body": "ground", "point": curves[0]["start"]}
    joints = []
    for k in range(len(curves)):
        start = {"body": f"beam {k}", "fraction": 0.0}
        joints.append({"type": "weld", "name": f"weld {k}", "a": before, "b": start})
        before = start | {"fraction": 1.0}
    if is_hinged:
        curve = make_curve(curves[-1])
        hinge = {"body": "ground", "point": curve.point(curve.length).tolist()}
        joints.append({"type": "revolute", "name": "hinge", "a": hinge, "b": before})
    point = {"body": last, "fraction": loaded}
    loads: list[dict[str, Any]] = []
    if any(force):
        components = [unit * x for x in force]
        loads.append({"type": "force", "name": "force", "on": point, "components": components})
    if moment:
        loads.append({"type": "moment", "name": "moment", "on": point, "law": unit * moment})
    return {
        "gravity": [0.0, -gravity],
        "materials": {"steel": steel},
        "sections": {"strip": section | {"shear_coefficient": 5.0 / 6.0}},
        "bodies": [
            {"type": "beam", "name": f"beam {k}", "section": "strip", "curve": curve}
            for k, curve in enumerate(curves)
        ],
        "joints": joints,
        "loads": loads,
        "outputs": [{"name": "point", "on": point, "quantities": ["x", "y"]}],
    }


_LINE = {"type": "line", "start": [0.0, 0.0], "end": [1.0, 0.0]}
_ARCH = {
    "type": "arc",
    "start": [-ARCH_RADIUS * sin(0.5 * ARCH_ANGLE), ARCH_RADIUS * cos(0.5 * ARCH_ANGLE)],
    "angle": 0.5 * ARCH_ANGLE,
    "length": ARCH_ANGLE * ARCH_RADIUS,
    "radius": -ARCH_RADIUS,
}
_FRAME = (
    {"type": "line", "start": [0.0, 0.0], "end": [0.0, 1.0]},
    {"type": "line", "start": [0.0, 1.0], "end": [1.0, 1.0]},
)
# The limit load of the arch is 8.97 EI / R^2 (DaDeppo & Schmidt, J. Appl. Mech. 42 (1975) 894).
STRUCTURES = {
    "tip force": make_structure(_LINE, force=(0.0, -3.0)),
    "roll-up": make_structure(_LINE, moment=2.0 * pi),
    "own weight": make_structure(_LINE, height=0.001, gravity=9.81),
    "deep arch": make_structure(
        _ARCH, force=(0.0, -7.0 / ARCH_RADIUS**2), loaded=0.5, is_hinged=True
    ),
    "frame": make_structure(*_FRAME, force=(0.0, -1.5)),
}
