"""Constrained mechanics stated directly in CasADi expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.building import build_equations
from beamdae.equations.assembly.coordinate_map import CoordinateMap
from beamdae.equations.assembly.expressions import (
    KIND,
    Expressions,
    parse_header,
    parse_names,
    parse_numbers,
)
from beamdae.equations.assembly.statement_checks import require_unique, require_unit
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.equations.singular_laws import select_varying_laws
from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.model_functions import HasOrigin
from beamdae.parts.events import Event
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    Named,
    NonholonomicKernel,
    Piece,
    Quantity,
)

# What multipliers are named after.
CONSTRAINT = "constraint"


def constraint_statements(
    given: Expressions, piece: Piece, constraints: Any, velocity_constraints: Any
) -> list[ConstraintStatement]:
    """The constraints there are, each an expression, a dict of them by name, or None.

    Raises
    ------
    BeamdaeError
        On two of a name, those of positions that depend on v, or those of velocities that are not
        linear in v.
    """
    found = []
    for stated, what, letter in ((constraints, "constraint", "g"), (velocity_constraints, _V, "h")):
        local, rows, held = _stated(given, stated, what, letter)
        if not held:
            continue
        kind = ConstraintKernel
        if what == _V:
            kind = NonholonomicKernel
            _require_linear(rows, local)
        elif ca.depends_on(rows, local.v):
            raise BeamdaeError(f"{KIND}: constraints must not depend on v.")
        kernel, data = kind(local, rows), given.numbers[:, None]
        found.append(ConstraintStatement(CONSTRAINT, kernel, (piece,), held, data))
    require_unique(KIND, "constraints", [x.name for s in found for x in s.multipliers])
    return found


_V = "velocity constraint"


def _stated(
    given: Expressions, stated: Any, what: str, letter: str
) -> tuple[Local, SX, tuple[Named, ...]]:
    """Rows of constraints in symbols with multipliers for them, and what these are called."""
    by_name = isinstance(stated, dict)
    if by_name:
        named = {parse_header(header): expression for header, expression in stated.items()}
        told = [f"the {what} {x.name}" for x in named]
    else:
        named = {} if stated is None else {Named(letter, "-"): stated}
        told = [f"{what.replace(' ', '_')}s"]
    local = given.local()
    found = [given.stated(local, x, name) for x, name in zip(named.values(), told, strict=False)]
    rows = ca.vertcat(SX(0, 1), *(ca.vec(x) for x in found))
    held = tuple(
        Named(x.name if by_name and rows_of.numel() == 1 else f"{x.name}{i}", x.unit)
        for x, rows_of in zip(named, found, strict=True)
        for i in range(rows_of.numel())
    )
    own = given.local(len(held))
    symbols = [(x.time, x.q, x.v, x.data) for x in (local, own)]
    (moved,) = ca.substitute([ca.densify(rows)], *map(list, symbols))
    return own, moved, held


def _require_linear(rows: SX, local: Local) -> None:
    if not ca.is_linear(rows, local.v) or not ca.depends_on(rows, local.v):
        raise BeamdaeError(f"{KIND}: velocity_constraints must be linear in v.")


@dataclass(frozen=True, eq=False)
class ConstrainedSystem(HasOrigin):
    """M(t, q) q'' + G^T lam = f(t, q, q'), 0 = g(t, q), from CasADi expressions.

    Parameters
    ----------
    t, q, v
        Symbols: scalar time, coordinates (n,) and velocities (n,), all SX (or all MX).
    mass
        M, an (n, n) expression, or (n,) for a diagonal one.
    force
        f, shape (n,).
    constraints
        g, shape (m,), or by name of the multiplier with its unit, {"rod [N]": g_rod, ...}; may be
        left out.
    velocity_constraints
        A(t, q) v + b(t, q), shape (k,) or by name as `constraints`: nonholonomic constraints, which
        hold velocities alone. Their multipliers come after the others.
    q0, v0
        Start; made consistent with the constraints.
    names
        Names of the coordinates; default q0, q1, ...
    units
        Their units, such as "m" and "rad"; default "-". Angles ("rad") are of size 1, all others
        of the size of the largest of them at the start: scales follow from units, never from names.
    observe
        Further columns by header, {"tip.x [m]": x, ...}: expressions in t, q, v and lam; without
        a unit it is "-".
    lam
        Symbol of the multipliers (m,), for columns that show reactions.
    parameters
        What further symbols stand for, {m: 2.0, u: bd.run_up(...)}: numbers, which systems of one
        statement may differ in and share their machine code, or laws of time.
    strain_energy, gravity_energy
        Potentials [J] in t and q that f comes from in part, for the energy ledger.
    dissipated_power
        What f dissipates [W]. What of its power is neither that nor taken from a potential counts
        as work of loads.
    breakpoints
        Times [s] at which an expression jumps or kinks in t; integrators stop and restart there.
        Those of laws are known.
    time_scale
        Shortest time [s] over which an expression changes with t, if it is much shorter than the
        run: no step is longer.
    scales
        How far each coordinate moves, about half its range: what `rtol` is relative to. Default:
        adaptive integrators go ahead with a loose tolerance to see.
    events
        What runs watch for: `Event`s on coordinates and observed columns, by name.

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
        given = self._expressions
        n = self.q.numel()
        set_fields(
            self,
            parameters=given.parameters,
            q0=parse_numbers("q0", self.q0, n),
            v0=parse_numbers("v0", self.v0, n),
            names=parse_names("names", self.names, n) or tuple(f"q{i}" for i in range(n)),
            units=parse_names("units", self.units, n) or ("-",) * n,
            breakpoints=self._checked_breakpoints(),
        )
        for unit in self.units:
            require_unit(KIND, unit)
        columns = [require_name(KIND, name) for name in self.names]
        columns += [x.name for x in self._observed]
        if len(set(columns)) < len(columns):
            raise BeamdaeError(f"{KIND}: names must differ, got {', '.join(columns)}.")
        set_fields(
            self, events=tuple(require_sequence(KIND, "events", self.events, "a list of events"))
        )
        for event in self.events:
            if not isinstance(event, Event):
                raise BeamdaeError(f"{KIND}: events must be Event(...), got {short_repr(event)}.")
            if not isinstance(event.do, str):
                raise BeamdaeError(
                    f"{KIND}: it has no parts to act on, event {event.name} can do 'stop' and "
                    f"'record', got {short_repr(event.do)}."
                )
        if self.time_scale is not None:
            set_fields(self, time_scale=require_positive(KIND, "time_scale", self.time_scale))
        if self.scales is not None:
            scales = parse_numbers("scales", self.scales, n)
            set_fields(self, scales=np.array([require_positive(KIND, "scales", x) for x in scales]))

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion, the same type a mechanism gives."""
        n = self.q.numel()
        named = zip(self.names, self.units, strict=True)
        coordinates = tuple(Named(name, unit) for name, unit in named)
        length = _length(self.q0, coordinates)
        piece = Piece(self, sp.csr_array(sp.eye_array(n, format="csr")))
        given = self._expressions
        held = constraint_statements(given, piece, self.constraints, self.velocity_constraints)
        laws = given.laws
        scales = [self.time_scale, *(law.time_scale for _, law in laws)]
        return build_equations(
            coordinates=coordinates,
            q0=self.q0,
            v0=self.v0,
            length=length,
            parts=tuple(
                PartCoordinates(name, slice(k, k + 1), length) for k, name in enumerate(self.names)
            ),
            breakpoints=tuple(
                sorted({*self.breakpoints, *(b for _, law in laws for b in law.breakpoints)})
            ),
            time_scale=min((x for x in scales if x is not None), default=None),
            scales=self.scales,
            forces=[self._force_statement(piece)],
            constraints=held,
            observables=self._observables(coordinates, piece, held),
            events=self.events,
            coordinate_map=CoordinateMap({id(self): n}),
            laws=select_varying_laws(laws),
        )

    @cached_property
    def _expressions(self) -> Expressions:
        return Expressions.of(self.t, self.q, self.v, self.lam, self.parameters)

    @cached_property
    def _observed(self) -> dict[Named, Any]:
        """Further columns, an expression each."""
        if not isinstance(self.observe, dict):
            raise BeamdaeError(
                f"{KIND}: observe must give expressions by name, got {short_repr(self.observe)}."
            )
        return {parse_header(header): expression for header, expression in self.observe.items()}

    def _checked_breakpoints(self) -> tuple[float, ...]:
        given = require_sequence(KIND, "breakpoints", self.breakpoints, "a list of times")
        times = tuple(require_finite(KIND, "breakpoints", b) for b in given)
        if any(b <= a for a, b in pairwise(times)):
            raise BeamdaeError(f"{KIND}: breakpoints must ascend, got {short_repr(times)}.")
        return times

    def _force_statement(self, piece: Piece) -> ForceStatement:
        n, given = self.q.numel(), self._expressions
        local = given.local()
        mass = given.stated(local, self.mass, "mass")
        if mass.shape != (n, n) and min(mass.shape) == 1:
            mass = ca.diag(mass)
        force = given.stated(local, self.force, "force")
        strain = given.stated(local, self.strain_energy, "strain_energy", ("t", "q"))
        gravity = given.stated(local, self.gravity_energy, "gravity_energy", ("t", "q"))
        dissipated = given.stated(local, self.dissipated_power, "dissipated_power")
        for what, found, wanted in (
            ("mass", mass, (n, n)),
            ("force", force, (n, 1)),
            ("strain_energy", strain, (1, 1)),
            ("gravity_energy", gravity, (1, 1)),
            ("dissipated_power", dissipated, (1, 1)),
        ):
            if found.shape != wanted:
                raise BeamdaeError(f"{KIND}: {what} must have shape {wanted}, got {found.shape}.")
        kinetic = 0.5 * ca.dot(local.v, mass @ local.v)
        # What of the force is inertia, where the mass depends on q or t, changes no energy: the
        # kinetic one changes by v . M a + v . M' v / 2.
        power = ca.dot(force, local.v) + local.dot(kinetic + strain + gravity) + dissipated
        kernel = ForceKernel(
            local,
            mass @ local.a - force,
            ca.densify(ca.vertcat(kinetic, strain, gravity)),
            ca.densify(ca.vertcat(power, dissipated)),
        )
        return ForceStatement("system", kernel, (piece,), given.numbers[:, None])

    def _observables(
        self, coordinates: tuple[Named, ...], piece: Piece, held: list[ConstraintStatement]
    ) -> dict[str, Quantity]:
        """The coordinates, and what else is to be observed."""
        given, m = self._expressions, sum(len(x.multipliers) for x in held)
        on: tuple[str, ...] = ("t", "q", "v")
        joint = None
        if self.lam is not None:
            if self.lam.numel() != m:
                raise BeamdaeError(
                    f"{KIND}: lam must have an entry for each of {m} constraints, "
                    f"got {self.lam.numel()}."
                )
            on, joint = (*on, "lam"), CONSTRAINT

        def quantity(name: str, unit: str, expression: Any) -> Quantity:
            return Quantity(
                (Named("", unit),),
                (piece,),
                lambda local: given.stated(local, expression, name, on, observed=True),
                given.numbers,
                joint,
            )

        found = {"": Quantity(coordinates, (piece,), lambda local: local.q)}
        return found | {x.name: quantity(*x, e) for x, e in self._observed.items()}


def _length(q0: np.ndarray, coordinates: tuple[Named, ...]) -> float:
    """Size of the coordinates that are no angles: the largest at the start, or 1."""
    sizes = [abs(x) for x, c in zip(q0.tolist(), coordinates, strict=True) if c.unit != "rad"]
    return max(sizes, default=0.0) or 1.0
