"""Settings of an equilibrium path: the arguments of `equilibrium`, and control by a column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.analysis.continuation.engine import Row
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_choice,
    require_count,
    require_finite,
    require_mapping,
    require_positive,
    require_sequence,
    short_repr,
    suggest,
)
from beamdae.results.columns import remove_unit
from beamdae.results.equilibrium import static_headers

Array = np.ndarray

_NAME = "equilibrium"
LOAD, DISPLACEMENT, ARC_LENGTH = "load", "displacement", "arc length"


@dataclass(frozen=True)
class PathSettings:
    """Settings of an equilibrium path: validated arguments of `equilibrium`.

    Attributes
    ----------
    column
        Name of the observed column to which `targets` refer; "" if they are load factors.
    varies
        Quantity that varies in place of a load factor, as the user named it; "" if there is none.
    targets, control, step, switch, max_points
        See `to`, `control`, `step`, `switch` and `max_points` of `equilibrium`.
    """

    column: str = ""
    targets: tuple[float, ...] = (1.0,)
    control: str = LOAD
    step: float | None = None
    switch: tuple[int, ...] = ()
    max_points: int = 500
    varies: str = ""

    @classmethod
    def from_arguments(
        cls, to: Any, control: Any, step: Any, switch: Any, max_points: Any, over: Any = None
    ) -> PathSettings:
        """Validate arguments of `equilibrium` and return them as settings.

        Raises
        ------
        BeamdaeError
            If an argument is invalid; the message names it.
        """
        column, values = "", 1.0 if to is None and over is None else to
        if over is not None and (to is None or isinstance(to, Mapping)):
            raise BeamdaeError(
                f"equilibrium: to must be the last value of {short_repr(over)}, or a list of "
                f"values, got {short_repr(to)}; pass a number."
            )
        if isinstance(to, Mapping):
            what = (
                "a load factor, a list of load factors, or one observed position with a value "
                "such as {'tip.y': -0.1}"
            )
            positions = require_mapping(_NAME, "to", to, what)
            if len(positions) != 1:
                raise BeamdaeError(f"equilibrium: to must be {what}, got {short_repr(to)}.")
            ((column, values),) = positions.items()
        targets = _require_numbers("to", values, "numbers")
        if not targets:
            raise BeamdaeError("equilibrium: to must contain at least one number.")
        numbers = _require_numbers("switch", switch, "a whole number or a list of whole numbers")
        counts = [require_count(_NAME, "switch", abs(x), 1) for x in numbers if numbers != (0.0,)]
        default = ARC_LENGTH if counts else DISPLACEMENT if column else LOAD
        control = default if control is None else control
        require_choice(_NAME, "control", control, (LOAD, DISPLACEMENT, ARC_LENGTH))
        if control not in (default, ARC_LENGTH):
            raise BeamdaeError(
                f"equilibrium: control={control!r} is not supported with the given to=, switch= "
                f"and over=; omit it, or use control={ARC_LENGTH!r}."
            )
        return cls(
            column,
            targets,
            control,
            None if step is None else require_positive(_NAME, "step", step),
            tuple(k if x > 0.0 else -k for k, x in zip(counts, numbers, strict=False)),
            require_count(_NAME, "max_points", max_points, 2),
            over or "",
        )

    @property
    def description(self) -> dict[str, Any]:
        """Settings as plain values for `Equilibrium.settings`."""
        to = list(self.targets)
        return {
            **({"over": self.varies} if self.varies else {}),
            "to": {self.column: to} if self.column else to,
            "control": self.control,
            "step": self.step,
            "switch": list(self.switch),
        }


def _require_numbers(argument: str, values: Any, expected: str) -> tuple[float, ...]:
    """Return a finite number, or a list of them, as a tuple."""
    is_number = as_real(values) is not None
    items = [values] if is_number else require_sequence(_NAME, argument, values, expected)
    return tuple(require_finite(_NAME, argument, value) for value in items)


@dataclass(frozen=True)
class PrescribedColumn:
    """Control by an observed column that is a function of positions.

    Attributes
    ----------
    equations
        Equations with the observable.
    observable, column
        Observable, and index of its column.
    time
        (t, branch).
    """

    equations: EquationsOfMotion
    observable: Observable
    column: int
    time: Array

    @classmethod
    def from_name(cls, equations: EquationsOfMotion, name: str, time: Array) -> PrescribedColumn:
        """Return the control for the column `name`, which may include the unit.

        Raises
        ------
        BeamdaeError
            If there is no such column, or it depends on velocities or reactions.
        """
        positions: dict[str, tuple[Observable, int]] = {}
        without_rates = set(static_headers(equations))
        for observable in equations.observables:
            for k, header in enumerate(observable.headers):
                if header in without_rates and observable.rows.stop == observable.rows.start:
                    positions[header] = positions[remove_unit(header)] = (observable, k)
        if name not in positions:
            names = ", ".join(x for x in positions if not x.endswith("]")) or "none"
            raise BeamdaeError(
                "equilibrium: to must name an observed position, got "
                f"{short_repr(name)}{suggest(name, positions)}; observe this position, or name an "
                f"observed one (observed: {names})."
            )
        switching = equations.configurations
        inactive = frozenset() if switching is None else switching.initially_inactive
        return cls(equations.without_loads_of(inactive), *positions[name], time)

    @cached_property
    def _position_derivative(self):  # type: ignore[no-untyped-def]
        return self.observable.function.derivative(1)

    def __call__(self, x: Array, p: float) -> Row:
        """Return the column, in its unit, at x = (q, ...) as a control of the curve engine."""
        o, gradient = self.observable, np.zeros(len(x) + 1)
        local = np.asarray(o.operator @ x[: self.equations.n])[None]
        numbers, no_reactions = self.equations.p[o.data], np.zeros((1, 0))
        arguments = self.time[None], local, np.zeros_like(local), numbers, no_reactions
        rows = self._position_derivative(*arguments).reshape(-1, len(o.columns))
        gradient[: self.equations.n] = o.operator.T @ rows[:, self.column]
        return Row(float(o.function(*arguments)[0, self.column]), gradient)
