"""Loads along a beam: by length, and a force that moves along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_finite,
    require_name,
    require_pair,
    require_point,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import rotate
from beamdae.parts.forces.formula_checks import (
    evaluate_formula,
    require_column,
    require_continuous_formula,
)
from beamdae.parts.forces.loads import dead_load, load_kernel, load_statement
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import (
    Formula,
    FormulaExpression,
    build_formula_kernel,
    constant_formula,
)
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local

# No force moves as slowly: times beyond this one [s] are no numbers of laws.
_MAX_TIME = 1e30


@dataclass(frozen=True)
class _LineLoad:
    """A load per length in some axes on a section; own numbers: weight, inclination, arc length."""

    axes: str

    def load(self, local: Local, turn: SX, own: Any, components: SX) -> SX:
        if self.axes == "section":
            components = rotate(own[1] + turn, components)
        return own[0] * components

    def __call__(self, local: Local, on: Any, own: Callable[[], Any], *laws: Any) -> ForceKernel:
        place, turn = on(local.q)
        components = ca.vertcat(*(law(local.time) for law in laws))
        return load_kernel(local, place, self.load(local, turn, own(), components))


@dataclass(frozen=True)
class _FormulaLineLoad(_LineLoad):
    """The same by a user's function of (s, x, y, t)."""

    part: str
    law: Callable[..., Any]

    def __call__(self, local: Local, on: Any, own: Callable[[], Any], *laws: Any) -> ForceKernel:
        place, turn = on(local.q)
        components = _evaluate_formula(
            self.part, self.law, own()[2], place[0], place[1], local.time[0]
        )
        return load_kernel(local, place, self.load(local, turn, own(), components))


def _evaluate_formula(part: str, law: Callable[..., Any], *given: SX) -> SX:
    return require_column(part, "law", evaluate_formula(part, "law", law, *given), 2)


def _require_beam(part: str, beam: Any) -> None:
    if not isinstance(beam, Beam):
        raise BeamdaeError(f"{part}: beam must be a Beam, got {short_repr(beam)}.")


@dataclass(frozen=True, eq=False)
class DistributedForce(Part):
    """Force per arc length of the undeformed axis [N/m], all along a beam.

    A dead load in the axes "inertial", one that follows the sections in the axes "section": its
    components are along the section's direction and along its left normal, so that a pressure p
    from the right is (0, p).

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    law
        Pair of laws of time: numbers, functions of t or `Law`s; or one formula `law(s, x, y, t)` of
        the arc length, the place of the deformed axis in the inertial frame and time, that gives
        such a pair.
    axes
        "inertial" or "section".

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> snow = bd.DistributedForce("snow", beam, (0.0, -12.0))
    """

    is_load = True
    name: str
    beam: Beam
    law: Any
    axes: str = "inertial"

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("DistributedForce", self.name))
        _require_beam(self.name, self.beam)
        set_fields(self, axes=require_choice(self.name, "axes", self.axes, ("inertial", "section")))
        if callable(self.law) and not isinstance(self.law, Law):
            given = [SX.sym(x) for x in ("s", "x", "y", "t")]
            require_continuous_formula(
                self.name, "law", _evaluate_formula(self.name, self.law, *given), given
            )
        else:
            what = "a pair of laws (fx, fy) or a function of (s, x, y, t)"
            set_fields(self, law=require_pair(self.name, "law", self.law, what))
            _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Both components over time, if they depend on nothing else."""
        if callable(self.law):
            return ()
        return tuple(as_law(self.name, component) for component in self.law)

    @property
    def load_distribution(self) -> str:
        """Per length."""
        return "line"

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The load at the points at which inertia is integrated."""
        mesh = self.beam.mesh
        kind = (
            _FormulaLineLoad(self.axes, self.name, self.law)
            if callable(self.law)
            else _LineLoad(self.axes)
        )
        laws = [law.formula for law in self.laws]
        xi, _ = gauss_points(mesh.nodes)
        weights, _ = mesh.gauss(mesh.nodes)
        element = np.repeat(np.arange(mesh.elements), mesh.nodes)
        places = (element + 0.5 * (np.tile(xi, mesh.elements) + 1.0)) / mesh.elements
        shared: dict[FormulaExpression, ForceKernel] = {}
        said = []
        for s, weight in zip((places * self.beam.length).tolist(), weights.tolist(), strict=True):
            on = self.beam.at(s)
            functions = (on.checked_kinematics, constant_formula(weight, on.inclination, s), *laws)
            kernel, data = self._kernel(kind, functions, on.size, shared)
            said.append(ForceStatement(self.name, kernel, (on.piece,), data))
        return said

    def _kernel(
        self, kind: Any, functions: Any, size: int, shared: dict[FormulaExpression, ForceKernel]
    ) -> tuple[ForceKernel, np.ndarray]:
        """The kernel of one point: with a function of the user's own the points alone share it."""
        combined, numbers = FormulaExpression.of(kind, functions)
        if combined.is_shareable and not callable(self.law):
            return build_formula_kernel(kind, functions, size)
        if combined not in shared:
            # Points of a kinematics without formulas have kernels of their own, which are compared.
            alike = isinstance(functions[0], Formula)
            shared[combined] = replace(combined(Local(size, len(numbers))), reused=alike)
        return shared[combined], numbers[:, None]


