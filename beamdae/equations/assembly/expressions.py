"""Expressions of the user's own in CasADi symbols, and what these may be made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.equations.assembly.statement_checks import require_unit
from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_finite,
    require_name,
    require_sequence,
    short_repr,
)
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.statements import SX, Local, Named

Array = np.ndarray
MX = ca.MX
KIND = "ConstrainedSystem"


@dataclass(frozen=True, eq=False)
class Expressions:
    """What the symbols of a system stand for.

    Attributes
    ----------
    t, q, v, lam
        Symbols of time, coordinates, velocities and multipliers, columns; `lam` or None.
    parameters
        Numbers and laws of time by symbol.
    """

    t: Any
    q: Any
    v: Any
    lam: Any
    parameters: Mapping[Any, float | Law]

    @classmethod
    def of(cls, t: Any, q: Any, v: Any, lam: Any, parameters: Any) -> Expressions:
        """With everything checked.

        Raises
        ------
        BeamdaeError
            On what is no symbol, sizes that do not fit, or parameters without a value.
        """
        symbols = {"t": t, "q": q, "v": v} | ({} if lam is None else {"lam": lam})
        for name, symbol in symbols.items():
            _require_symbol(name, symbol)
        if t.numel() != 1 or q.numel() != v.numel():
            raise BeamdaeError(
                f"{KIND}: t must be a scalar and q and v of one size, got sizes "
                f"{t.numel()}, {q.numel()} and {v.numel()}."
            )
        if any(not isinstance(symbol, type(t)) for symbol in symbols.values()):
            raise BeamdaeError(f"{KIND}: {_join_names(symbols)} must be all SX or all MX symbols.")
        found = cls(t, q, v, lam, _parse_parameters(type(t), parameters))
        own = [_symbol_key(x) for symbol in found.symbols for x in ca.symvar(symbol)]
        if len(own) > len(set(own)):
            told = _join_names([*symbols, *(["parameters"] if found.parameters else [])])
            raise BeamdaeError(f"{KIND}: {told} must be symbols of their own each.")
        return found

    @property
    def symbols(self) -> list[Any]:
        """All of them."""
        held = [] if self.lam is None else [self.lam]
        return [self.t, self.q, self.v, *self.parameters, *held]

    @cached_property
    def laws(self) -> tuple[tuple[str, Law], ...]:
        """The laws among the parameters, by name."""
        return tuple((s.name(), x) for s, x in self.parameters.items() if isinstance(x, Law))

    @cached_property
    def numbers(self) -> Array:
        """The numbers among the parameters."""
        return np.array([x for x in self.parameters.values() if not isinstance(x, Law)], float)

    def local(self, n_multipliers: int = 0) -> Local:
        """Symbols of a statement about the whole system."""
        return Local(self.q.numel(), len(self.numbers), n_multipliers)

    def stated(
        self,
        local: Local,
        expression: Any,
        name: str,
        on: tuple[str, ...] = ("t", "q", "v"),
        observed: bool = False,
    ) -> SX:
        """An expression in the symbols of `local`, if it depends on those named alone.

        Numbers in it must be finite, unless it is `observed`: runs tell of columns that are not.

        Raises
        ------
        BeamdaeError
            Naming what it depends on, or cannot be.
        """
        kind = type(self.t)
        told = _join_names([*on, *(["parameters"] if self.parameters else [])])
        try:
            found = kind(_stack(expression))
        except Exception:
            raise BeamdaeError(
                f"{KIND}: {name} must be made of numbers and {kind.__name__} expressions in "
                f"{told}, in rows of one length, got {short_repr(expression)}."
            ) from None
        given = [*(getattr(self, symbol) for symbol in on), *self.parameters]
        allowed = {_symbol_key(x) for symbol in given for x in ca.symvar(symbol)}
        others = [x.name() for x in ca.symvar(found) if _symbol_key(x) not in allowed]
        if others:
            raise BeamdaeError(
                f"{KIND}: {name} must depend on {told} alone, not on {', '.join(others[:3])}."
            )
        values = {"t": local.time[0], "q": local.q, "v": local.v, "lam": local.lam}
        inputs = [*(values[symbol] for symbol in on), *self._values(local)]
        try:
            value = ca.Function("stated", given, [found])(*inputs)
        except Exception:
            raise BeamdaeError(
                f"{KIND}: {name} uses a function without a formula, such as a "
                "solver of equations, it must be an expression that SX can hold."
            ) from None
        for entry in ca.vertsplit(value.nz[:]):
            if entry.is_constant() and not observed:
                require_finite(KIND, name, float(entry))
        return value

    def _values(self, local: Local) -> list[SX]:
        """What stands for each parameter."""
        places = iter(range(len(self.numbers)))
        return [
            value(local.time) if isinstance(value, Law) else local.data[next(places)]
            for value in self.parameters.values()
        ]


def _require_symbol(name: str, symbol: Any) -> None:
    if (
        not isinstance(symbol, (SX, MX))
        or not (symbol.is_column() and symbol.is_dense() and symbol.numel())
        or not symbol.is_valid_input()
    ):
        raise BeamdaeError(
            f"{KIND}: {name} must be a CasADi symbol, a column such as "
            f'SX.sym("{name}", 2), got {short_repr(symbol)}.'
        )


def _parse_parameters(kind: Any, given: Any) -> dict[Any, float | Law]:
    """Numbers and laws by symbol."""
    if not isinstance(given, Mapping) or not all(
        isinstance(symbol, kind) and symbol.is_scalar() and symbol.is_valid_input()
        for symbol in given
    ):
        raise BeamdaeError(
            f"{KIND}: parameters must give a number or a law of time by symbol, each such as "
            f'{kind.__name__}.sym("m"), got {short_repr(given)}.'
        )
    return {symbol: _parse_parameter(symbol.name(), value) for symbol, value in given.items()}


def _parse_parameter(name: str, value: Any) -> float | Law:
    if isinstance(value, Law) or callable(value):
        return as_law(name, value)
    return require_finite(KIND, f"the parameter {name}", value)


def _stack(expression: Any) -> Any:
    """An expression from a list of entries, or of rows."""
    if not isinstance(expression, (list, tuple)):
        return _require_entry(expression)
    rows = [
        ca.horzcat(*map(_require_entry, row))
        if isinstance(row, (list, tuple)) and row
        else _require_entry(row)
        for row in expression
    ]
    return ca.vertcat(*rows)


def _require_entry(expression: Any) -> Any:
    if as_real(expression) is None and not isinstance(expression, (SX, MX, ca.DM, np.ndarray)):
        raise TypeError
    return expression


def _symbol_key(symbol: Any) -> int:
    """What a symbol is known by; names are not unique."""
    return symbol.element_hash() if isinstance(symbol, SX) else hash(symbol)


def _join_names(names: Any) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}"


def parse_header(header: Any) -> Named:
    """The name and unit that a header such as 'tip.x [m]' tells; without a unit it is '-'.

    Raises
    ------
    BeamdaeError
        If it is no such text.
    """
    name, unit = header, "-"
    if isinstance(header, str) and header.endswith("]") and " [" in header:
        name, _, unit = header[:-1].rpartition(" [")
    require_unit(KIND, unit)
    return Named(require_name(KIND, name), unit)


def parse_numbers(name: str, values: Any, n: int) -> Array:
    """`values` as n finite numbers."""
    try:
        given = np.asarray(values, object).ravel().tolist()
    except Exception:
        # Symbols, or rows of different lengths.
        given = []
    if len(given) != n or any(as_real(x) is None for x in given):
        raise BeamdaeError(
            f"{KIND}: {name} must have {n} entries, finite numbers, got {short_repr(values)}."
        )
    return np.array([require_finite(KIND, name, x) for x in given])


def parse_names(name: str, values: Any, n: int) -> tuple[Any, ...]:
    """`values` as n entries, or none."""
    found = tuple(require_sequence(KIND, name, values, f"a list of {n} entries, texts"))
    if found and len(found) != n:
        raise BeamdaeError(
            f"{KIND}: {name} must have {n} entries, got {len(found)}: {short_repr(values)}."
        )
    return found
