"""Parameters on axes: numbers in their order, by ratios where they have one, and what is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.pictures import figures as pictures
from beamdae.report.text import shorten_text
from beamdae.studies.sweeps.sweep import short
from beamdae.studies.sweeps.tables import parameter_column

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from beamdae.studies.sweeps.results import SweepResults

Array = np.ndarray

# Ticks of an axis, letters of one, and letters below a panel.
_MOST_TICKS, _NAME, _ROOM = 12, 18, 48


@dataclass(frozen=True)
class Scale:
    """A parameter on an axis.

    Attributes
    ----------
    name
        Of the parameter.
    at
        Where each row of the table has its place.
    places
        The places there are, in order.
    labels
        Of places of what is no number; none for numbers.
    log
        Whether its values are of a constant ratio.
    """

    name: str
    at: Array
    places: Array
    labels: tuple[str, ...]
    log: bool

    @classmethod
    def of(cls, swept: SweepResults, name: str) -> Scale:
        """The scale of a parameter: numbers as they are, other values in the order they come in."""
        values = list(swept.table[parameter_column(swept.sweep, name)])
        if _numbers(values):
            at = np.array(values, float)
            places = np.unique(at)
            return cls(name, at, places, (), _is_geometric(places))
        told = [str(value) for value in values]
        order = list(dict.fromkeys(told))
        at = np.array([order.index(one) for one in told], float)
        return cls(name, at, np.arange(len(order), dtype=float), tuple(order), False)

    def dress(self, axes: Axes, which: str) -> None:
        """Name, scale and ticks of the "x" or the "y" axis."""
        axis = getattr(axes, f"{which}axis")
        axis.set_label_text(shorten_text(self.name, pictures.MAX_LABEL_LETTERS))
        if self.log:
            getattr(axes, f"set_{which}scale")("log")
        spread = np.linspace(0, len(self.places) - 1, _MOST_TICKS).round().astype(int)
        chosen = self.places[np.unique(spread)]
        # What stands beside each other shares the room there is.
        room = _ROOM // len(chosen) - 2 if which == "x" else _NAME
        if self.labels:
            names = [shorten_text(self.labels[int(k)], _NAME) for k in chosen]
            wide = max(map(len, names)) > room
            axis.set_ticks(chosen, names, **({"rotation": 30, "ha": "right"} if wide else {}))
            return
        names = [short(float(x)) for x in chosen]
        even = len(self.places) <= _MOST_TICKS // 2 or self.log
        if even and len(chosen) == len(self.places) and max(map(len, names)) <= room:
            axis.set_ticks(chosen, names)
            axis.set_ticks([], minor=True)

    def edges(self) -> Array:
        """Ends of the cells around the places."""
        x = np.log(self.places) if self.log else self.places
        if len(x) == 1:
            found = np.array([x[0] - 0.5, x[0] + 0.5])
        else:
            middles = 0.5 * (x[1:] + x[:-1])
            found = np.array([1.5 * x[0] - 0.5 * x[1], *middles, 1.5 * x[-1] - 0.5 * x[-2]])
        return np.exp(found) if self.log else found


def _numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(x, (int, float, np.number)) and not isinstance(x, (bool, np.bool_))
               for x in values)  # fmt: skip


def _is_geometric(places: Array) -> bool:
    if len(places) < 3 or places[0] <= 0.0:
        return False
    ratios = places[1:] / places[:-1]
    return bool(np.allclose(ratios, ratios[0], rtol=1e-6))
