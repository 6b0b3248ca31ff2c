"""The result of a search for periodic motions over a parameter: points, table, folds, peaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import require_choice
from beamdae.results.displays import Plot, load_views
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import half_range, largest_modulus, mean
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# A multiplier beyond one by this much makes a motion unstable.
_UNSTABLE = 1e-3


@dataclass(frozen=True, eq=False)
class ResponsePoint:
    """A periodic motion of a response curve.

    Attributes
    ----------
    parameter, period
        Value of the parameter, and period [s].
    solution
        One period of the motion.
    multipliers
        Floquet multipliers, the largest first.
    forward
        Whether the parameter grows along the curve there.
    """

    parameter: float
    period: float
    solution: Solution
    multipliers: Array
    forward: bool = True

    @property
    def stable(self) -> bool:
        """Whether no disturbance grows."""
        return largest_modulus(self.multipliers) <= 1.0 + _UNSTABLE


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse:
    """Periodic motions along a curve over a parameter.

    Attributes
    ----------
    parameter
        Its name.
    points
        The motions in the order of the curve.
    status
        Whether the curve reached the end of the range, or why not.
    """

    parameter: str
    points: tuple[ResponsePoint, ...]
    status: Status

    def __repr__(self) -> str:
        values = [point.parameter for point in self.points]
        reach = f", {self.parameter} {min(values):g} to {max(values):g}" if values else ""
        ended = f"{self.status.kind}, {self.status.sentence}"
        return f"<FrequencyResponse: {len(values)} motions{reach}; {ended}>"

    def table(self) -> pd.DataFrame:
        """One row a motion: parameter, period, mean and half the range of each observed column.

        Behind them whether it is stable, the largest modulus of its multipliers, and "fold" where
        the parameter turned around.
        """
        import pandas as pd

        return pd.DataFrame([self._row(k) for k in range(len(self.points))])

    def _row(self, k: int) -> dict[str, Any]:
        point = self.points[k]
        row: dict[str, Any] = {self.parameter: point.parameter, "period [s]": point.period}
        for header, values in point.solution.columns.items():
            name, _, unit = header.partition(" [")
            row |= {
                f"{name} mean [{unit}": mean(values),
                f"{name} half range [{unit}": half_range(values),
            }
        fold = k > 0 and point.forward != self.points[k - 1].forward
        return row | {
            "stable": point.stable,
            "largest multiplier": largest_modulus(point.multipliers),
            "fold": fold,
        }

    def plot(self, column: str) -> Plot:
        """Draw half the range of an observed column over the parameter: dashed where unstable."""
        return load_views().plot_frequency_response(self, column)

    @property
    def folds(self) -> list[float]:
        """Values of the parameter at which the curve turns around.

        Vertices of the parabolas through the points around each.
        """
        values = np.array([point.parameter for point in self.points])
        turned = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
        return [self._vertex(k, values) for k in turned.tolist()]

    def peaks(self, column: str) -> list[tuple[float, float]]:
        """(parameter, half the range) where half the range of an observed column is largest.

        Of each peak of the curve, by the parabola through the points around it.
        """
        if not self.points:
            return []
        values, sizes = self.curve(column)
        (inner,) = np.nonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] > sizes[2:]))
        found = []
        for k in (inner + 1).tolist():
            at = self._top(k, sizes)
            found.append(
                (_lagrange(at, k, self._along, values), _lagrange(at, k, self._along, sizes))
            )
        return found

    def curve(self, column: str) -> tuple[Array, Array]:
        """Values of the parameter, and half the range of an observed column, of each motion."""
        if self.points:
            require_choice(
                "frequency_response", "column", column, list(self.points[0].solution.columns)
            )
        values = np.array([point.parameter for point in self.points])
        return values, np.array([half_range(x.solution.columns[column]) for x in self.points])

    @property
    def _along(self) -> Array:
        """Arc length of the curve, in what the parameter and the first column change."""
        values = np.array([point.parameter for point in self.points])
        sizes = np.array([list(map(half_range, p.solution.columns.values())) for p in self.points])
        rows = np.concatenate([values[:, None], sizes], axis=1)
        rows = rows / np.where(np.ptp(rows, axis=0) > 0.0, np.ptp(rows, axis=0), 1.0)
        steps = np.linalg.norm(np.diff(rows, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-12))])

    def _top(self, k: int, values: Array) -> float:
        """Where along the curve the parabola through three points has its vertex."""
        x, y = self._along[k - 1 : k + 2], values[k - 1 : k + 2]
        a, b, _ = np.polyfit(x - x[1], y, 2)
        return float(x[1] - 0.5 * b / a) if a != 0.0 else float(x[1])

    def _vertex(self, k: int, values: Array) -> float:
        return _lagrange(self._top(k, values), k, self._along, values)


def _lagrange(at: float, k: int, along: Array, values: Array) -> float:
    x, y = along[k - 1 : k + 2], values[k - 1 : k + 2]
    return float(np.polyval(np.polyfit(x - x[1], y, 2), at - x[1]))
