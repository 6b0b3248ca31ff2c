"""Certificate of the mesh error of an equilibrium, of natural modes or of a periodic motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.read_only import read_only_data
from beamdae.results.certificate import CertificateStatus, describe_verdicts
from beamdae.results.outcome import Status

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class AnalysisCertificate(CertificateStatus):
    """Result of an analysis with its mesh error.

    See `certify_equilibrium`, `certify_modes` and `certify_periodic`.

    The errors are estimated from the results on the last three meshes; the certificate is not a
    proof. Beams are geometrically exact where possible.

    Attributes
    ----------
    result
        `Equilibrium`, `Modes` or `PeriodicMotion` on the finest mesh.
    columns
        Names of the values.
    values
        Values on the finest mesh (columns,): at the end of the path, frequencies [Hz], or
        amplitudes.
    scales
        Values to which errors are relative (columns,): half the range along the path (for a path of
        one row, the magnitude of the value), the frequency, or the amplitude.
    mesh
        Relative mesh errors (columns,) [-]; NaN if the model has beams but none can be refined, and
        infinite without values on three meshes.
    theory_as_written
        Relative errors (columns,) [-] of the formulations that the model specifies; NaN if they are
        not assessed.
    required
        True for columns that must be within the accuracy, (columns,).
    accuracy
        Required relative accuracy [-].
    status
        "ok" if all required columns are within the accuracy, otherwise "limited" or "failed".
    elements
        Number of elements of each beam in the finest mesh, by name.
    meshes
        Number of meshes.
    notes
        Limits of the certificate.
    """

    result: Any
    columns: tuple[str, ...]
    values: Array
    scales: Array
    mesh: Array
    theory_as_written: Array
    required: Array
    accuracy: float
    status: Status
    elements: dict[str, int] = field(default_factory=dict)
    meshes: int = 0
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Class name of the result: "Equilibrium", "Modes" or "PeriodicMotion"."""
        return type(self.result).__name__

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reason if the accuracy is not reached, and warnings of the result."""
        return (*self._reason, *self.result.warnings)

    @property
    def budget(self) -> pd.DataFrame:
        """Table with value, scale, mesh error, accuracy, verdict and theory error per column."""
        import pandas as pd

        rows = {
            "value": self.values,
            "scale": self.scales,
            "mesh": self.mesh,
            "accuracy": np.full(len(self.mesh), self.accuracy),
            "certified": describe_verdicts(self.mesh, self.accuracy, self.required),
            "theory as written": self.theory_as_written,
        }
        return pd.DataFrame(rows, index=pd.Index(list(self.columns)))

    def facts(self) -> dict[str, str]:
        """Return status, meshes and any notes as strings by name."""
        beams = [f"{name} with {count} elements" for name, count in self.elements.items()]
        rows = {
            "certificate": f"{self.status.kind}: {self.status.sentence}",
            "meshes": "; ".join([f"{self.meshes} meshes", *beams]),
        }
        return rows | ({"notes": " ".join(self.notes)} if self.notes else {})