@dataclass(frozen=True)
class _NodalForce:
    """What a node of an element has of a force at a + b t, Lagrange's polynomial of so many nodes.

    Numbers: the force over the product of distances, a, b, and the other nodes.
    """

    nodes: int

    def __call__(self, t: Any, numbers: Any) -> Any:
        at, value = numbers[1] + numbers[2] * t, numbers[0]
        for k in range(self.nodes - 1):
            value = value * (at - numbers[3 + k])
        return value


def _zero_force(t: Any, numbers: Any) -> Any:
    return 0.0 * t


@dataclass(frozen=True, eq=False)
class MovingForce(Part):
    """A constant force in the inertial frame that moves along a beam at a constant speed.

    At the time t it acts at the arc length start + speed t, and not at all off the beam. Between
    nodes it is given to those of the element by their shape functions; integrators stop where it
    goes from one element to the next.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    force
        (Fx, Fy) [N].
    speed
        Of arc length [m/s]; negative from the end to the start.
    start
        Arc length at t = 0 [m], also off the beam.
    """

    is_load = True
    name: str
    beam: Beam
    force: tuple[float, float]
    speed: float
    start: float = 0.0

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("MovingForce", self.name))
        _require_beam(self.name, self.beam)
        set_fields(
            self,
            force=require_point(self.name, "force", self.force),
            speed=require_finite(self.name, "speed", self.speed),
            start=require_finite(self.name, "start", self.start),
        )
        if self.speed == 0.0:
            raise BeamdaeError(f"{self.name}: speed must not be zero, take a Force on beam.at(s).")
        if (abs(self.start) + self.beam.length) / abs(self.speed) > _MAX_TIME:
            raise BeamdaeError(
                f"{self.name}: speed must pass the beam within {_MAX_TIME:g} s, got {self.speed:g}."
            )

    @cached_property
    def _shares(self) -> list[tuple[Law, Law]]:
        """What each node of the beam has of both components."""
        mesh, found = self.beam.mesh, []
        for node in range(mesh.node_count):
            step = mesh.nodes - 1
            elements = {min(node // step, mesh.elements - 1), max((node - 1) // step, 0)}
            ascending = sorted(elements, reverse=self.speed < 0.0)
            x, y = (self._law(node, ascending, component) for component in self.force)
            found.append((x, y))
        return found

    def _law(self, node: int, elements: list[int], force: float) -> Law:
        """The share of a node in one element after the other."""
        mesh = self.beam.mesh
        length = self.beam.length / mesh.elements
        xi = np.linspace(-1.0, 1.0, mesh.nodes)
        pieces = []
        for element in elements:
            own = node - element * (mesh.nodes - 1)
            others = np.delete(xi, own)
            first = 2.0 * (self.start / length - element) - 1.0
            numbers = (force / np.prod(xi[own] - others), first, 2.0 * self.speed / length, *others)
            pieces.append(Formula(_NodalForce(mesh.nodes), tuple(map(float, numbers))))
        bounds = np.unique([[x, x + 1] for x in elements]) * length
        times = np.sort((bounds - self.start) / self.speed)
        nothing = Formula(_zero_force)
        lasting = length / abs(self.speed)
        return Law((nothing, *pieces, nothing), tuple(map(float, times)), lasting)

    @property
    def laws(self) -> tuple[Law, ...]:
        """One that stops integrators where the force goes from one element to the next."""
        mesh = self.beam.mesh
        bounds = np.linspace(0.0, self.beam.length, mesh.elements + 1)
        times = np.sort((bounds - self.start) / self.speed)
        lasting = self.beam.length / mesh.elements / abs(self.speed)
        pieces = (Formula(_zero_force),) * (len(times) + 1)
        return (Law(pieces, tuple(map(float, times)), lasting),)

    @property
    def load_distribution(self) -> str:
        """Between the nodes that have shares of it."""
        return "shares"

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The shares of all nodes."""
        places = self.beam.mesh.node_arc_lengths.tolist()
        return [
            load_statement(self.name, self.beam.at(s), dead_load, laws)
            for s, laws in zip(places, self._shares, strict=True)
        ]
