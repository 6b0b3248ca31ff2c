"""Loads along a beam: force per length, and a force that moves along the beam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam, require_beam
from beamdae.beams.elements import NODE_SIZE, PointElement
from beamdae.beams.shape_functions import node_positions
from beamdae.errors import (
    BeamdaeError,
    choice_of,
    convert_fields,
    require_finite,
    require_pair,
    require_point,
    set_fields,
)
from beamdae.parts.attachments import rotate
from beamdae.parts.forces.formula_checks import (
    evaluate_formula,
    require_column,
    require_continuous_formula,
)
from beamdae.parts.forces.load_observables import ObservableBeamLoad, ObservablePower
from beamdae.parts.forces.loads import Force, load_kernel
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.formula import (
    Formula,
    FormulaExpression,
    cache_kernels,
    constant_formula,
)
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
)

# Maximum time that a moving force may take to pass the beam [s]; keeps the times of laws finite.
_MAX_PASSAGE_TIME = 1e30


@dataclass(frozen=True)
class _LineLoad:
    """Line load at a quadrature point.

    Attributes
    ----------
    axes
        Axes of the components.
    part, law
        Name of the part, and function of (s, x, y, t) of the user; None if time laws give the
        components.
    """

    axes: str
    part: str = ""
    law: Callable[..., Any] | None = None

    def __call__(
        self, local: Local, motion: Any, numbers: Callable[[], Any], *laws: Any
    ) -> ForceKernel:
        position, rotation = motion(local.q)
        # Quadrature weight [m], inclination of the section [rad] and arc length [m].
        weight, inclination, s = (numbers()[k] for k in range(3))
        if self.law is None:
            load = ca.vertcat(*(law(local.time) for law in laws))
        else:
            load = _evaluate_law(self.part, self.law, s, *ca.vertsplit(position), local.time[0])
        if self.axes == "section":
            load = rotate(inclination + rotation, load)
        return load_kernel(local, position, weight * load)


def _evaluate_law(part: str, law: Callable[..., Any], *arguments: SX) -> SX:
    return require_column(part, "law", evaluate_formula(part, "law", law, *arguments), 2)


@dataclass(frozen=True, eq=False)
class DistributedForce(ObservableBeamLoad):
    """Distributed force along a whole beam, per arc length of the undeformed axis [N/m].

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    law
        Components of the load [N/m]: a pair of time laws (numbers, functions of t or `Law`s), or
        a formula `law(s, x, y, t)` that returns the two components, where s [m] is the arc length,
        (x, y) [m] the position of the deformed axis in the inertial frame and t [s] the time.
    axes
        "inertial" (default) for a dead load, or "section" for a follower load. The first component
        of a follower load is normal to the section and the second lies in the section, positive to
        the left; a force p per length from the right is (0, p).

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `beam` is not a Beam, `axes` is unknown, or `law` is neither a pair of
        valid laws nor a formula that returns two components without jumps.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> snow = bd.DistributedForce("snow", beam, (0.0, -12.0))
    """

    symbol = "distributed force"
    is_load = True
    name: str
    beam: Beam
    law: Any
    axes: str = "inertial"
    load_distribution = "line"

    def __post_init__(self) -> None:
        convert_fields(self)
        require_beam(self.name, self.beam)
        convert_fields(self, axes=choice_of("inertial", "section"))
        if callable(self.law) and not isinstance(self.law, Law):
            arguments = [SX.sym(x) for x in ("s", "x", "y", "t")]
            components = _evaluate_law(self.name, self.law, *arguments)
            require_continuous_formula(self.name, "law", components, arguments)
        else:
            expected = "a pair of laws (fx, fy) or a function of (s, x, y, t)"
            set_fields(self, law=require_pair(self.name, "law", self.law, expected))
            _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time laws of both components; empty for a formula of (s, x, y, t)."""
        if callable(self.law):
            return ()
        return tuple(as_law(self.name, component) for component in self.law)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the loads at the inertia points of all elements."""
        mesh, kinematics = self.beam.mesh, self.beam.kinematics
        of_user = (self.name, self.law) if callable(self.law) else ()
        kind = _LineLoad(self.axes, *of_user)
        laws = [law.formula for law in self.laws]
        arc_lengths, (weights, _) = mesh.gauss_arc_lengths(mesh.nodes), mesh.gauss(mesh.nodes)
        sections = [kinematics.placement(s) for s in arc_lengths.tolist()]
        general = max((x.motion for x in sections), key=lambda x: len(x.numbers))
        points = []
        for s, weight, at in zip(arc_lengths.tolist(), weights.tolist(), sections, strict=True):
            # Numbers that are missing at some points are an offset of zero.
            missing = [0.0] * (len(general.numbers) - len(at.motion.numbers))
            motion = replace(general, numbers=(*at.motion.numbers, *missing))
            constants = constant_formula(weight, at.inclination, s)
            functions: list[Callable[..., Any]] = [motion, constants, *laws]
            expression, numbers = FormulaExpression.of(kind, functions)
            points.append(numbers)
        # A kernel with a user formula is identified by comparison with those of equal models.
        is_shared = not callable(self.law) and all(isinstance(x, Formula) for x in laws)
        build = _share_line_load_kernel if is_shared else _build_line_load_kernel
        kernel = build(kinematics.element, expression, len(points[0]), is_shared)
        data = np.reshape(points, (mesh.elements, -1)).T
        piece = Piece(self.beam, kinematics.operator)
        return [ForceStatement(self.name, kernel, (piece,), data)]


def _build_line_load_kernel(
    element: PointElement, expression: FormulaExpression, count: int, is_shared: bool
) -> ForceKernel:
    """Return the kernel of loads with `count` numbers each at the inertia points of an element."""
    local = Local(element.size, count * element.nodes)
    kernel = expression(Local(element.frame_size + NODE_SIZE, count))
    numbers = ca.vertsplit(local.data, count)
    points = ForceKernel.of_points(local, element.mass_points(kernel, numbers))
    return replace(points, reused=is_shared)


_share_line_load_kernel = cache_kernels(_build_line_load_kernel)


@dataclass(frozen=True)
class _NodalForce:
    """Nodal force of an element while a moving force is at the local coordinate a + b t.

    The force is distributed by the Lagrange polynomial of the node. `numbers` are (factor, a, b,
    *others), where `others` are the local coordinates of the other nodes and the factor is the
    force divided by the product of (node - other) over these coordinates.
    """

    nodes: int

    def __call__(self, t: Any, numbers: Any) -> Any:
        value, first, rate = (numbers[k] for k in range(3))
        xi = first + rate * t
        for k in range(self.nodes - 1):
            value = value * (xi - numbers[3 + k])
        return value


def _zero_force(t: Any, numbers: Any) -> Any:
    return 0.0 * t


@dataclass(frozen=True, eq=False)
class MovingForce(ObservablePower):
    """Constant force in the inertial frame that moves along a beam at constant speed.

    At time t, the force acts at the arc length start + speed * t; the force is zero while this
    place is beyond the ends of the beam. The shape functions of the element distribute the force to
    the nodes. Integrators stop and restart when the force passes an end of an element.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    force
        Components (Fx, Fy) in the inertial frame [N].
    speed
        Rate of the arc length [m/s], not zero; negative for motion from the end to the start.
    start
        Arc length at t = 0 [m]; may lie beyond the ends of the beam.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `beam` is not a Beam, `force` is not a pair of finite numbers, `speed`
        or `start` is not finite, or `speed` is zero or too small to pass the beam within 1e30 s.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("bridge", bd.Line((0.0, 0.0), (10.0, 0.0)), strip)
    >>> wheel = bd.MovingForce("wheel", beam, (0.0, -20.0), speed=5.0)
    """

    symbol = "moving force"
    is_load = True
    moves_along_beam = True
    name: str
    beam: Beam
    force: tuple[float, float]
    speed: float
    start: float = 0.0
    load_distribution = "shares"

    def __post_init__(self) -> None:
        convert_fields(self)
        require_beam(self.name, self.beam)._has_moving_load = True
        convert_fields(self, force=require_point, speed=require_finite, start=require_finite)
        if self.speed == 0.0:
            raise BeamdaeError(
                f"{self.name}: speed must not be zero; for a force at rest, use a Force on "
                "beam.at(s)."
            )
        if (abs(self.start) + self.beam.length) / abs(self.speed) > _MAX_PASSAGE_TIME:
            raise BeamdaeError(
                f"{self.name}: at speed = {self.speed:g} m/s, the force needs more than "
                f"{_MAX_PASSAGE_TIME:g} s to pass the beam; increase the magnitude of speed or "
                "reduce the magnitude of start."
            )

    @property
    def _nodal_laws(self) -> list[tuple[Law, Law]]:
        mesh, laws = self.beam.mesh, []
        for node in range(mesh.node_count):
            step = mesh.nodes - 1
            elements = {min(node // step, mesh.elements - 1), max((node - 1) // step, 0)}
            in_passing_order = sorted(elements, reverse=self.speed < 0.0)
            x, y = (self._nodal_law(node, in_passing_order, component) for component in self.force)
            laws.append((x, y))
        return laws

    def _nodal_law(self, node: int, elements: list[int], force: float) -> Law:
        """Return the law of one force component on a node that belongs to `elements`."""
        mesh = self.beam.mesh
        xi = node_positions(mesh.nodes)
        pieces = []
        for element in elements:
            local_node = node - element * (mesh.nodes - 1)
            others = np.delete(xi, local_node)
            length = mesh.element_lengths[element]
            first = 2.0 * (self.start - mesh.element_bounds[element]) / length - 1.0
            factor = force / np.prod(xi[local_node] - others)
            numbers = (factor, first, 2.0 * self.speed / length, *others)
            pieces.append(Formula(_NodalForce(mesh.nodes), tuple(map(float, numbers))))
        bounds = mesh.element_bounds[np.unique([[x, x + 1] for x in elements])]
        times = np.sort((bounds - self.start) / self.speed)
        no_force = Formula(_zero_force)
        time_scale = float(min(mesh.element_lengths[elements])) / abs(self.speed)
        return Law((no_force, *pieces, no_force), tuple(map(float, times)), time_scale)

    @property
    def laws(self) -> tuple[Law, ...]:
        """A zero law whose breakpoints are the times at which the force passes element ends."""
        mesh = self.beam.mesh
        times = np.sort((mesh.element_bounds - self.start) / self.speed)
        time_scale = float(mesh.element_lengths.min()) / abs(self.speed)
        pieces = (Formula(_zero_force),) * (len(times) + 1)
        return (Law(pieces, tuple(map(float, times)), time_scale),)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return one load statement per node of the beam."""
        arc_lengths = self.beam.mesh.node_arc_lengths.tolist()
        return [
            statement
            for s, laws in zip(arc_lengths, self._nodal_laws, strict=True)
            for statement in Force(self.name, self.beam.at(s), laws).forces(gravity)
        ]
