"""Constrained mechanics stated directly in CasADi expressions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assemble import build
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.equations.fit import require_unit
from beamdae.equations.owners import Owners
from beamdae.errors import BeamdaeError, entries, finite, keep, number, positive, shown
from beamdae.parts.events import Event
from beamdae.parts.part import require_name
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    Named,
    Piece,
    Quantity,
)

MX = ca.MX
_KIND = "ConstrainedSystem"


@dataclass(frozen=True, eq=False)
class ConstrainedSystem:
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
        g, shape (m,); may be left out.
    q0, v0
        Start; made consistent with the constraints.
    names
        Names of the coordinates; default q0, q1, ...
    units
        Their units, such as "m" and "rad"; default "-". Angles ("rad") are of size 1, all others
        of the size of the largest of them at the start: scales follow from units, never from names.
    observe
        Further columns by name: expressions in t, q and v.
    breakpoints
        Times [s] at which an expression jumps or kinks in t; integrators stop and restart there.
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
    >>> pendulum = bd.ConstrainedSystem(
    ...     t=t, q=q, v=v, mass=[1.0, 1.0], force=ca.vertcat(0.0, -9.81),
    ...     constraints=ca.dot(q, q) - 1.0, q0=[1.0, 0.0], v0=[0.0, 0.0],
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
    events: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        self._check_symbols()
        n = self.q.numel()
        keep(
            self,
            q0=self._numbers("q0", self.q0, n),
            v0=self._numbers("v0", self.v0, n),
            names=self._texts("names", self.names, n) or tuple(f"q{i}" for i in range(n)),
            units=self._texts("units", self.units, n) or ("-",) * n,
            breakpoints=self._checked_breakpoints(),
        )
        for unit in self.units:
            require_unit(_KIND, unit)
        if not isinstance(self.observe, dict):
            raise BeamdaeError(
                f"{_KIND}: observe must give expressions by name, got {shown(self.observe)}."
            )
        columns = [require_name(_KIND, name) for name in (*self.names, *self.observe)]
        if len(set(columns)) < len(columns):
            raise BeamdaeError(f"{_KIND}: names must differ, got {', '.join(columns)}.")
        keep(self, events=tuple(entries(_KIND, "events", self.events, "a list of events")))
        for event in self.events:
            if not isinstance(event, Event):
                raise BeamdaeError(f"{_KIND}: events must be Event(...), got {shown(event)}.")
        if self.time_scale is not None:
            keep(self, time_scale=positive(_KIND, "time_scale", self.time_scale))
        if self.scales is not None:
            scales = self._numbers("scales", self.scales, n)
            keep(self, scales=np.array([positive(_KIND, "scales", x) for x in scales]))

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion, the same type a mechanism gives."""
        n = self.q.numel()
        named = zip(self.names, self.units, strict=True)
        coordinates = tuple(Named(name, unit) for name, unit in named)
        length = _length(self.q0, coordinates)
        piece = Piece(self, sp.csr_array(sp.eye_array(n, format="csr")))
        observables = {"": Quantity(coordinates, (piece,), lambda local: local.q)}
        for name, expression in self.observe.items():
            observables[name] = self._quantity(name, expression, piece)
        return build(
            coordinates=coordinates,
            q0=self.q0,
            v0=self.v0,
            length=length,
            parts=tuple(
                PartCoordinates(name, slice(k, k + 1), length) for k, name in enumerate(self.names)
            ),
            breakpoints=self.breakpoints,
            time_scale=self.time_scale,
            scales=self.scales,
            forces=[self._force_statement(piece)],
            constraints=self._constraint_statements(piece),
            observables=observables,
            events=self.events,
            owners=Owners({id(self): n}),
        )

    def _check_symbols(self) -> None:
        for name in ("t", "q", "v"):
            symbol = getattr(self, name)
            if (
                not isinstance(symbol, (SX, MX))
                or not (symbol.is_column() and symbol.is_dense() and symbol.numel())
                or not symbol.is_valid_input()
            ):
                raise BeamdaeError(
                    f"{_KIND}: {name} must be a CasADi symbol, a column such as "
                    f'SX.sym("{name}", 2), got {shown(symbol)}.'
                )
        if self.t.numel() != 1 or self.q.numel() != self.v.numel():
            raise BeamdaeError(
                f"{_KIND}: t must be a scalar and q and v of one size, got sizes "
                f"{self.t.numel()}, {self.q.numel()} and {self.v.numel()}."
            )
        if not isinstance(self.q, type(self.t)) or not isinstance(self.v, type(self.t)):
            raise BeamdaeError(f"{_KIND}: t, q and v must be all SX or all MX symbols.")
        own = self._symbols
        if len(own) > len(set(own)):
            raise BeamdaeError(f"{_KIND}: t, q and v must be symbols of their own each.")

    @property
    def _symbols(self) -> list[int]:
        return [_key(x) for symbol in (self.t, self.q, self.v) for x in ca.symvar(symbol)]

    @staticmethod
    def _numbers(name: str, values: Any, n: int) -> np.ndarray:
        try:
            given = np.asarray(values, object).ravel().tolist()
        except Exception:
            # Symbols, or rows of different lengths.
            given = []
        if len(given) != n or any(number(x) is None for x in given):
            raise BeamdaeError(
                f"{_KIND}: {name} must have {n} entries, finite numbers, got {shown(values)}."
            )
        return np.array([finite(_KIND, name, x) for x in given])

    @staticmethod
    def _texts(name: str, values: Any, n: int) -> tuple[Any, ...]:
        found = tuple(entries(_KIND, name, values, f"a list of {n} entries, texts"))
        if found and len(found) != n:
            raise BeamdaeError(
                f"{_KIND}: {name} must have {n} entries, got {len(found)}: {shown(values)}."
            )
        return found

    def _checked_breakpoints(self) -> tuple[float, ...]:
        given = entries(_KIND, "breakpoints", self.breakpoints, "a list of times")
        times = tuple(finite(_KIND, "breakpoints", b) for b in given)
        if any(b <= a for a, b in pairwise(times)):
            raise BeamdaeError(f"{_KIND}: breakpoints must ascend, got {shown(times)}.")
        return times

    def _in(self, local: Local, expression: Any, name: str) -> SX:
        """An expression of the user's, in the symbols of `local`."""
        kind = type(self.t)
        try:
            stated = kind(_stacked(expression))
        except Exception:
            raise BeamdaeError(
                f"{_KIND}: {name} must be made of numbers and {kind.__name__} expressions in t, q "
                f"and v, in rows of one length, got {shown(expression)}."
            ) from None
        others = [x.name() for x in ca.symvar(stated) if _key(x) not in self._symbols]
        if others:
            raise BeamdaeError(
                f"{_KIND}: {name} must depend on t, q and v alone, not on {', '.join(others[:3])}."
            )
        try:
            return ca.Function("stated", [self.t, self.q, self.v], [stated])(
                local.time[0], local.q, local.v
            )
        except Exception:
            raise BeamdaeError(
                f"{_KIND}: {name} uses a function without a formula, such as a "
                "solver of equations, it must be an expression that SX can hold."
            ) from None

    def _force_statement(self, piece: Piece) -> ForceStatement:
        n = self.q.numel()
        local = Local(n)
        mass = self._in(local, self.mass, "mass")
        if mass.shape != (n, n) and min(mass.shape) == 1:
            mass = ca.diag(mass)
        force = self._in(local, self.force, "force")
        for what, shape, wanted in (("mass", mass.shape, (n, n)), ("force", force.shape, (n, 1))):
            if shape != wanted:
                raise BeamdaeError(f"{_KIND}: {what} must have shape {wanted}, got {shape}.")
        kinetic = 0.5 * ca.dot(local.v, mass @ local.v)
        # Without a potential the whole force counts as a load: its work closes the energy balance.
        # What of it is inertia, where the mass depends on q or t, changes no energy: the kinetic
        # one changes by v . M a + v . M' v / 2.
        power = ca.dot(force, local.v) + local.dot(kinetic)
        kernel = ForceKernel(
            local, mass @ local.a - force, ca.vertcat(kinetic, 0, 0), ca.vertcat(power, 0)
        )
        return ForceStatement("system", kernel, (piece,), np.zeros((0, 1)))

    def _constraint_statements(self, piece: Piece) -> list[ConstraintStatement]:
        if self.constraints is None:
            return []
        g = self._in(Local(self.q.numel()), self.constraints, "constraints")
        m = g.numel()
        if not m:
            return []
        local = Local(self.q.numel(), 0, m)
        g = ca.reshape(self._in(local, self.constraints, "constraints"), m, 1)
        if ca.depends_on(g, local.v):
            raise BeamdaeError(f"{_KIND}: constraints must not depend on v.")
        held = tuple(Named(f"g{i}", "-") for i in range(m))
        return [ConstraintStatement("constraint", ConstraintKernel(local, g), (piece,), held)]

    def _quantity(self, name: str, expression: Any, piece: Piece) -> Quantity:
        own = (Named("", "-"),)
        return Quantity(own, (piece,), lambda local: self._in(local, expression, name))


def _stacked(expression: Any) -> Any:
    """An expression from a list of entries, or of rows."""
    if not isinstance(expression, (list, tuple)):
        if number(expression) is None and not isinstance(expression, (SX, MX, ca.DM, np.ndarray)):
            raise TypeError
        return expression
    rows = [ca.horzcat(*row) if isinstance(row, (list, tuple)) else row for row in expression]
    return ca.vertcat(*rows)


def _key(symbol: Any) -> int:
    """What a symbol is known by; names are not unique."""
    return symbol.element_hash() if isinstance(symbol, SX) else hash(symbol)


def _length(q0: np.ndarray, coordinates: tuple[Named, ...]) -> float:
    """Size of the coordinates that are no angles: the largest at the start, or 1."""
    sizes = [abs(x) for x, c in zip(q0.tolist(), coordinates, strict=True) if c.unit != "rad"]
    return max(sizes, default=0.0) or 1.0
