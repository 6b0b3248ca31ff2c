"""A sample of the trials of validation/robustness: each has an accepted outcome."""

from functools import cache

import pytest
from robustness import faults
from robustness.inputs import catalog as input_catalog
from robustness.inputs.bad_input import MODEL_GROUPS

SEED = 1
PUBLIC_NAMES = {input_catalog.public_name_of(key) for key in input_catalog.WORKING_CALLS}
GROUPS = (*sorted(PUBLIC_NAMES), *MODEL_GROUPS)


@cache
def sample():
    inputs = input_catalog.collect_inputs()
    return [inputs[name] for name in input_catalog.sample_inputs(inputs, SEED)]


pytestmark = pytest.mark.slow(reason="thousands of short runs, and real commands")


def test_no_group_of_inputs_is_missing_from_the_sample():
    assert {bad_input.group for bad_input in sample()} == set(GROUPS)


@pytest.mark.parametrize("name", list(faults.list_faults(slow=False)))
def test_faults_have_the_right_outcome(name):
    (complaint,) = faults.try_name(name)
    if complaint is None:
        pytest.skip("not permitted on this machine")
    assert not complaint, f"{complaint}; right: {faults.list_faults()[name].__doc__}"
