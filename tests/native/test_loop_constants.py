"""The recipe of a loop contains everything that its machine code depends on."""

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
