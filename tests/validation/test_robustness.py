"""A sample of the trials of validation/robustness: each has an accepted outcome."""

from functools import cache

import pytest
from robustness.faults import catalog as fault_catalog
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


@pytest.mark.parametrize("name", list(fault_catalog.collect_faults(slow=False)))
def test_faults_have_the_right_outcome(name):
    row = fault_catalog.try_fault(name)
    if row.ended.startswith("skipped"):
        pytest.skip(row.ended)
    assert row.ended == "right", f"{row.complaint}; right: {row.right}"
