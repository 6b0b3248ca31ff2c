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

    column: str
    targets: tuple[float, ...]
    control: str
    step: float | None
    switch: tuple[int, ...]
    max_points: int
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
        name, column, values = "equilibrium", "", 1.0 if to is None and over is None else to
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
            positions = require_mapping(name, "to", to, what)
            if len(positions) != 1:
                raise BeamdaeError(f"equilibrium: to must be {what}, got {short_repr(to)}.")
            ((column, values),) = positions.items()
        is_number = as_real(values) is not None
        items = [values] if is_number else require_sequence(name, "to", values, "numbers")
        targets = tuple(require_finite(name, "to", value) for value in items)
        if not targets:
            raise BeamdaeError("equilibrium: to must contain at least one number.")
        switch = _parse_switches(switch)
        default = ARC_LENGTH if switch else DISPLACEMENT if column else LOAD
        control = default if control is None else control
        require_choice(name, "control", control, (LOAD, DISPLACEMENT, ARC_LENGTH))
        if control not in (default, ARC_LENGTH):
            raise BeamdaeError(
                f"equilibrium: control={control!r} is not supported with the given to=, switch= "
                f"and over=; omit it, or use control={ARC_LENGTH!r}."
            )
        size = None if step is None else require_positive(name, "step", step)
        max_points = require_count(name, "max_points", max_points, 2)
        return cls(column, targets, control, size, switch, max_points, over or "")

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

    def for_earlier_stage(self) -> PathSettings:
        """Return the settings for stages before the last: load control up to the full load."""
        return PathSettings("", (1.0,), LOAD, None, (), self.max_points)


def _parse_switches(switch: Any) -> tuple[int, ...]:
    """Return the signed numbers of the branch points at which to switch; empty for 0."""
    expected = "a whole number or a list of whole numbers"
    is_number = as_real(switch) is not None
    items = [switch] if is_number else require_sequence("equilibrium", "switch", switch, expected)
    numbers = [require_finite("equilibrium", "switch", number) for number in items]
    if numbers == [0.0]:
        return ()
    counts = [require_count("equilibrium", "switch", abs(number), 1) for number in numbers]
    return tuple(k if number > 0.0 else -k for k, number in zip(counts, numbers, strict=True))
