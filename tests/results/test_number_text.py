"""Text of many numbers: the shortest decimals that are read back as the same numbers."""

import math
from decimal import Decimal

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from beamdae.results.storage.files import format_rows

RNG = np.random.default_rng(3)
POWERS_OF_TWO = np.array([math.ldexp(1.0, k) for k in range(-1074, 1024)])


def read(text):
    rows = [line.split(",") for line in text.splitlines()]
    return np.array([[float(x or "nan") for x in row] for row in rows])


@pytest.mark.parametrize(
    "numbers",
    [
        RNG.integers(0, 2**63, 20_000, dtype=np.uint64).view(float),
        RNG.integers(0, 2**20, 2_000, dtype=np.uint64).view(float),  # subnormal
        -RNG.standard_normal(20_000),
        10.0 ** RNG.uniform(-20.0, 20.0, 20_000),
        RNG.integers(-(2**62), 2**62, 5_000).astype(float),
        POWERS_OF_TWO,
        np.nextafter(POWERS_OF_TWO, 0.0),
        np.array([float(f"1e{k}") for k in range(-323, 309)]),
    ],
    ids=str,
)
def test_numbers_are_read_back_from_as_many_digits_as_repr(numbers):
    rows = numbers.reshape(-1, 2)
    text = format_rows(rows)
    assert_array_equal(read(text), rows)
    finite = rows[np.isfinite(rows).all(axis=1)][:200]
    for number, word in zip(
        finite.ravel(), format_rows(finite).replace(",", "\n").split(), strict=True
    ):
        digits, expected = (
            Decimal(x).normalize().as_tuple().digits for x in (word, repr(float(number)))
        )
        assert digits == expected


@pytest.mark.parametrize("shape", [(401, 27), (2, 5_000), (7_000, 1), (1, 1)])
def test_rows_are_lines(shape):
    rows = RNG.standard_normal(shape)
    assert_array_equal(read(format_rows(rows)), rows)
    # Columns of a table are not contiguous.
    assert format_rows(np.asfortranarray(rows)) == format_rows(rows)


@pytest.mark.parametrize("infinity", [[], [math.inf, -math.inf]])
def test_special_numbers(infinity):
    rows = np.array([[0.0, -0.0, math.nan, 5e-324, 1.7976931348623157e308, *infinity]])
    text = format_rows(rows)
    assert text.startswith("0.0,-0.0,,5e-324,1.7976931348623157e+308")
    assert_array_equal(read(text), rows)


def test_a_table_without_rows_is_empty():
    assert format_rows(np.zeros((0, 3))) == ""
