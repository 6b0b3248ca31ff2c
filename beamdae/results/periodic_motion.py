"""Result of a search for a periodic motion: one period, stability and amplitudes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.read_only import read_only_data
from beamdae.results.columns import Header
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_STABILITY_MARGIN = 1e-4  # moduli of the multipliers of stable motions may exceed 1 by this
# Larger errors leave the stability open if they exceed the distance of the largest modulus from 1.
_MAX_MULTIPLIER_ERROR = 1e-2
# In place of the remedy of warnings about output rows, an option that periodic motions do not have.
_ROW_REMEDY = (
    "amplitudes include the steps between the rows, but curves and the table of the rows do not."
)
_IMAGINARY_ROUNDING = 1e-6  # largest imaginary part / modulus of a real multiplier


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class PeriodicMotion(HasTable, HasPage):
    """A periodic motion and its stability according to Floquet theory.

    Attributes
    ----------
    solution
        One period of the motion or, if the search did not converge, of its best iterate. If a run
        of the search ended early, this incomplete run; then, `multipliers` is empty, and
        `multiplier_error` and `off` are infinite.
    period
        Period [s].
    multipliers
        Floquet multipliers, complex, sorted by descending modulus: eigenvalues of the monodromy
        matrix for the motions that the joints allow. The modulus of a multiplier is the growth
        factor of a perturbation per period. Perturbations in modes that the steps do not resolve
        decay numerically, even if the modes are undamped.
    multiplier_error
        Estimated error of the largest modulus, from its changes when the steps of the variational
        equations are halved.
    off
        Largest difference between the states at the start and the end of the period, relative to
        the amplitudes of the motion [-].
    iterations
        Number of Newton iterations.
    status
        Outcome of the search; `status.kind` is "ok" if the search converged.
    is_free
        True if the period was an unknown.
    """

    solution: Solution
    period: float
    multipliers: Array = field(default_factory=lambda: np.zeros(0, complex))
    multiplier_error: float = np.inf
    off: float = np.inf
    iterations: int = 0
    status: Status = field(default=Status("ok", "repeats after one period"))
    is_free: bool = False

    @cached_property
    def errors(self) -> Any:
        """Errors of the columns, a free period and the largest multiplier, see `Errors`."""
        return deferred.module("accuracy.periodic").measure_motion(self)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on `errors`, warnings of `solution` and, after a failure, the reason."""
        about_errors = deferred.module("accuracy.runs").check_errors(self, self.solution)
        outcome = () if self.status.success else (f"periodic: {self.status.sentence}.",)
        return (*about_errors, *run_warnings(self.solution), *outcome)

    def __repr__(self) -> str:
        return f"<PeriodicMotion: period {self.period:g} s, {self.status.kind}, {self.stability}>"

    @property
    def stable(self) -> bool:
        """True if the search converged and no perturbation grows.

        Moduli of the multipliers may exceed 1 by 1e-4 plus `multiplier_error`, unless the error is
        so large that the stability is not known.
        """
        limit = 1.0 + _STABILITY_MARGIN + self.multiplier_error
        is_known = self.status.success and not self._is_uncertain
        return is_known and largest_modulus(self.multipliers) <= limit

    @property
    def _is_uncertain(self) -> bool:
        """True if a large error of the multipliers does not permit a statement on stability."""
        error = self.multiplier_error
        distance = abs(largest_modulus(self.multipliers) - 1.0)
        return error > _MAX_MULTIPLIER_ERROR and distance <= error

    @property
    def stability(self) -> str:
        """Description of the stability: "stable", "unstable: ..." or "not known: ..."."""
        if not self.status.success:
            return f"not known: {self.status.sentence}"
        if self._is_uncertain:
            return (
                f"not known: the largest multiplier, {largest_modulus(self.multipliers):.3g}, is "
                f"uncertain by {self.multiplier_error:.2g}; use a smaller rtol"
            )
        if self.stable:
            return "stable"
        multiplier = self.multipliers[0]
        growth = "disturbances oscillate about the motion"
        if abs(multiplier.imag) <= _IMAGINARY_ROUNDING * abs(multiplier):
            growth = (
                "disturbances keep their sign"
                if multiplier.real > 0
                else "disturbances double the period"
            )
        return f"unstable: growth by a factor of {abs(multiplier):.6g} per period, {growth}"

    def __getitem__(self, name: str | Sequence[str]) -> pd.Series | pd.DataFrame:
        """Return columns of the period over time by name, see `Solution.__getitem__`."""
        return self.solution[name]

    def __contains__(self, name: object) -> bool:
        """Return True if `motion[name]` selects columns."""
        return name in self.solution

    def table(self) -> pd.DataFrame:
        """Return time, observed columns and energies of the period, see `Solution.table`."""
        return self.solution.table()

    def plot(
        self,
        *names: str,
        x: str | None = None,
        data: Any = None,
        data_columns: Mapping[str, str] | None = None,
    ) -> Plot:
        """Plot columns of the period over time or over another column, see `beamdae.plot`.

        Parameters
        ----------
        *names, x, data, data_columns
            See `Solution.plot`.

        Raises
        ------
        BeamdaeError
            See `Solution.plot`.
        """
        return self.solution.plot(*names, x=x, data=data, data_columns=data_columns)

    def amplitudes(self) -> pd.DataFrame:
        """Return mean, half range, minimum, maximum and unit, with one row per observed column.

        They include the steps between the rows of `table`.
        """
        import pandas as pd

        rows = {}
        means = self.solution._column_means
        for header, (least, largest) in self.solution._column_ranges.items():
            sizes = means[header], 0.5 * (largest - least), least, largest
            rows[header] = (*sizes, Header.of(header).unit)
        names = ["mean", "half range", "least", "largest", "unit"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=names)


def run_warnings(solution: Solution, includes_rows: bool = True) -> tuple[str, ...]:
    """Return the warnings of a run over one period.

    Parameters
    ----------
    solution
        The run.
    includes_rows
        False to omit warnings about rows that miss values between them.
    """
    about_rows = {x: f"{x.rpartition('; ')[0]}; {_ROW_REMEDY}" for x in solution.row_warnings}
    sentences = solution.model_warnings
    return tuple(about_rows.get(x, x) for x in sentences if includes_rows or x not in about_rows)


def largest_modulus(multipliers: Array) -> float:
    """Return the largest modulus of the Floquet multipliers, or 0 if the array is empty."""
    return float(np.max(np.abs(multipliers), initial=0.0))


def floquet_multipliers(monodromy: Array) -> Array:
    """Return the eigenvalues of a monodromy matrix, sorted by descending modulus."""
    multipliers = np.linalg.eigvals(monodromy)
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
