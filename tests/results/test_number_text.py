"""Text of many numbers: the shortest decimals that are read back as the same numbers."""

import math

import numpy as np
import pytest

from beamdae.results.storage.number_text import format_rows

RNG = np.random.default_rng(3)
POWERS_OF_TWO = np.array([math.ldexp(1.0, k) for k in range(-1074, 1024)])


def format_with_repr(rows):
    lines = (",".join("" if x != x else repr(x) for x in row) for row in rows.tolist())
    return "".join(f"{line}\n" for line in lines)


@pytest.mark.parametrize(
    "numbers",
    [
        RNG.integers(0, 2**63, 20_000, dtype=np.uint64).view(float),
        RNG.integers(0, 2**20, 2_000, dtype=np.uint64).view(float),  # subnormal
        -RNG.standard_normal(20_000),
        10.0 ** RNG.uniform(-20.0, 20.0, 20_000),
        np.round(1e3 * RNG.standard_normal(5_000), 3),
        RNG.integers(-(2**62), 2**62, 5_000).astype(float),
        np.arange(2_000.0),
        POWERS_OF_TWO,
        np.nextafter(POWERS_OF_TWO, 0.0),
        np.nextafter(POWERS_OF_TWO[:-1], np.inf).repeat(2),
        np.array([float(f"1e{k}") for k in range(-323, 309)]),
        np.linspace(0.0, 2.0, 8_822),
    ],
    ids=str,
)
def test_text_equals_repr(numbers):
    rows = numbers.reshape(-1, 2)
    assert format_rows(rows) == format_with_repr(rows)


@pytest.mark.parametrize("shape", [(401, 27), (2, 5_000), (7_000, 1), (0, 3)])
def test_rows_are_formatted_in_blocks(shape):
    rows = RNG.standard_normal(shape)
    assert format_rows(rows) == format_with_repr(rows)


@pytest.mark.parametrize("copies", [1, 100])  # few numbers are formatted by repr
def test_special_numbers(copies):
    special = [0.0, -0.0, math.nan, math.inf, -math.inf, 5e-324, 1.7976931348623157e308]
    limits = [1e16, 9999999999999998.0, 1e-4, 9.999e-5, -1e-5, 1e22, 2e23, 9007199254740993.0, 1.5]
    rows = np.array([special + limits] * copies)
    assert format_rows(rows) == format_with_repr(rows)
    assert format_rows(rows).startswith("0.0,-0.0,,inf,-inf,5e-324,1.7976931348623157e+308,1e+16,")


def test_a_table_without_rows_is_empty():
    assert format_rows(np.zeros((0, 3))) == ""
