"""The recipe of a loop contains everything that its machine code depends on."""

import os
import subprocess
import sys

import numpy as np
import pytest
from beamdae.native.loops import _iterate_code

FACTOR, SHIFT = 2.0, 1.0 + 2.0j
WEIGHTS = np.array([[1.0, 2.0], [3.0, 0.1]])


def scale(work):
    return FACTOR * work.x


def shift(work):
    return scale(work) + SHIFT.real + WEIGHTS[0, 1]


def recipe():
    return "\n".join(_iterate_code(shift, {}))


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("FACTOR", np.nextafter(2.0, 3.0)),
        ("SHIFT", 1.0 + 3.0j),
        ("WEIGHTS", np.nextafter(WEIGHTS, 9.0)),
        ("WEIGHTS", WEIGHTS.ravel()),
        ("WEIGHTS", WEIGHTS.astype(np.float32)),
    ],
)
def test_constants_of_called_functions_are_part_of_the_recipe(name, other, monkeypatch):
    before = recipe()
    assert recipe() == before
    monkeypatch.setitem(globals(), name, other)
    assert recipe() != before


def test_all_entries_of_large_arrays_are_part_of_the_recipe(monkeypatch):
    monkeypatch.setitem(globals(), "WEIGHTS", np.zeros((100, 100)))
    before = recipe()
    WEIGHTS[50, 50] = 1e-300
    assert recipe() != before


PROGRAM = """
import hashlib
from beamdae.analysis.periodic.variational_loop import propagate_disturbances
from beamdae.integrators.alpha.step_loop import take_adaptive_steps, take_fixed_steps
from beamdae.integrators.radau.step_loop import take_radau_steps
from beamdae.native.loops import _iterate_code
loops = (take_radau_steps, take_fixed_steps, take_adaptive_steps, propagate_disturbances)
text = "".join(line for loop in loops for line in _iterate_code(loop, {}))
print(hashlib.sha256(text.encode()).hexdigest())
"""


@pytest.mark.slow(reason="starts three processes")
def test_constants_do_not_depend_on_the_processor():
    """Machine code that was compiled on another processor is found, see `prebuilt_objects`."""
    other_processors = [{}, {"OPENBLAS_CORETYPE": "Prescott"}, {"OPENBLAS_CORETYPE": "Haswell"}]
    recipes = {
        subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env={**os.environ, **processor},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for processor in other_processors
    }
    assert len(recipes) == 1
