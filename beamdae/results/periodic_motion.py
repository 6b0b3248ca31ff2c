"""The result of a search for periodic motion: one period, its stability, amplitudes."""

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

# Beyond one by this much a multiplier is taken to be.
_UNSTABLE = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicMotion:
    """A motion that repeats after a period, and its stability (Floquet).

    Attributes
    ----------
    solution
        One period of it; where a run did not reach the end of its periods, that run.
    period
        [s].
    multipliers
        Floquet multipliers, the eigenvalues of the monodromy matrix on the motions the joints
        allow, largest first: what a disturbance has grown to after a period. Disturbances in modes
        too fast for the steps die out in them, damped or not.
    multiplier_error
        By how much the largest changed when the steps of the disturbances were halved.
    off
        By how much a period misses its start, over how far coordinates move.
    iterations
        Of Newton's method.
    status
        Whether it converged, and a sentence.
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
        """Whether it repeats and no disturbance grows."""
        most = largest_modulus(self.multipliers) <= 1.0 + _UNSTABLE + self.multiplier_error
        return self.status.success and most

    @property
    def stability(self) -> str:
        """In words: stable, or how disturbances grow."""
        if not self.status.success:
            return f"not known: {self.status.sentence}"
        if self.stable:
            return "stable"
        most = self.multipliers[0]
        how = "disturbances turn around it"
        if abs(most.imag) <= 1e-6 * abs(most):
            how = "they grow on one side" if most.real > 0 else "they double the period"
        return f"unstable: disturbances grow by {abs(most):.6g} in a period, {how}"

    def amplitudes(self) -> pd.DataFrame:
        """One row an observed column: mean, half the range, least and largest of the period."""
        import pandas as pd

        rows = {}
        for header, values in self.solution.columns.items():
            unit = Header.of(header).unit
            rows[header] = (mean(values), half_range(values), *extrema(values), unit)
        names = ["mean", "half range", "least", "largest", "unit"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=names)


def mean(values: Array) -> float:
    """Mean of what was sampled evenly from one end of the period to the other."""
    return float(np.mean(0.5 * (values[:-1] + values[1:]) if len(values) > 1 else values))


def extrema(values: Array) -> tuple[float, float]:
    """Least and largest of what was sampled evenly, by parabolas through three samples."""
    return -_top(-values), _top(values)


def half_range(values: Array) -> float:
    """Half of largest less least."""
    least, most = extrema(values)
    return 0.5 * (most - least)


def _top(values: Array) -> float:
    if len(values) < 3:
        return float(np.max(values))
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    before, here, after = values[k - 1 : k + 2].tolist()
    slope, bend = 0.5 * (after - before), before - 2.0 * here + after
    # Beyond the samples a parabola tells nothing: the end is the largest.
    inside = abs(slope) < -bend
    return here - 0.5 * slope**2 / bend if inside else max(before, here, after)


def largest_modulus(multipliers: Array) -> float:
    """Largest modulus."""
    return float(np.max(np.abs(multipliers), initial=0.0))


def floquet_multipliers(carried: Array) -> Array:
    """Eigenvalues of a monodromy matrix, the largest first."""
    found = np.linalg.eigvals(carried)
    return found[np.argsort(-np.abs(found), kind="stable")]
