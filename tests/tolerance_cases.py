"""The cases of validation/tolerances as parameters of tests."""

import pytest
from tolerances.cases import CASES

# All but the shortest case, which checks the same in a tenth of the time.
_SLOW = {case.name for case in CASES} - {"hub_beam"}

every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
# Long cases are slow tests.
every_case_by_duration = pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.name in _SLOW else [])
        for case in CASES
    ],
)
