"""What is asked for of an equilibrium path: targets, and what is given in each step."""

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
    require_positive,
    require_sequence,
    short_repr,
)

LOAD, DISPLACEMENT, ARC = "load", "displacement", "arc length"


@dataclass(frozen=True)
class Asked:
    """What was asked for, checked.

    Attributes
    ----------
    column
        The observed column that `targets` are values of; "": the load factor.
    targets, control, step, switch, most
        See `equilibrium`.
    """

    column: str
    targets: tuple[float, ...]
    control: str
    step: float | None
    switch: tuple[int, ...]
    most: int

    @classmethod
    def of(cls, to: Any, control: Any, step: Any, switch: Any, most: Any) -> Asked:
        """Checked settings.

        Raises
        ------
        BeamdaeError
            Naming the setting that is wrong.
        """
        name, column, values = "equilibrium", "", to
        if isinstance(to, Mapping):
            if len(to) != 1 or not isinstance(next(iter(to)), str):
                raise BeamdaeError(
                    "equilibrium: to must be a load factor, several, or one observed position with "
                    f"its value such as {{'tip.y': -0.1}}, got {short_repr(to)}."
                )
            ((column, values),) = to.items()
        listed = (
            [values]
            if as_real(values) is not None
            else require_sequence(name, "to", values, "numbers")
        )
        targets = tuple(require_finite(name, "to", value) for value in listed)
        if not targets:
            raise BeamdaeError("equilibrium: to must hold at least one number.")
        switch = _switches(switch)
        if control is None:
            control = ARC if switch else DISPLACEMENT if column else LOAD
        require_choice(name, "control", control, (LOAD, DISPLACEMENT, ARC))
        fits = {LOAD: not column and not switch, DISPLACEMENT: bool(column) and not switch}
        if not fits.get(control, True):
            instead = "'arc length'" if switch else "'displacement'" if column else "'load'"
            raise BeamdaeError(
                f"equilibrium: control={control!r} does not go with these to and switch, take "
                f"control={instead}."
            )
        size = None if step is None else require_positive(name, "step", step)
        return cls(
            column, targets, control, size, switch, require_count(name, "most_points", most, 2)
        )

    @property
    def told(self) -> dict[str, Any]:
        """As plain values."""
        to = list(self.targets)
        told = {"to": {self.column: to} if self.column else to, "control": self.control}
        return {**told, "step": self.step, "switch": list(self.switch)}

    def of_stage(self) -> Asked:
        """What is asked for of a stage before the last: all of its load."""
        return Asked("", (1.0,), LOAD, None, (), self.most)


def _switches(switch: Any) -> tuple[int, ...]:
    """Branch points to leave at, one after the other; none where that is 0."""
    what = "a whole number or several"
    listed = (
        [switch]
        if as_real(switch) is not None
        else require_sequence("equilibrium", "switch", switch, what)
    )
    sides = [require_finite("equilibrium", "switch", side) for side in listed]
    if sides == [0.0]:
        return ()
    found = [require_count("equilibrium", "switch", abs(side), 1) for side in sides]
    return tuple(k if side > 0.0 else -k for k, side in zip(found, sides, strict=True))
