"""All cases of critical loads."""

from benchmarks.critical_loads.arches import ARCH_CASES, BENT_FRAME_CASES, SHALLOW_CASES
from benchmarks.critical_loads.columns import COLUMN_CASES, FRAME_CASES
from benchmarks.critical_loads.discrete import DISCRETE_CASES
from benchmarks.critical_loads.rings import RING_CASES
from benchmarks.critical_loads.straight_columns import (
    FOLLOWER_CASES,
    TAPERED_CASES,
    WEIGHT_CASES,
)

CASES = (
    *DISCRETE_CASES,
    *COLUMN_CASES,
    *FRAME_CASES,
    *WEIGHT_CASES,
    *TAPERED_CASES,
    *FOLLOWER_CASES,
    *RING_CASES,
    *ARCH_CASES,
    *SHALLOW_CASES,
    *BENT_FRAME_CASES,
)
