"""What drives a linear model: components of loads and drivers, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.linear.linearization import Linearization
from beamdae.equations.building import build
from beamdae.equations.coordinate_map import owners_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.statement_checks import stated
from beamdae.equations.tangents import tangent
from beamdae.errors import BeamdaeError, require_sequence, short_repr, suggest
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.statements import Named

Array = np.ndarray


class Input(NamedTuple):
    """An input, and what one unit of it adds to the equations.

    Attributes
    ----------
    named
        Name and unit: "push.Fy" [N]; of drivers the acceleration they prescribe.
    force
        Added to F, (n,).
    held
        Names of the constraints it drives, and what it adds to them.
    """

    named: Named
    force: Array
    held: dict[str, float]

    @property
    def is_drive(self) -> bool:
        """Whether it prescribes a motion."""
        return bool(self.held)


def inputs_of(mechanism: Any, lin: Linearization, chosen: Sequence[str] | None) -> list[Input]:
    """Inputs of a mechanism: those chosen by the names of parts, or all."""
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    there = {name: part for name, part in parts.items() if part.inputs}
    names = (
        list(there) if chosen is None else require_sequence("linearize", "inputs", chosen, "names")
    )
    found: list[Input] = []
    for name in names:
        if not isinstance(name, str) or name not in there:
            raise BeamdaeError(
                f"linearize: no input {short_repr(name)}{suggest(name, there)}, forces, moments and "
                "drivers of the mechanism are inputs by name."
            )
        found += _inputs(mechanism, there[name], lin)
    return found


def _inputs(mechanism: Mechanism, part: Part, lin: Linearization) -> list[Input]:
    t = float(lin.time[0])
    values = [law.at(t) for law in part.laws]
    found = []
    for k, named in enumerate(part.inputs):
        # Loads and drivers are linear in their laws: any step is exact.
        step = max(1.0, abs(values[k]))
        ends = []
        for sign in (1.0, -1.0):
            moved = [x + (sign * step if j == k else 0.0) for j, x in enumerate(values)]
            ends.append(_alone(mechanism, part.following(moved), lin))
        names = ends[0][0].lam_names
        force, held = np.split((ends[0][1] - ends[1][1]) / (2.0 * step), [lin.equations.n])
        driven = {name: float(x) for name, x in zip(names, held, strict=True) if x != 0.0}
        found.append(Input(_told(part.name, named, bool(driven)), force, driven))
    return found


def _told(part: str, named: Named, drives: bool) -> Named:
    if not drives:
        return Named(f"{part}.{named.name}", named.unit)
    return Named(f"{part}.{named.name}_ddot", f"{named.unit}/s^2")


def _alone(mechanism: Mechanism, part: Part, lin: Linearization) -> tuple[EquationsOfMotion, Array]:
    """Equations of the part alone on the coordinates of all, and their residual at the state."""
    owners, e = owners_of(mechanism), lin.equations
    forces, constraints, _ = stated(part, mechanism.gravity, owners.sizes)
    own = build(
        coordinates=e.coordinates,
        q0=e.q0,
        v0=e.v0,
        length=e.length,
        parts=e.parts,
        breakpoints=(),
        time_scale=None,
        forces=forces,
        constraints=constraints,
        observables={},
        owners=owners,
    )
    return own, tangent(own, lin.time, lin.state._replace(lam=np.zeros(own.m))).residual
