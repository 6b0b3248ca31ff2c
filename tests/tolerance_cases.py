"""The cases of validation/tolerances as parameters of tests."""

import pytest
from tolerances.cases import CASES

# The longest ones; the others tell of the same law in a third of the time.
_SLOW = {"pendulum_undamped", "pendulum_damped", "slider_crank_tangent"}

every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
# The long ones in the slow run alone.
every_case_in_its_time = pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.name in _SLOW else [])
        for case in CASES
    ],
)
