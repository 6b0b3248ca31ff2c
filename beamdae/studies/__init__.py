"""Studies: many runs in parallel, kept on disk, and measured against what two methods agree on.

May import: report, simulation and everything below.
Next: a column of the case table in `tables`, a place where runs are done in `pool`.
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
