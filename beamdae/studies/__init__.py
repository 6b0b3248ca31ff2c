"""Studies: many cases in parallel, stored on disk, measured against references of two methods.

May import: checks, report, verification, simulation and everything below.
Next: a column of the case table in `run_values`, a figure in `study_pictures`, an executor in
`execution`.
"""

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
