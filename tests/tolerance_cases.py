"""The cases of validation/tolerances as parameters of tests."""

import pytest
from tolerances.cases import CASES

# All but the shortest one, which tells of the same law in a tenth of the time.
_SLOW = {case.name for case in CASES} - {"hub_beam"}

every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
# The long ones in the slow run alone.
every_case_in_its_time = pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.name in _SLOW else [])
        for case in CASES
    ],
)
