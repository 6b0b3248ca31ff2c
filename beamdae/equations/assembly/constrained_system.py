"""Constrained systems given directly by CasADi expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby, pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.building import Statements, build_terms
from beamdae.equations.assembly.coordinate_map import CoordinateMap
from beamdae.equations.assembly.expressions import (
    KIND,
    Expressions,
    parse_header,
    parse_names,
    parse_numbers,
)
from beamdae.equations.assembly.statement_checks import require_unique
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.equations.singular_laws import select_unbounded_laws
from beamdae.errors import (
    BeamdaeError,
    require_entries,
    require_finite,
    require_name,
    require_positive,
    require_sequence,
    require_unit,
    set_fields,
    short_repr,
)
from beamdae.model_functions import HasOrigin
from beamdae.parts.events import Event
from beamdae.read_only import read_only_copy
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    NonholonomicKernel,
    Piece,
    Quantity,
    Variable,
)

_CONSTRAINTS = "constraint"  # part name of all constraints
_EXPRESSIONS = "a dict of expressions by header"


@dataclass(frozen=True, eq=False)
class ConstrainedSystem(HasOrigin):
    """Constrained system M(t, q) q'' + G^T lam = f(t, q, q'), 0 = g(t, q), G = dg/dq.

    The equations are CasADi expressions, for mechanics beyond the built-in parts. Like mechanisms,
    they are assembled into `EquationsOfMotion`, which integrators and studies accept. Nonholonomic
    constraints 0 = A(t, q) v + b(t, q) enter with A in place of G.

    Parameters
    ----------
    t, q, v
        Symbols: scalar time [s], coordinates (n,) and velocities (n,), all SX or all MX.
    mass
        M, an expression of shape (n, n), or (n,) for a diagonal matrix.
    force
        f, shape (n,).
    constraints
        g, shape (m,), or a dict of expressions by multiplier header, {"rod [N]": g_rod, ...}.
        Defaults to no constraints.
    velocity_constraints
        A(t, q) v + b(t, q), shape (k,), or a dict as for `constraints`. Their multipliers come
        after the multipliers of `constraints`.
    q0, v0
        Initial coordinates and velocities, (n,) each. A run changes both as little as possible to
        satisfy the constraints.
    names
        Names of the coordinates. Defaults to q0, q1, ... Successive coordinates with the same text
        before the last dot, such as "bar.x", "bar.y" and "bar.angle", belong to one body. The error
        of each coordinate is relative to the motion of its body, even if the coordinate itself
        hardly changes.
    units
        Units of the coordinates, such as "m" and "rad". Defaults to "-". The scale of angles
        ("rad") is 1. The common scale of all other coordinates is their largest absolute initial
        value, or 1 if all of these are zero.
    observe
        Additional columns by header, {"tip.x [m]": x, ...}: scalar expressions in t, q, v, lam and
        the parameters. The unit of a header defaults to "-".
    lam
        Symbol of all multipliers, (m + k,), for columns that depend on reactions.
    parameters
        Values of further symbols, {m: 2.0, u: bd.run_up(...)}: numbers or time laws. Systems that
        differ only in these numbers share their machine code.
    strain_energy, gravity_energy
        Potential energies [J] in t and q, reported in the energy ledger. f must include the forces
        derived from these energies.
    dissipated_power
        Power dissipated by f [W]. The remaining power of f is integrated as work of loads.
    breakpoints
        Ascending times [s] at which an expression has a jump or kink in t; integrators stop and
        restart there. Breakpoints of laws are added automatically.
    time_scale
        Shortest time [s] over which an expression changes with t, if much shorter than the run;
        the step size is limited accordingly.
    scales
        Amplitude of each coordinate, about half its range, in the unit of the coordinate, (n,);
        `rtol` is relative to the amplitude. By default, adaptive integrators estimate the
        amplitudes by a pilot run with a loose tolerance.
    events
        `Event`s that monitor coordinates or observed columns by name.

    Raises
    ------
    BeamdaeError
        If symbols repeat or are not all SX or all MX, numbers, names or units have the wrong length
        or are invalid, names of coordinates or columns repeat, breakpoints do not ascend, a scale
        or `time_scale` is not positive, or the action of an event is neither "stop" nor "record".
        The shapes and symbols of expressions are checked only when `equations` is evaluated.

    Examples
    --------
    >>> import beamdae as bd, casadi as ca
    >>> t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    >>> m = ca.SX.sym("m")
    >>> pendulum = bd.ConstrainedSystem(
    ...     t=t, q=q, v=v, mass=[m, m], force=ca.vertcat(0.0, -9.81 * m),
    ...     constraints={"rod [N]": ca.norm_2(q) - 1.0}, q0=[1.0, 0.0], v0=[0.0, 0.0],
    ...     names=("x", "y"), units=("m", "m"), parameters={m: 2.0},
    ...     gravity_energy=9.81 * m * q[1], observe={"speed [m/s]": ca.norm_2(v)},
    ... )
    """

    t: Any
    q: Any
    v: Any
    mass: Any
    force: Any
    q0: Any
    v0: Any
    constraints: Any = None
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    observe: dict[str, Any] = field(default_factory=dict)
    breakpoints: tuple[float, ...] = ()
    time_scale: float | None = None
    scales: Any = None
    lam: Any = None
    parameters: Mapping[Any, Any] = field(default_factory=dict)
    strain_energy: Any = 0.0
    gravity_energy: Any = 0.0
    dissipated_power: Any = 0.0
    velocity_constraints: Any = None
    events: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        expressions = self._expressions
        n = self.q.numel()
        times = require_sequence(KIND, "breakpoints", self.breakpoints, "a list of times")
        breakpoints = tuple(require_finite(KIND, "breakpoints", x) for x in times)
        if any(b <= a for a, b in pairwise(breakpoints)):
            raise BeamdaeError(f"{KIND}: breakpoints must ascend, got {short_repr(breakpoints)}.")
        set_fields(
            self,
            parameters=expressions.parameters,
            q0=parse_numbers("q0", self.q0, n),
            v0=parse_numbers("v0", self.v0, n),
            names=parse_names("names", self.names, n) or tuple(f"q{i}" for i in range(n)),
            units=parse_names("units", self.units, n) or ("-",) * n,
            breakpoints=breakpoints,
        )
        for unit in self.units:
            require_unit(KIND, unit)
        columns = [require_name(KIND, name) for name in self.names]
        columns += [x.name for x in self._observed]
        if len(set(columns)) < len(columns):
            raise BeamdaeError(f"{KIND}: names must be unique, got {', '.join(columns)}.")
        set_fields(
            self, events=tuple(require_sequence(KIND, "events", self.events, "a list of events"))
        )
        for event in self.events:
            if not isinstance(event, Event):
                raise BeamdaeError(f"{KIND}: events must be Event(...), got {short_repr(event)}.")
            if not isinstance(event.do, str):
                raise BeamdaeError(
                    f"{KIND}: do of event {event.name} must be 'stop' or 'record', "
                    f"because the system has no parts, got {short_repr(event.do)}."
                )
        if self.time_scale is not None:
            set_fields(self, time_scale=require_positive(KIND, "time_scale", self.time_scale))
        if self.scales is not None:
            scales = parse_numbers("scales", self.scales, n)
            set_fields(self, scales=np.array([require_positive(KIND, "scales", x) for x in scales]))

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the system, built on first access."""
        n = self.q.numel()
        coordinates = tuple(
            Variable(name, unit) for name, unit in zip(self.names, self.units, strict=True)
        )
        # Scale of the coordinates that are not angles: their largest absolute initial value, or 1.
        sizes = [
            abs(x) for x, c in zip(self.q0.tolist(), coordinates, strict=True) if c.unit != "rad"
        ]
        length = max(sizes, default=0.0) or 1.0
        piece = Piece(self, sp.csr_array(sp.eye_array(n, format="csr")))
        constraints = self._constraint_statements(piece)
        laws = self._expressions.laws
        time_scales = [self.time_scale, *(law.time_scale for _, law in laws)]
        parts = _group_into_bodies(self.names, length)
        statements = Statements(
            forces=[self._force_statement(piece)],
            constraints=constraints,
            observables=self._observables(coordinates, piece, constraints),
            events=self.events,
        )
        terms = build_terms(statements, coordinates, parts, CoordinateMap({id(self): n}))
        return EquationsOfMotion(
            coordinates=coordinates,
            q0=read_only_copy(self.q0),
            v0=read_only_copy(self.v0),
            length=length,
            parts=parts,
            breakpoints=tuple(
                sorted({*self.breakpoints, *(b for _, law in laws for b in law.breakpoints)})
            ),
            time_scale=min((x for x in time_scales if x is not None), default=None),
            scales=None if self.scales is None else read_only_copy(self.scales),
            laws=select_unbounded_laws(laws),
            **vars(terms),
        )

    @cached_property
    def _expressions(self) -> Expressions:
        return Expressions.of(self.t, self.q, self.v, self.lam, self.parameters)

    @cached_property
    def _observed(self) -> dict[Variable, Any]:
        observe = require_entries(KIND, "observe", self.observe, _EXPRESSIONS)
        return {parse_header(header): expression for header, expression in observe.items()}

    def _force_statement(self, piece: Piece) -> ForceStatement:
        n, expressions = self.q.numel(), self._expressions
        local = expressions.local()
        mass = expressions.substitute(local, self.mass, "mass")
        if mass.shape != (n, n) and min(mass.shape) == 1:
            mass = ca.diag(mass)
        force = expressions.substitute(local, self.force, "force")
        potentials = ("t", "q")
        strain = expressions.substitute(local, self.strain_energy, "strain_energy", potentials)
        gravity = expressions.substitute(local, self.gravity_energy, "gravity_energy", potentials)
        dissipated = expressions.substitute(local, self.dissipated_power, "dissipated_power")
        for name, expression, shape in (
            ("mass", mass, (n, n)),
            ("force", force, (n, 1)),
            ("strain_energy", strain, (1, 1)),
            ("gravity_energy", gravity, (1, 1)),
            ("dissipated_power", dissipated, (1, 1)),
        ):
            if expression.shape != shape:
                raise BeamdaeError(
                    f"{KIND}: {name} must have shape {shape}, got {expression.shape}."
                )
        kinetic = 0.5 * ca.dot(local.v, mass @ local.v)
        # The kinetic energy changes at the rate v . M a + v . M' v / 2. Adding the second term
        # removes the power of the inertia forces, which f contains if M depends on q or t.
        power = ca.dot(force, local.v) + local.dot(kinetic + strain + gravity) + dissipated
        kernel = ForceKernel(
            local,
            mass @ local.a - force,
            ca.densify(ca.vertcat(kinetic, strain, gravity)),
            ca.densify(ca.vertcat(power, dissipated)),
        )
        return ForceStatement("system", kernel, (piece,), expressions.numbers[:, None])

    def _constraint_statements(self, piece: Piece) -> list[ConstraintStatement]:
        """Return the statements of holonomic constraints, then of nonholonomic constraints."""
        expressions = self._expressions
        data, statements = expressions.numbers[:, None], []
        kinds: tuple[tuple[type[ConstraintKernel], Any, str, str], ...] = (
            (ConstraintKernel, self.constraints, "constraint", "g"),
            (NonholonomicKernel, self.velocity_constraints, "velocity constraint", "h"),
        )
        for kernel, given, what, letter in kinds:
            local, rows, multipliers = _stack_constraints(expressions, given, what, letter)
            if not multipliers:
                continue
            depends_on_v, on_velocities = ca.depends_on(rows, local.v), kernel is NonholonomicKernel
            if depends_on_v and not on_velocities:
                raise BeamdaeError(
                    f"{KIND}: constraints must not depend on v; use velocity_constraints for "
                    "expressions that are linear in v."
                )
            if on_velocities and not (depends_on_v and ca.is_linear(rows, local.v)):
                raise BeamdaeError(
                    f"{KIND}: velocity_constraints must depend on v linearly; use constraints for "
                    "expressions in t and q."
                )
            statements.append(
                ConstraintStatement(_CONSTRAINTS, kernel(local, rows), (piece,), multipliers, data)
            )
        names = [x.name for statement in statements for x in statement.multipliers]
        require_unique(KIND, "constraints", names)
        return statements

    def _observables(
        self,
        coordinates: tuple[Variable, ...],
        piece: Piece,
        constraints: list[ConstraintStatement],
    ) -> dict[str, Quantity]:
        """Return the coordinates and the additional columns as quantities."""
        expressions, m = self._expressions, sum(len(x.multipliers) for x in constraints)
        on: tuple[str, ...] = ("t", "q", "v")
        joint = None
        if self.lam is not None:
            if self.lam.numel() != m:
                raise BeamdaeError(
                    f"{KIND}: lam must have size {m}, the number of constraints, got size "
                    f"{self.lam.numel()}."
                )
            on, joint = (*on, "lam"), _CONSTRAINTS

        def quantity(name: str, unit: str, expression: Any) -> Quantity:
            return Quantity(
                (Variable("", unit),),
                (piece,),
                lambda local: expressions.substitute(local, expression, name, on, observed=True),
                expressions.numbers,
                joint,
            )

        quantities = {"": Quantity(coordinates, (piece,), lambda local: local.q)}
        return quantities | {x.name: quantity(*x, e) for x, e in self._observed.items()}


def _stack_constraints(
    expressions: Expressions, constraints: Any, what: str, letter: str
) -> tuple[Local, SX, tuple[Variable, ...]]:
    """Return the symbols, stacked expressions and multipliers of one kind of constraints.

    `constraints` is an expression, a dict of expressions by header, or None. `letter` and a number
    name multipliers without a header, and `what` is the kind of constraint in messages.
    """
    by_name = isinstance(constraints, dict)
    if by_name:
        entries = require_entries(KIND, f"{what.replace(' ', '_')}s", constraints, _EXPRESSIONS)
        by_header = {parse_header(header): x for header, x in entries.items()}
        descriptions = [f"the {what} {x.name}" for x in by_header]
    else:
        by_header = {} if constraints is None else {Variable(letter, "-"): constraints}
        descriptions = [f"{what.replace(' ', '_')}s"]
    symbols = expressions.local()
    blocks = [
        expressions.substitute(symbols, x, description)
        for x, description in zip(by_header.values(), descriptions, strict=False)
    ]
    multipliers = tuple(
        Variable(x.name if by_name and block.numel() == 1 else f"{x.name}{i}", x.unit)
        for x, block in zip(by_header, blocks, strict=True)
        for i in range(block.numel())
    )
    # The blocks determine the number of multipliers, which their symbols require.
    local = expressions.local(len(multipliers))
    old, new = ([x.time, x.q, x.v, x.data] for x in (symbols, local))
    rows = ca.densify(ca.vertcat(SX(0, 1), *(ca.vec(x) for x in blocks)))
    (rows,) = ca.substitute([rows], old, new)
    return local, rows, multipliers


def _group_into_bodies(names: Sequence[str], length: float) -> tuple[PartCoordinates, ...]:
    """Return one part per group of successive names with the same text before the last dot."""
    bodies, row = [], 0
    for body, group in groupby(names, lambda name: name.rpartition(".")[0] or name):
        count = len(list(group))
        bodies.append(PartCoordinates(body, slice(row, row + count), length, length, count))
        row += count
    return tuple(bodies)
