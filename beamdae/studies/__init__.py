"""Studies and sweeps: many runs in parallel, stored results, errors against references.

May import: report, simulation and everything below.
To extend: add a column of the case table to `run_values`, a figure to `study_page`, or an
executor to `executors`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from beamdae.studies.case import Case, default_integrators, grid
    from beamdae.studies.comparison import compare
    from beamdae.studies.definition import Study, study
    from beamdae.studies.sweeps.sweep import Sweep, sweep
    from beamdae.studies.sweeps.sweep_results import SweepResults

__all__ = [
    "Case",
    "Study",
    "Sweep",
    "SweepResults",
    "compare",
    "default_integrators",
    "grid",
    "study",
    "sweep",
]

# Imported on first use, because worker processes need neither tables nor pages.
_MODULES = {
    "Case": "case",
    "Study": "definition",
    "Sweep": "sweeps.sweep",
    "SweepResults": "sweeps.sweep_results",
    "compare": "comparison",
    "default_integrators": "case",
    "grid": "case",
    "study": "definition",
    "sweep": "sweeps.sweep",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
