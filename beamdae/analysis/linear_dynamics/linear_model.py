"""Linear models x' = A x + B u, y = C x + D u of a mechanism about a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.linear_dynamics.linearization import REFERENCE, Linearization, linearize_about
from beamdae.analysis.linear_dynamics.steady_rotation import RotatingCoordinates
from beamdae.equations.assembly.building import build_equations
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.assembly.statement_checks import collect_statements
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.errors import BeamdaeError, require_finite, require_sequence, short_repr, suggest
from beamdae.linear.factorizations import single_threaded
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.model_functions import Model
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.statements import Named

Array = np.ndarray


class ModelInput(NamedTuple):
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


def resolve_inputs(
    mechanism: Any, lin: Linearization, chosen: Sequence[str] | None
) -> list[ModelInput]:
    """Inputs of a mechanism: those chosen by the names of parts, or all."""
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    there = {name: part for name, part in parts.items() if part.inputs}
    names = (
        list(there) if chosen is None else require_sequence("linearize", "inputs", chosen, "names")
    )
    found: list[ModelInput] = []
    for name in names:
        if not isinstance(name, str) or name not in there:
            raise BeamdaeError(
                f"linearize: no input {short_repr(name)}{suggest(name, there)}, forces, moments and "
                "drivers of the mechanism are inputs by name."
            )
        found += _part_inputs(mechanism, there[name], lin)
    return found


def _part_inputs(mechanism: Mechanism, part: Part, lin: Linearization) -> list[ModelInput]:
    t = float(lin.time[0])
    values = [law.at(t) for law in part.laws]
    found = []
    for k, named in enumerate(part.inputs):
        # Loads and drivers are linear in their laws: any step is exact.
        step = max(1.0, abs(values[k]))
        ends = []
        for sign in (1.0, -1.0):
            moved = [x + (sign * step if j == k else 0.0) for j, x in enumerate(values)]
            ends.append(_part_residual(mechanism, part.with_constant_laws(moved), lin))
        names = ends[0][0].lam_names
        force, held = np.split((ends[0][1] - ends[1][1]) / (2.0 * step), [lin.equations.n])
        driven = {name: float(x) for name, x in zip(names, held, strict=True) if x != 0.0}
        found.append(ModelInput(_name_input(part.name, named, bool(driven)), force, driven))
    return found


def _name_input(part: str, named: Named, drives: bool) -> Named:
    if not drives:
        return Named(f"{part}.{named.name}", named.unit)
    return Named(f"{part}.{named.name}_ddot", f"{named.unit}/s^2")


def _part_residual(
    mechanism: Mechanism, part: Part, lin: Linearization
) -> tuple[EquationsOfMotion, Array]:
    """Equations of the part alone on the coordinates of all, and their residual at the state."""
    owners, e = map_coordinates(mechanism), lin.equations
    forces, constraints, _ = collect_statements(part, mechanism.gravity, owners.sizes)
    own = build_equations(
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
    return own, compute_tangent(own, lin.time, lin.state._replace(lam=np.zeros(own.m))).residual


if TYPE_CHECKING:
    from scipy.signal import StateSpace


# Matrices of states are full.
_MOST = 2000
_NONE = 1e-9


@dataclass(frozen=True, repr=False)
class LinearModel:
    """x' = A x + B u, y = C x + D u, of small deviations from a state.

    Attributes
    ----------
    A, B, C, D
        Arrays; `tuple(model)` gives all four, as `scipy.signal` and python-control take them:
        `control.ss(*model, inputs=[u.name for u in model.inputs])`.
    states
        Names and units: independent coordinates of the mechanism, then their rates.
    inputs
        Names and units: "push.Fy" [N]; of drivers the acceleration, "motor.angle_ddot" [rad/s^2].
    outputs
        Names and units of the observed columns.
    state_values, output_values
        What deviations are from.
    about
        The state, in words.
    warnings
        What the result has to be read with.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[Named, ...]
    inputs: tuple[Named, ...]
    outputs: tuple[Named, ...]
    state_values: Array = field(repr=False)
    output_values: Array = field(repr=False)
    about: str
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        inputs, outputs = (", ".join(x.name for x in y) for y in (self.inputs, self.outputs))
        return (
            f"<LinearModel about {self.about}: {len(self.states)} states; "
            f"inputs: {inputs or 'none'}; outputs: {outputs or 'none'}>"
        )

    def __iter__(self) -> Any:
        return iter((self.A, self.B, self.C, self.D))

    def state_space(self) -> StateSpace:
        """As `scipy.signal` has it, for its responses to steps, impulses and any input."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def frequency_response(self, frequencies: Any) -> Array:
        """C (i w 1 - A)^-1 B + D at frequencies [Hz], (k, outputs, inputs) complex."""
        given = require_sequence("frequency_response", "frequencies", frequencies, "a list [Hz]")
        values = [require_finite("frequency_response", "frequencies", f) for f in given]
        found = np.zeros((len(values), len(self.outputs), len(self.inputs)), complex)
        for row, f in zip(found, values, strict=True):
            try:
                with np.errstate(all="ignore"):
                    shifted = 2j * np.pi * f * np.eye(len(self.A)) - self.A
                    row[:] = self.C @ np.linalg.solve(shifted, self.B.astype(complex)) + self.D
            except np.linalg.LinAlgError:
                row[:] = np.nan
            if not np.all(np.isfinite(row)):
                raise BeamdaeError(
                    f"frequency_response: frequencies hold {f:g} Hz, at which the response is not "
                    "finite: that is an undamped mode, or one that nothing drives back."
                )
        return found


@single_threaded
def linearize(
    model: Any,
    about: Any = REFERENCE,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    t: float = 0.0,
) -> LinearModel:
    """The linear model of a mechanism about a state, with named inputs and outputs.

    Coordinates that joints make depend on others are eliminated, so that the states are as many as
    the degrees of freedom, twice; reactions are among what may be observed. Where a driver is an
    input its motion and its rate are states as well, and its acceleration is the input. About a
    rotation states are those of an observer who turns as well, and outputs are along axes that do.

    Parameters
    ----------
    model, about, t
        See `modes`.
    inputs
        Names of forces, moments and drivers; default all there are. The other ones stay as they are
        at the state.
    outputs
        Names of observables; default all.

    Raises
    ------
    BeamdaeError
        If there is no such state, input or output.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    >>> line = mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    >>> push = mech.add(bd.Force("push", bob.point, (0.0, 0.0)))
    >>> mech.observe("bob", bob.point)
    >>> found = bd.linearize(mech, inputs=["push"])
    >>> [x.header for x in (*found.states, found.inputs[0])]
    ['bob.x [m]', 'bob.x_dot [m/s]', 'push.Fx [N]']
    >>> found.B[:, 0].tolist()
    [0.0, 0.5]
    """
    if isinstance(model, Model):
        model = model()
    lin = linearize_about("linearize", model, about, require_finite("linearize", "t", t))
    driving = resolve_inputs(model, lin, inputs)
    observed = _resolve_outputs(lin, outputs)
    if lin.equations.n > _MOST:
        raise BeamdaeError(
            f"linearize: {lin.equations.n} coordinates are too many, at most {_MOST}; take fewer "
            "elements."
        )
    return _StateReduction(lin, driving).model(observed)


def _resolve_outputs(lin: Linearization, chosen: Sequence[str] | None) -> list[Observable]:
    there = {o.name: o for o in lin.whole.observables}
    names = (
        list(there) if chosen is None else require_sequence("linearize", "outputs", chosen, "names")
    )
    for name in names:
        if not isinstance(name, str) or name not in there:
            raise BeamdaeError(f"linearize: no output {short_repr(name)}{suggest(name, there)}.")
    return [there[name] for name in names]


class _StateReduction:
    """From all coordinates to independent ones: dq = Z x, dv = Y w + W x."""

    def __init__(self, lin: Linearization, driving: Sequence[ModelInput]) -> None:
        self.lin, self.e, self.driving = lin, lin.equations, driving
        e, own = self.e, lin.tangent
        driven = {name for one in driving for name in one.held}
        rows = {name: k for k, name in enumerate(e.lam_names)}
        missing = [name for name in driven if name not in rows]
        if missing:
            raise BeamdaeError(f"{missing[0]}: it is inactive or redundant, and no input.")
        free = np.zeros(e.m, bool)
        free[[rows[name] for name in driven]] = True
        moving = lin.nonholonomic
        held, rates = own.position_jacobian.toarray(), own.velocity_jacobian.toarray()
        scales = e.position_scales
        self.x_at, self.z = _independent_coordinates(held[~free & ~moving], scales)
        all_rates = np.where(moving[:, None], rates, held)[~free]
        self.w_at, self.y = _independent_coordinates(all_rates, scales)
        # Velocities that positions ask for: V W = -J Z where velocities alone are held.
        self.w = np.zeros((e.n, len(self.x_at)))
        if moving.any():
            asked = np.zeros((int(np.sum(~free)), len(self.x_at)))
            asked[moving[~free]] = -held[moving] @ self.z
            self.w = la.lstsq(all_rates, asked)[0]
        self.w = self.w - self.y @ self.w[self.w_at]
        self.rows, self.held, self.moving = rows, held, moving
        solve = factorize_saddle_point(own.mass, own.reactions, own.acceleration_jacobian(e))
        if solve is None:
            raise BeamdaeError("linearize: something moves without inertia, give it a mass.")
        self.solve = solve

    def model(self, observed: Sequence[Observable]) -> LinearModel:
        """The four matrices."""
        e, lin, own = self.e, self.lin, self.lin.tangent
        nx, nw = len(self.x_at), len(self.w_at)
        # Columns: x, w, u.
        dq = np.hstack([self.z, np.zeros((e.n, nw + len(self.driving)))])
        dv = np.hstack([self.w, self.y, np.zeros((e.n, len(self.driving)))])
        right = np.zeros((e.n + e.m, dq.shape[1]))
        right[: e.n] = -(own.stiffness @ dq + own.damping @ dv)
        right[e.n :][self.moving] = -self.held[self.moving] @ dv
        for k, one in enumerate(self.driving):
            right[: e.n, nx + nw + k] -= one.force
            for name, size in one.held.items():
                right[e.n + self.rows[name], nx + nw + k] = -size
        solved = np.stack([self.solve(column) for column in right.T], axis=1)
        da, dlam = solved[: e.n], solved[e.n :]
        rates = np.vstack([dv[self.x_at], da[self.w_at]])
        if lin.turning is not None:
            # What is observed is that of the inertial frame, where all of it turns on.
            dv = dv + lin.turning.speed * (RotatingCoordinates.of(e).generator @ dq)
        found, values, columns = self._observed(observed, dq, dv, dlam)
        states = [e.coordinates[k] for k in self.x_at]
        states += [e.coordinates[k].rate for k in self.w_at]
        return LinearModel(
            rates[:, : nx + nw],
            rates[:, nx + nw :],
            found[:, : nx + nw],
            found[:, nx + nw :],
            tuple(states),
            tuple(one.named for one in self.driving),
            columns,
            np.concatenate([lin.state.q[self.x_at], lin.state.v[self.w_at]]),
            values,
            lin.about,
            lin.warnings,
        )

    def _observed(
        self, observed: Sequence[Observable], dq: Array, dv: Array, dlam: Array
    ) -> tuple[Array, Array, tuple[Named, ...]]:
        """Derivatives of the columns, their values, and what they are called."""
        lin, whole = self.lin, self.lin.whole
        rows = [self.rows.get(name, -1) for name in whole.lam_names]
        lam = np.append(lin.state.lam, 0.0)[rows] if rows else np.zeros(0)
        every = np.vstack([dlam, np.zeros((1, dlam.shape[1]))])[rows]
        found, values, columns = [np.zeros((0, dq.shape[1]))], [np.zeros(0)], []
        for o in observed:
            if whole.redundant and o.rows.stop > o.rows.start and self.e.m < whole.m:
                raise BeamdaeError(
                    f"{o.name}: reactions of redundant joints are no outputs of linear models."
                )
            q, v = o.operator @ lin.state.q, o.operator @ lin.state.v
            given = (lin.time, q, v, whole.p[o.data], lam[o.rows])
            _, by_q, by_v, _, by_lam = o.function.jacobians(*given)
            local = by_q @ (o.operator @ dq) + by_v @ (o.operator @ dv) + by_lam @ every[o.rows]
            found.append(local)
            values.append(o.function(*(x[None] for x in given[:3]), given[3], lam[None, o.rows])[0])
            names = (".".join(filter(None, (o.name, x.name))) for x in o.columns)
            columns += [Named(name, x.unit) for name, x in zip(names, o.columns, strict=True)]
        return np.vstack(found), np.concatenate(values), tuple(columns)


def _independent_coordinates(rows: Array, scales: Array) -> tuple[Array, Array]:
    """Coordinates all others follow from under rows @ dq = 0, and how: dq = Z dq[chosen]."""
    n = rows.shape[1]
    matrix = rows * scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    triangle, order = la.qr(matrix, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > _NONE * np.max(diagonal, initial=0.0)))
    dependent, chosen = order[:rank], np.sort(order[rank:])
    at = np.argsort(order[rank:])
    z = np.zeros((n, n - rank))
    z[chosen, np.arange(n - rank)] = 1.0
    if rank:
        shares = la.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
        z[dependent] = -(scales[dependent, None] * shares / scales[order[rank:]])[:, at]
    return chosen, z
