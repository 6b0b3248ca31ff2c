"""CasADi expressions of a constrained system: validation and substitution of symbols."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    join_names,
    plain_text,
    require_entries,
    require_finite,
    require_name,
    require_sequence,
    require_unit,
    short_repr,
)
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.statements import SX, Local, Variable

Array = np.ndarray
MX = ca.MX
KIND = "ConstrainedSystem"  # prefix of messages
_MAX_LISTED_SYMBOLS = 3


@dataclass(frozen=True, eq=False)
class Expressions:
    """Symbols of a constrained system and the values of its parameters.

    Attributes
    ----------
    t, q, v, lam
        Symbols of time, coordinates, velocities and multipliers, as columns; `lam` may be None.
    parameters
        Value of each parameter, a number or a time law, by symbol.
    """

    t: Any
    q: Any
    v: Any
    lam: Any
    parameters: Mapping[Any, float | Law]

    @classmethod
    def of(cls, t: Any, q: Any, v: Any, lam: Any, parameters: Any) -> Expressions:
        """Validate symbols and parameters and return them as `Expressions`.

        Raises
        ------
        BeamdaeError
            If an argument is not a symbol, `t` is not a scalar, `q` and `v` differ in size, SX and
            MX are mixed, symbols are used twice, or a parameter is neither a number nor a law.
        """
        symbols = {"t": t, "q": q, "v": v} | ({} if lam is None else {"lam": lam})
        for name, symbol in symbols.items():
            _require_symbol(name, symbol)
        if t.numel() != 1 or q.numel() != v.numel():
            raise BeamdaeError(
                f"{KIND}: t must be a scalar, and q and v must have equal sizes, got "
                f"sizes {t.numel()}, {q.numel()} and {v.numel()}."
            )
        if any(not isinstance(symbol, type(t)) for symbol in symbols.values()):
            raise BeamdaeError(f"{KIND}: {join_names(symbols)} must be all SX or all MX symbols.")
        expressions = cls(t, q, v, lam, _parse_parameters(type(t), parameters))
        keys = [_symbol_key(x) for symbol in expressions.symbols for x in ca.symvar(symbol)]
        if len(keys) > len(set(keys)):
            names = join_names([*symbols, *(["parameters"] if expressions.parameters else [])])
            raise BeamdaeError(f"{KIND}: {names} must be different symbols.")
        return expressions

    @property
    def symbols(self) -> list[Any]:
        """All symbols: t, q, v, the parameters and, if given, lam."""
        multipliers = [] if self.lam is None else [self.lam]
        return [self.t, self.q, self.v, *self.parameters, *multipliers]

    @cached_property
    def laws(self) -> tuple[tuple[str, Law], ...]:
        """Pairs (name of the symbol, law) of the parameters that are laws."""
        return tuple((s.name(), x) for s, x in self.parameters.items() if isinstance(x, Law))

    @cached_property
    def numbers(self) -> Array:
        """Values of the parameters that are numbers, (k,)."""
        return np.array([x for x in self.parameters.values() if not isinstance(x, Law)], float)

    def local(self, n_multipliers: int = 0) -> Local:
        """Return new symbols for a statement with `n_multipliers` multipliers."""
        return Local(self.q.numel(), len(self.numbers), n_multipliers)

    def substitute(
        self,
        local: Local,
        expression: Any,
        name: str,
        on: tuple[str, ...] = ("t", "q", "v"),
        observed: bool = False,
    ) -> SX:
        """Replace the system symbols in an expression by the symbols of `local`.

        Parameters
        ----------
        local
            Symbols of the statement.
        expression
            A number or expression, a list of these, or a list of rows.
        name
            Name of the expression in messages.
        on
            Names of the symbols that the expression may contain besides the parameters.
        observed
            True for output columns, which may contain nan and inf.

        Returns
        -------
        SX
            The expression in terms of the symbols of `local`.

        Raises
        ------
        BeamdaeError
            If `expression` depends on another symbol, cannot be converted to CasADi or expanded to
            SX, or, unless `observed`, has a constant entry that is nan, inf or too large.
        """
        kind = type(self.t)
        allowed_names = join_names([*on, *(["parameters"] if self.parameters else [])])
        try:
            stacked = kind(_stack(expression))
        except Exception:
            raise BeamdaeError(
                f"{KIND}: {name} must consist of numbers and {kind.__name__} "
                f"expressions in {allowed_names}, with rows of equal length, got "
                f"{short_repr(expression)}."
            ) from None
        symbols = [*(getattr(self, symbol) for symbol in on), *self.parameters]
        allowed_keys = {_symbol_key(x) for symbol in symbols for x in ca.symvar(symbol)}
        others = [x.name() for x in ca.symvar(stacked) if _symbol_key(x) not in allowed_keys]
        if others:
            raise BeamdaeError(
                f"{KIND}: {name} must depend only on {allowed_names}, not on "
                f"{', '.join(others[:_MAX_LISTED_SYMBOLS])}."
            )
        values = {"t": local.time[0], "q": local.q, "v": local.v, "lam": local.lam}
        indices = iter(range(len(self.numbers)))
        parameters = [
            value(local.time) if isinstance(value, Law) else local.data[next(indices)]
            for value in self.parameters.values()
        ]
        try:
            value = ca.Function("stated", symbols, [stacked])(
                *(values[symbol] for symbol in on), *parameters
            )
        except Exception:
            raise BeamdaeError(
                f"{KIND}: {name} uses a function that SX cannot expand, such as a root "
                "finder; use a closed-form expression instead."
            ) from None
        for entry in ca.vertsplit(value.nz[:]):
            if entry.is_constant() and not observed:
                require_finite(KIND, name, float(entry))
        return value


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


def _parse_parameters(kind: Any, parameters: Any) -> dict[Any, float | Law]:
    what = f'a dict from symbols such as {kind.__name__}.sym("m") to numbers or time laws'
    entries = require_entries(KIND, "parameters", parameters, what)
    if not all(
        isinstance(symbol, kind) and symbol.is_scalar() and symbol.is_valid_input()
        for symbol in entries
    ):
        raise BeamdaeError(f"{KIND}: parameters must be {what}, got {short_repr(parameters)}.")
    values: dict[Any, float | Law] = {}
    for symbol, value in entries.items():
        name = symbol.name()
        if isinstance(value, Law) or callable(value):
            law = values[symbol] = as_law(name, value)
            if law.ranges:
                raise BeamdaeError(
                    f"{name}: a {KIND} does not support tables with outside='error'; pass "
                    "outside='hold'."
                )
        else:
            values[symbol] = require_finite(KIND, f"the parameter {name}", value)
    return values


def _stack(expression: Any) -> Any:
    """Stack an expression given as an entry, a list of entries, or a list of rows."""
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
    """Return a key that identifies a symbol, because names are not unique."""
    return symbol.element_hash() if isinstance(symbol, SX) else hash(symbol)


def parse_header(header: Any) -> Variable:
    """Return the `Variable` of a header such as 'tip.x [m]'; the unit defaults to '-'.

    Raises
    ------
    BeamdaeError
        If the name or the unit is invalid.
    """
    name, unit = plain_text(header), "-"
    if isinstance(name, str) and name.endswith("]") and " [" in name:
        name, _, unit = name[:-1].rpartition(" [")
    require_unit(KIND, unit)
    return Variable(require_name(KIND, name), unit)


def parse_numbers(name: str, values: Any, n: int) -> Array:
    """Return `values` as an array of finite numbers, (n,).

    Raises
    ------
    BeamdaeError
        If there are not n values, or a value is not a finite number.
    """
    try:
        entries = np.asarray(values, object).ravel().tolist()
    except Exception:
        # CasADi symbols and rows of different lengths cannot be converted.
        entries = []
    if len(entries) != n or any(as_real(x) is None for x in entries):
        raise BeamdaeError(
            f"{KIND}: {name} must have length {n} and finite entries, got {short_repr(values)}."
        )
    return np.array([require_finite(KIND, name, x) for x in entries])


def parse_names(name: str, values: Any, n: int) -> tuple[Any, ...]:
    """Return `values` as a tuple of n entries, or as an empty tuple if `values` is empty.

    Raises
    ------
    BeamdaeError
        If `values` is not a sequence, or has neither n nor zero entries.
    """
    entries = tuple(require_sequence(KIND, name, values, f"a list of {n} strings"))
    if entries and len(entries) != n:
        raise BeamdaeError(
            f"{KIND}: {name} must have length {n}, got length {len(entries)}: {short_repr(values)}."
        )
    return entries
