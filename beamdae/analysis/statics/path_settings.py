"""Settings of an equilibrium path: the validated arguments of `equilibrium`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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
)

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
