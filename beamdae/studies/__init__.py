"""Studies and sweeps: runs of many cases in parallel, stored results, errors against references.

May import: report, simulation and everything below.
To extend: add a column of the case table to `run_values`, a figure to `study_pictures`, or an
executor to `execution`.
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
