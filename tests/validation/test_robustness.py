"""Some of every kind of validation/robustness: each ends as it says there is right."""

from functools import cache

import pytest
from robustness import faults, inputs, mechanisms
from robustness.workers import Processes

SEED = 1
GROUPS = (*sorted({inputs.public_name(base) for base in inputs.BASES}), *inputs.SITUATIONS)


@cache
def chosen():
    known = inputs.all_inputs()
    return [known[name] for name in inputs.thinned(known, SEED)]


pytestmark = pytest.mark.slow(reason="thousands of short runs, and real commands")


@pytest.fixture(scope="module")
def processes():
    with Processes(1) as running:
        yield running


def test_no_group_of_inputs_is_left_out():
    assert {one.group for one in chosen()} == set(GROUPS)


@pytest.mark.parametrize("group", GROUPS)
def test_bad_inputs_end_in_a_sentence(processes, group):
    names = [one.name for one in chosen() if one.group == group and not one.hopeless]
    assert names
    wrong = {}
    for name, found in processes.tried(inputs.see_by_name, names, inputs.LIMIT):
        if found is None or found is ...:
            wrong[name] = "it crashed" if found is None else "it hung"
        elif found[1]:
            wrong[name] = f"{found[1]}: {found[0].text[:200]}"
    assert not wrong, "\n".join(f"{name}: {why}" for name, why in wrong.items())


@pytest.mark.parametrize("seed", range(0, mechanisms.COUNT, mechanisms.COUNT // mechanisms.THINNED))
def test_random_mechanisms_agree_or_tell(seed):
    wrong = [line for line in mechanisms.see_seed(str(seed)) if line.complaint]
    assert not wrong


@pytest.mark.parametrize("name", list(faults.all_faults(slow=False)))
def test_faults_end_as_is_right(name):
    line = faults.see_fault(name)
    if line.ended.startswith("skipped"):
        pytest.skip(line.ended)
    assert line.ended == "right", f"{line.complaint}; right: {line.right}"
