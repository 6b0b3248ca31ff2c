"""Constrained mechanics stated directly in CasADi expressions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assemble import Owners, build
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.equations.fit import require_unit
from beamdae.errors import BeamdaeError, finite, positive
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

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion, the same type a mechanism gives."""
        self._check_symbols()
        n = self.q.numel()
        q0, v0 = self._start("q0", self.q0, n), self._start("v0", self.v0, n)
        names = tuple(self.names) or tuple(f"q{i}" for i in range(n))
        if len(names) != n:
            raise BeamdaeError(f"ConstrainedSystem: names must have {n} entries, got {len(names)}.")
        coordinates = self._coordinates(names)
        columns = [*names, *self.observe]
        if len(set(columns)) < len(columns):
            raise BeamdaeError(f"ConstrainedSystem: names must differ, got {', '.join(columns)}.")
        piece = Piece(self, sp.csr_array(sp.eye_array(n, format="csr")))
        constraints = self._constraint_statements(piece)
        observables = {"": Quantity(coordinates, (piece,), lambda local: local.q)}
        for name, expression in self.observe.items():
            observables[name] = self._quantity(name, expression, piece)
        return build(
            coordinates=coordinates,
            q0=q0,
            v0=v0,
            length=_length(q0, coordinates),
            parts=tuple(
                PartCoordinates(name, slice(k, k + 1), _length(q0, coordinates))
                for k, name in enumerate(names)
            ),
            breakpoints=self._checked_breakpoints(),
            time_scale=self.time_scale,
            scales=self._checked_scales(n),
            forces=[self._force_statement(piece)],
            constraints=constraints,
            observables=observables,
            owners=Owners({id(self): n}),
        )

    def _check_symbols(self) -> None:
        for name in ("t", "q", "v"):
            symbol = getattr(self, name)
            if not isinstance(symbol, (ca.SX, ca.MX)) or not symbol.is_column():
                raise BeamdaeError(
                    f"ConstrainedSystem: {name} must be a CasADi symbol, a column, got {symbol!r}."
                )
        if self.t.numel() != 1 or self.q.numel() != self.v.numel():
            raise BeamdaeError(
                "ConstrainedSystem: t must be a scalar and q and v of one size, got sizes "
                f"{self.t.numel()}, {self.q.numel()} and {self.v.numel()}."
            )
        if self.time_scale is not None:
            positive("ConstrainedSystem", "time_scale", self.time_scale)
        if not isinstance(self.observe, dict):
            raise BeamdaeError(
                f"ConstrainedSystem: observe must give expressions by name, got {self.observe!r}."
            )

    def _coordinates(self, names: tuple[str, ...]) -> tuple[Named, ...]:
        units = tuple(self.units) if self.units else ("-",) * len(names)
        if isinstance(self.units, str) or len(units) != len(names):
            raise BeamdaeError(
                f"ConstrainedSystem: units must have {len(names)} entries, got {self.units!r}."
            )
        for unit in units:
            require_unit("ConstrainedSystem", unit)
        return tuple(Named(name, unit) for name, unit in zip(names, units, strict=True))

    def _checked_scales(self, n: int) -> np.ndarray | None:
        if self.scales is None:
            return None
        given = np.atleast_1d(np.asarray(self.scales, object)).ravel()
        scales = np.array([positive("ConstrainedSystem", "scales", x) for x in given])
        if len(scales) != n:
            raise BeamdaeError(
                f"ConstrainedSystem: scales must have {n} entries, got {len(scales)}."
            )
        return scales

    def _checked_breakpoints(self) -> tuple[float, ...]:
        times = tuple(finite("ConstrainedSystem", "breakpoints", b) for b in self.breakpoints)
        if any(b <= a for a, b in pairwise(times)):
            raise BeamdaeError(f"ConstrainedSystem: breakpoints must ascend, got {times}.")
        return times

    @staticmethod
    def _start(name: str, values: Any, n: int) -> np.ndarray:
        array = np.asarray(values, float).ravel()
        if len(array) != n or not np.all(np.isfinite(array)):
            raise BeamdaeError(
                f"ConstrainedSystem: {name} must be {n} finite numbers, got {values!r}."
            )
        return array

    def _in(self, local: Local, expression: Any, name: str) -> SX:
        if isinstance(expression, (list, tuple)):
            rows = [ca.horzcat(*r) if isinstance(r, (list, tuple)) else r for r in expression]
            expression = ca.vertcat(*rows)
        try:
            function = ca.Function("stated", [self.t, self.q, self.v], [expression])
        except Exception as problem:
            raise BeamdaeError(
                f"ConstrainedSystem: {name} must depend on t, q and v alone: "
                f"{str(problem).splitlines()[-1]}"
            ) from problem
        return function(local.time[0], local.q, local.v)

    def _force_statement(self, piece: Piece) -> ForceStatement:
        n = self.q.numel()
        local = Local(n)
        mass = self._in(local, self.mass, "mass")
        if mass.shape != (n, n):
            mass = ca.diag(mass)
        force = self._in(local, self.force, "force")
        for what, shape, wanted in (("mass", mass.shape, (n, n)), ("force", force.shape, (n, 1))):
            if shape != wanted:
                raise BeamdaeError(
                    f"ConstrainedSystem: {what} must have shape {wanted}, got {shape}."
                )
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
        local = Local(self.q.numel(), 0, m)
        g = ca.reshape(self._in(local, self.constraints, "constraints"), m, 1)
        if ca.depends_on(g, local.v):
            raise BeamdaeError("ConstrainedSystem: constraints must not depend on v.")
        held = tuple(Named(f"g{i}", "-") for i in range(m))
        return [ConstraintStatement("constraint", ConstraintKernel(local, g), (piece,), held)]

    def _quantity(self, name: str, expression: Any, piece: Piece) -> Quantity:
        own = (Named("", "-"),)
        return Quantity(own, (piece,), lambda local: self._in(local, expression, name))


def _length(q0: np.ndarray, coordinates: tuple[Named, ...]) -> float:
    """Size of the coordinates that are no angles: the largest at the start, or 1."""
    sizes = [abs(x) for x, c in zip(q0.tolist(), coordinates, strict=True) if c.unit != "rad"]
    return max(sizes, default=0.0) or 1.0
