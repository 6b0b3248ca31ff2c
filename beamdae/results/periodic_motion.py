"""Result of a search for a periodic motion: one period, its stability and its amplitudes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from beamdae.results.columns import Header
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_STABILITY_MARGIN = 1e-4  # by which multipliers of stable motions may exceed 1
_IMAGINARY_ROUNDING = 1e-6  # imaginary part of a real multiplier, relative to its modulus


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicMotion:
    """A motion that repeats after a period, and its stability by Floquet's theory.

    Attributes
    ----------
    solution
        One period of the motion; if a run did not reach the end of its periods, that run.
    period
        Period [s].
    multipliers
        Floquet multipliers, largest first: the eigenvalues of the monodromy matrix on the motions
        that the joints allow, by which disturbances grow in one period. Disturbances in modes that
        are too fast for the steps decay numerically, whether or not they are damped.
    multiplier_error
        Change of the largest multiplier when the steps of the disturbances are halved.
    off
        Difference between the start and the end of the period, relative to the range of the
        coordinates [-].
    iterations
        Number of iterations of Newton's method.
    status
        Whether the search converged, and the reason if it did not.
    """

    solution: Solution
    period: float
    multipliers: Array = field(default_factory=lambda: np.zeros(0, complex))
    multiplier_error: float = np.inf
    off: float = np.inf
    iterations: int = 0
    status: Status = field(default=Status("ok", "repeats after its period"))

    def __repr__(self) -> str:
        return f"<PeriodicMotion: period {self.period:g} s, {self.status.kind}, {self.stability}>"

    @property
    def stable(self) -> bool:
        """True if the search converged and no disturbance grows."""
        limit = 1.0 + _STABILITY_MARGIN + self.multiplier_error
        return self.status.success and largest_modulus(self.multipliers) <= limit

    @property
    def stability(self) -> str:
        """Stability in words, with the way in which disturbances grow."""
        if not self.status.success:
            return f"not known: {self.status.sentence}"
        if self.stable:
            return "stable"
        multiplier = self.multipliers[0]
        growth = "they oscillate about it"
        if abs(multiplier.imag) <= _IMAGINARY_ROUNDING * abs(multiplier):
            growth = "they stay on one side" if multiplier.real > 0 else "they double the period"
        return f"unstable: disturbances grow by {abs(multiplier):.6g} in a period, {growth}"

    def amplitudes(self) -> pd.DataFrame:
        """Return mean, half range, minimum and maximum of each observed column, one row each."""
        import pandas as pd

        rows = {}
        for header, values in self.solution.columns.items():
            unit = Header.of(header).unit
            rows[header] = (mean(values), half_range(values), *extrema(values), unit)
        names = ["mean", "half range", "least", "largest", "unit"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=names)


def mean(values: Array) -> float:
    """Return the mean over a period of equally spaced samples that include both ends."""
    return float(np.mean(0.5 * (values[:-1] + values[1:]) if len(values) > 1 else values))


def extrema(values: Array) -> tuple[float, float]:
    """Return minimum and maximum of equally spaced samples, by parabolas through three samples."""
    return -_maximum(-values), _maximum(values)


def half_range(values: Array) -> float:
    """Return half the difference of maximum and minimum."""
    minimum, maximum = extrema(values)
    return 0.5 * (maximum - minimum)


def _maximum(values: Array) -> float:
    if len(values) < 3:
        return float(np.max(values))
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    before, here, after = values[k - 1 : k + 2].tolist()
    slope, curvature = 0.5 * (after - before), before - 2.0 * here + after
    # A vertex beyond the three samples is not used; the maximum is then at an end.
    is_inside = abs(slope) < -curvature
    return here - 0.5 * slope**2 / curvature if is_inside else max(before, here, after)


def largest_modulus(multipliers: Array) -> float:
    """Return the largest modulus of Floquet multipliers, 0 if there are none."""
    return float(np.max(np.abs(multipliers), initial=0.0))


def floquet_multipliers(monodromy: Array) -> Array:
    """Return the eigenvalues of a monodromy matrix, the largest first."""
    multipliers = np.linalg.eigvals(monodromy)
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
