"""Commands of `pid` controllers and their limits, evaluated for many states at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from beamdae.equations.assembly.observables import CompiledQuantity, compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartStatements, State
from beamdae.equations.structure import cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.local_symbols import SX
from beamdae.symbolic.signals import Signal, find_signals
from beamdae.symbolic.statements import Local, Quantity, Variable

Array = np.ndarray

# Distance from a limit, relative to the distance between both, that is a rounding error.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Command:
    """Command of a continuous controller that depends on the motion.

    Attributes
    ----------
    name
        Description of the controller.
    low, high
        Limits; infinite if there are none.
    value
        The compiled command before its limits.
    """

    name: str
    low: float
    high: float
    value: CompiledQuantity

    @property
    def has_limits(self) -> bool:
        """True if there are two finite limits."""
        return bool(np.isfinite([self.low, self.high]).all())

    def excess(self, time: Array, q: Array, v: Array) -> tuple[float, float, float]:
        """Return the command in a state, the nearest limit, and the distance beyond this limit.

        Distances that are rounding errors are zero.
        """
        value = float(self.value.rows(time[None], q[None], v[None])[0, 0])
        distances = {self.low: self.low - value, self.high: value - self.high}
        limit = max(distances, key=lambda x: distances[x])
        is_rounding = abs(distances[limit]) <= _ROUNDING * (self.high - self.low)
        return value, limit, 0.0 if is_rounding else distances[limit]


@cache_on_owner
def compile_commands(equations: EquationsOfMotion) -> tuple[Command, ...]:
    """Return the commands of a mechanism that depend on the motion."""
    mechanism = equations.mechanism
    if mechanism is None or not mechanism.has_coordinate_signals:
        return ()
    commands = []
    for name, output in mechanism.outputs.items():
        formula, low, high = _split_limits(output) or (output, -np.inf, np.inf)
        if not any(x.rows for x in find_signals(formula)):
            continue
        quantity = Quantity((Variable("command", "-"),), (), partial(_return_formula, formula))
        commands.append((name, low, high, quantity))
    values = compile_quantities(mechanism, [(name, x) for name, _, _, x in commands])
    return tuple(
        Command(f"{name}: the command", low, high, value)
        for (name, low, high, _), value in zip(commands, values, strict=True)
    )


def differentiate_laws(
    mechanism: Mechanism, name: str, time: Array, state: State
) -> Iterator[tuple[Part, Array]]:
    """Yield each part whose laws contain the output of a `pid`, and their derivatives by it.

    Parameters
    ----------
    mechanism
        The mechanism.
    name
        Description of the controller.
    time, state
        (t, branch), and the state at which the laws are differentiated; signals other than the
        output are constant.

    Raises
    ------
    BeamdaeError
        If the output is the argument of a table.
    """
    at, output, symbol = SX(ca.DM(time)), mechanism.outputs[name], SX.sym("command")
    for part in mechanism.parts.values():
        # The integral of a limited controller follows its own output, not what is added to it.
        if part.name == f"{name} integral":
            continue
        formulas = [law(at) for law in part.laws]
        if not any(_contains(x, output) for x in formulas):
            continue
        try:
            replaced = [_replace_term(x, output.element_hash(), symbol) for x in formulas]
        except _TableError:
            raise BeamdaeError(
                f"margins: the loop cannot be opened at {name} because {part.name} contains its "
                "output in a table; open it at an input instead."
            ) from None
        slopes = ca.densify(ca.jacobian(ca.vertcat(*replaced), symbol))
        slopes = ca.substitute(slopes, symbol, output)
        columns = tuple(Variable(f"slope {k}", "-") for k in range(len(formulas)))
        quantity = Quantity(columns, (), partial(_return_formula, slopes))
        (compiled,) = compile_quantities(mechanism, [(part.name, quantity)])
        yield part, compiled.rows(time[None], state.q[None], state.v[None])[0]


def _return_formula(formula: SX, local: Local) -> SX:
    return formula


class _TableError(Exception):
    """A term is the argument of a table."""


def _replace_term(formula: SX, key: int, symbol: SX) -> SX:
    """Return the formula with a symbol in place of the term with the hash `key`."""
    known: dict[int, SX] = {key: symbol}

    def rebuild(term: SX) -> SX:
        own = term.element_hash()
        if own not in known:
            operands = [term.dep(k) for k in range(term.n_dep())]
            changed = [rebuild(x) for x in operands]
            pairs = zip(operands, changed, strict=True)
            if all(a.element_hash() == b.element_hash() for a, b in pairs):
                known[own] = term
            elif term.op() == ca.OP_CALL:
                raise _TableError
            else:
                build: Any = SX.unary if len(changed) == 1 else SX.binary
                known[own] = build(term.op(), *changed)
        return known[own]

    return rebuild(formula)


def unused_command_warnings(
    mechanism: Mechanism, statements: Sequence[PartStatements]
) -> Iterator[str]:
    """Yield a warning for each `pid` and sampled controller of whose commands no part depends."""
    time = SX.sym("t", 2)
    formulas = [(part.name, law(time)) for part in mechanism.parts.values() for law in part.laws]
    # Functions of the user, such as those of `ForceLaw`, are part of the statements, in which local
    # symbols replace the signals.
    groups = [
        (force.part, {x.signal.name for x in force.signals})
        for part in statements
        for force in part.forces
    ]
    for name, output in mechanism.outputs.items():
        signals = {x.name for x in find_signals(output)}
        # With limits, the integral of the controller depends on the output.
        integral = f"{name} integral"
        others = (formula for part, formula in formulas if part != integral)
        is_used = any(signals <= group for part, group in groups if part != integral)
        if not is_used and not any(_contains(x, output) for x in others):
            yield (
                f"{name}: its output is used by no part; pass it to a part, such as a Force or a "
                "Moment."
            )
    controllers: list[Any] = [x for x in mechanism.parts.values() if x.is_controller]
    used = {x.name for _, formula in formulas for x in find_signals(formula)}
    used = used.union(*(group for _, group in groups))
    used |= {x.name for one in controllers for x in one.reads if isinstance(x, Signal)}
    for controller in controllers:
        driven = [x.name for x in controller.drives]
        # A controller may drive further inputs as columns of the result.
        if used.isdisjoint(driven):
            yield (
                f"{controller.name}: {', '.join(driven)} is used by no part; pass it to a part, "
                "such as a Force or a Moment."
            )


def _contains(formula: SX, part: SX) -> bool:
    """Return True if an expression is a part of the formula."""
    pending, known = [formula], set()
    while pending:
        term = pending.pop()
        key = term.element_hash()
        if key == part.element_hash():
            return True
        if key not in known:
            known.add(key)
            pending += [term.dep(k) for k in range(term.n_dep())]
    return False


def limit_warnings(
    equations: EquationsOfMotion, time: Array, q: Array, v: Array, consequence: str, at: str = ""
) -> Iterator[str]:
    """Yield a warning for each command that is beyond or at a limit in a state.

    Parameters
    ----------
    equations
        The equations of motion.
    time, q, v
        (t, branch), coordinates and velocities of the state.
    consequence, at
        Clauses about the result and the remedy, for commands beyond and at a limit. Without `at`,
        the latter have no warning.
    """
    for command in compile_commands(equations):
        if not command.has_limits:
            continue
        value, limit, distance = command.excess(time, q, v)
        if distance > 0.0:
            yield f"{command.name} {value:.4g} is beyond its limit {limit:.4g}, {consequence}"
        elif at and distance == 0.0:
            yield f"{command.name} {value:.4g} is at its limit, {at}"


def _split_limits(formula: SX) -> tuple[SX, float, float] | None:
    """Return the value and the limits of a formula that limits a value, or None."""
    limits = {ca.OP_FMIN: np.inf, ca.OP_FMAX: -np.inf}
    value = formula
    for _ in limits:
        operation = next((x for x in limits if value.is_op(x)), None)
        if operation is None:
            break
        operands = [value.dep(k) for k in range(2)]
        constants = [x for x in operands if x.is_constant()]
        if len(constants) != 1 or np.isfinite(limits[operation]):
            break
        limits[operation] = float(constants[0])
        (value,) = (x for x in operands if not x.is_constant())
    low, high = limits[ca.OP_FMAX], limits[ca.OP_FMIN]
    return (value, low, high) if np.isfinite([low, high]).all() and low < high else None
