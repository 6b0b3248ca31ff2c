"""Result of a search for a periodic motion: one period, stability and amplitudes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import list_first
from beamdae.read_only import read_only_data
from beamdae.results.columns import Header
from beamdae.results.diagnostics.meshes.beam_ranges import MAX_UNREPORTED_ERROR
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_STABILITY_MARGIN = 1e-4  # moduli of the multipliers of stable motions may exceed 1 by this
# Larger errors leave the stability open if they exceed the distance of the largest modulus from 1.
_MAX_MULTIPLIER_ERROR = 1e-2
_MAX_NAMES = 3  # of beams and of columns in a warning
_ROUNDED_PERCENT = 10.0  # larger errors are stated without decimals
# In place of the remedy of warnings about output rows, an option that periodic motions do not have.
_ROW_REMEDY = (
    "amplitudes include the steps between the rows, but curves and the table of the rows do not."
)
_IMAGINARY_ROUNDING = 1e-6  # largest imaginary part / modulus of a real multiplier


@dataclass(frozen=True)
class BeamError:
    """Error of a periodic motion by the strains and elements of beams.

    Attributes
    ----------
    beams
        Names of the beams that more accurate ones replace.
    has_exact_strains, has_fine_mesh
        Whether these have exact strains, and elements of half the length.
    columns
        Relative error of each column by its header, positive if the motion is too large: of the
        half range or of the largest magnitude, whichever is larger. "period [s]" is the period.
        Empty if no motion of the more accurate beams was found.
    """

    beams: tuple[str, ...]
    has_exact_strains: bool
    has_fine_mesh: bool
    columns: Mapping[str, float] = field(default_factory=dict)

    @property
    def size(self) -> float:
        """Largest absolute error; infinite if unknown."""
        return max(map(abs, self.columns.values()), default=np.inf)

    @property
    def warning(self) -> str | None:
        """Warning if the error exceeds 1 %, otherwise None."""
        if self.size <= MAX_UNREPORTED_ERROR:
            return None
        causes = ["strains"] * self.has_exact_strains + ["elements"] * self.has_fine_mesh
        remedies = ["strain='exact'"] * self.has_exact_strains
        remedies += ["twice as many elements"] * self.has_fine_mesh
        beams, remedy = list_first(self.beams, _MAX_NAMES), " and ".join(remedies)
        if not self.columns:
            return (
                f"{beams}: with {remedy}, no periodic motion close to this one was found, so its "
                f"amplitudes are uncertain; use {remedy}."
            )
        largest = sorted(self.columns.items(), key=lambda x: -abs(x[1]))
        errors = [
            f"{_format_percent(error)} of {name.partition(' [')[0]}"
            for name, error in largest
            if abs(error) > MAX_UNREPORTED_ERROR
        ]
        return (
            f"{beams}: errors by the {' and '.join(causes)} are {list_first(errors, _MAX_NAMES)}; "
            f"use {remedy}."
        )


def _format_percent(error: float) -> str:
    percent = 100.0 * error
    return f"{percent:+.0f} %" if abs(percent) >= _ROUNDED_PERCENT else f"{percent:+.2g} %"


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
    warnings
        Warnings of `solution`, and others that the call issued.
    beam_error
        Largest error of a column by the strains and elements of beams, including its amplification
        by resonances. None if there are no columns, or no such beams.
    """

    solution: Solution
    period: float
    multipliers: Array = field(default_factory=lambda: np.zeros(0, complex))
    multiplier_error: float = np.inf
    off: float = np.inf
    iterations: int = 0
    status: Status = field(default=Status("ok", "repeats after one period"))
    warnings: tuple[str, ...] = field(default=(), repr=False)
    beam_error: BeamError | None = None

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
        for header, span in self.solution._column_ranges.items():
            sizes = means[header], span.half_range, span.least, span.largest
            rows[header] = (*sizes, Header.of(header).unit)
        names = ["mean", "half range", "least", "largest", "unit"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=names)


def run_warnings(
    solution: Solution, error: BeamError | None, includes_rows: bool = True
) -> tuple[str, ...]:
    """Return the warnings of a run over one period, without estimates that the error replaces.

    Parameters
    ----------
    solution
        The run.
    error
        Error of the periodic motion by its beams; None if it is not known.
    includes_rows
        False to omit warnings about rows that miss values between them.
    """
    sentences = solution.model_warnings
    replaced: set[str] = set()
    about_rows = {x: f"{x.rpartition('; ')[0]}; {_ROW_REMEDY}" for x in solution.row_warnings}
    if not includes_rows:
        replaced |= set(about_rows)
    return tuple(about_rows.get(x, x) for x in sentences if x not in replaced)


def largest_modulus(multipliers: Array) -> float:
    """Return the largest modulus of the Floquet multipliers, or 0 if the array is empty."""
    return float(np.max(np.abs(multipliers), initial=0.0))


def floquet_multipliers(monodromy: Array) -> Array:
    """Return the eigenvalues of a monodromy matrix, sorted by descending modulus."""
    multipliers = np.linalg.eigvals(monodromy)
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
