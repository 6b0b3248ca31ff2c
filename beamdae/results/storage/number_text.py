"""Shortest decimal text of many floating-point numbers, by NumPy operations on all of them.

The text of a number is that of `repr`: the shortest decimal that is read back as the same number
and, of several, the closest. The digits are found by Schubfach (R. Giulietti, The Schubfach way to
render doubles, 2020, https://fmt.dev/papers/Schubfach4.pdf), which needs only integers of 128 bits.
"""

from __future__ import annotations

from functools import cache

import numpy as np

Array = np.ndarray

# For fewer numbers, `repr` is faster than a sequence of NumPy operations.
_MIN_VECTORIZED = 500
_SIGNIFICAND_BITS = 52
_EXPONENT_BIAS = 1075  # of significands that are integers
_HIDDEN_BIT = np.uint64(1 << _SIGNIFICAND_BITS)
_LOW_HALF = np.uint64(0xFFFFFFFF)
_HALF_BITS = np.uint64(32)
# Range of exponents of the powers of ten by which doubles are multiplied.
_SMALLEST_POWER, _LARGEST_POWER = -292, 324
_POWER_BITS = 128
_MAX_DIGITS = 17
# `repr` uses an exponent for numbers below 1e-4 and from 1e16 on.
_MIN_POINT, _MAX_POINT = -3, 16
_NO_POINT = 18
_LARGEST_EXPONENT = 324

# Numbers formatted together, so that their data stay in the processor cache.
_BLOCK_NUMBERS = 3000
# Columns of the text of a number. Unused characters are null and removed at the end.
_SIGN = 0
_LEADING_ZEROS = slice(1, 6)  # "0.000"
_DIGITS = slice(6, 24)  # with a point
_EXPONENT = slice(24, 29)  # "e-308"
_SEPARATOR = 29
_WIDTH = 30


def format_rows(rows: Array) -> str:
    """Return rows of numbers (k, columns) as lines of comma-separated values.

    Numbers have the text of `repr`; NaN is empty.
    """
    if rows.size < _MIN_VECTORIZED:
        lines = (",".join(map(repr, row)) for row in rows.tolist())
        return "".join(f"{line}\n" for line in lines).replace("nan", "")
    count = max(_BLOCK_NUMBERS // rows.shape[1], 1)
    return "".join(_format_block(rows[k : k + count]) for k in range(0, len(rows), count))


def _format_block(rows: Array) -> str:
    text = _format_numbers(np.ascontiguousarray(rows, float).ravel())
    separators = text[:, _SEPARATOR].reshape(rows.shape)
    separators[:] = ord(",")
    separators[:, -1] = ord("\n")
    return text.tobytes().translate(None, b"\0").decode("ascii")


def _format_numbers(numbers: Array) -> Array:
    """Return the characters of each number, (k, _WIDTH), padded with null characters."""
    is_finite = np.isfinite(numbers)
    significand, exponent = _find_shortest(np.where(is_finite, np.abs(numbers), 0.0))
    count = np.searchsorted(_powers_of_ten(), significand, side="right")
    count = np.maximum(count, 1)
    # All significands get 17 digits; the last ones are zeros.
    significand = significand * _powers_of_ten()[_MAX_DIGITS - count]
    digits = np.zeros((len(numbers), _WIDTH), np.uint8)
    four_digits = _four_digit_texts()
    for first in range(_DIGITS.start + _MAX_DIGITS - 4, _DIGITS.start, -4):
        significand, group = np.divmod(significand, np.uint64(10_000))
        digits[:, first : first + 4] = four_digits.take(group.astype(np.intp), axis=0)
    digits[:, _DIGITS.start] = significand.astype(np.uint8) + np.uint8(ord("0"))
    point = count + exponent
    has_exponent = (point < _MIN_POINT) | (point > _MAX_POINT)
    is_small = ~has_exponent & (point <= 0)
    is_plain = ~(has_exponent | is_small)
    # A plain number has at least one digit after the point.
    end = np.where(is_plain, np.maximum(count, point + 1), count)
    shown_point = np.where(has_exponent & (count > 1), 1, np.where(is_plain, point, _NO_POINT))
    # Products with whole rows of masks, because assignments to masks take ten times as long.
    is_before, points, is_from = _point_masks()
    digits *= is_before.take(end, axis=0)
    text = digits * is_before.take(shown_point, axis=0)
    text += points.take(shown_point, axis=0)
    digits *= is_from.take(shown_point, axis=0)
    # Digits after the point move by one column; the last column of a row is empty.
    text.reshape(-1)[1:] += digits.reshape(-1)[:-1]
    text[:, _SIGN] = np.signbit(numbers) * np.uint8(ord("-"))
    (small,) = np.nonzero(is_small)
    zeros = np.frombuffer(b"0.000", np.uint8)
    text[small, _LEADING_ZEROS] = zeros * (np.arange(len(zeros)) < 2 - point[small, None])
    (scientific,) = np.nonzero(has_exponent)
    text[scientific, _EXPONENT] = _exponent_texts()[point[scientific] - 1 + _LARGEST_EXPONENT]
    for k in np.flatnonzero(~is_finite):
        name = b"" if np.isnan(numbers[k]) else repr(float(numbers[k])).encode()
        text[k] = 0
        text[k, : len(name)] = np.frombuffer(name, np.uint8)
    return text


def _find_shortest(numbers: Array) -> tuple[Array, Array]:
    """Return the significands (uint64) and exponents of the shortest decimals of numbers >= 0."""
    bits = numbers.view(np.uint64)
    stored, biased = bits & (_HIDDEN_BIT - np.uint64(1)), bits >> np.uint64(_SIGNIFICAND_BITS)
    is_normal = biased > 0
    c = np.where(is_normal, stored | _HIDDEN_BIT, stored)
    q = np.maximum(biased, np.uint64(1)).astype(np.int64) - _EXPONENT_BIAS
    is_odd = c & np.uint64(1)
    is_lower_closer = (stored == 0) & (biased > 1)
    # Floor of log10(2^q), or of log10(3/4 2^q) if the lower neighbor is closer.
    k = (q * 1262611 - np.where(is_lower_closer, 524031, 0)) >> 22
    h = (q + ((-k * 1741647) >> 19) + 1).astype(np.uint64)
    power = -k - _SMALLEST_POWER
    high, low = (x[power] for x in _power_table())
    center = c << np.uint64(2)
    lower_bound = _multiply_to_odd(high, low, (center - np.uint64(2) + is_lower_closer) << h)
    value = _multiply_to_odd(high, low, center << h)
    upper_bound = _multiply_to_odd(high, low, (center + np.uint64(2)) << h)
    # Significands at the bounds are read as the number only if its significand is even.
    lower_bound, upper_bound = lower_bound + is_odd, upper_bound - is_odd
    s = value >> np.uint64(2)
    shorter = s // np.uint64(10)
    shorter_value = shorter * np.uint64(40)
    is_below_inside = lower_bound <= shorter_value
    is_above_inside = shorter_value + np.uint64(40) <= upper_bound
    is_shorter = (is_below_inside != is_above_inside) & (s >= 10)
    s_value = value & ~np.uint64(3)
    is_s_inside = lower_bound <= s_value
    is_next_inside = s_value + np.uint64(4) <= upper_bound
    middle = s_value + np.uint64(2)
    rounds_up = (value > middle) | ((value == middle) & ((s & np.uint64(1)) == 1))
    rounds_up = np.where(is_s_inside != is_next_inside, is_next_inside, rounds_up)
    significand = np.where(is_shorter, shorter + is_above_inside, s + rounds_up)
    exponent = k + is_shorter
    is_zero = numbers == 0.0
    significand[is_zero], exponent[is_zero] = 0, 0
    return _remove_trailing_zeros(significand, exponent)


def _remove_trailing_zeros(significand: Array, exponent: Array) -> tuple[Array, Array]:
    (k,) = np.nonzero((significand % np.uint64(10) == 0) & (significand > 0))
    shortened = significand[k]
    removed = np.zeros(len(k), np.int64)
    for zeros in (8, 4, 2, 1):
        quotient, rest = np.divmod(shortened, np.uint64(10**zeros))
        shortened = np.where(rest == 0, quotient, shortened)
        removed += zeros * (rest == 0)
    significand[k] = shortened
    exponent[k] += removed
    return significand, exponent


def _multiply_to_odd(high: Array, low: Array, factor: Array) -> Array:
    """Return (2^64 high + low) factor / 2^128, rounded down to an integer, or up if it is even.

    Rounding to odd keeps the information whether the product lies above an integer.
    """
    carry = _multiply(low, factor)[0]
    upper, lower = _multiply(high, factor)
    lower = lower + carry
    return (upper + (lower < carry)) | (lower > 1)


def _multiply(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the upper and lower 64 bits of a b."""
    a_low, a_high = a & _LOW_HALF, a >> _HALF_BITS
    b_low, b_high = b & _LOW_HALF, b >> _HALF_BITS
    low, mixed, other = a_low * b_low, a_low * b_high, a_high * b_low
    middle = (low >> _HALF_BITS) + (mixed & _LOW_HALF) + (other & _LOW_HALF)
    upper = a_high * b_high + (mixed >> _HALF_BITS) + (other >> _HALF_BITS) + (middle >> _HALF_BITS)
    return upper, (middle << _HALF_BITS) | (low & _LOW_HALF)


@cache
def _power_table() -> tuple[Array, Array]:
    """Return the upper and lower 64 bits of powers of ten, scaled to 128 bits and rounded up."""
    powers = []
    for k in range(_SMALLEST_POWER, _LARGEST_POWER + 1):
        numerator, denominator = 10 ** max(k, 0), 10 ** max(-k, 0)
        shift = _POWER_BITS + denominator.bit_length() - numerator.bit_length()
        shift -= (numerator << max(shift, 0)) // (denominator << max(-shift, 0)) >> _POWER_BITS
        scaled = numerator << max(shift, 0), denominator << max(-shift, 0)
        power = -(-scaled[0] // scaled[1])
        powers.append(power << 1 if power.bit_length() < _POWER_BITS else power)
    mask = (1 << 64) - 1
    return np.array([x >> 64 for x in powers], np.uint64), np.array(
        [x & mask for x in powers], np.uint64
    )


@cache
def _powers_of_ten() -> Array:
    return np.array([10**k for k in range(_MAX_DIGITS + 1)], np.uint64)


@cache
def _point_masks() -> tuple[Array, Array, Array]:
    """Return masks of the columns before a position among the digits, at it, and from it on.

    Row k is for position k; in the second table, the columns contain points instead of ones.
    """
    position = np.arange(_NO_POINT + 1)[:, None]
    column = np.arange(_WIDTH) - _DIGITS.start
    is_digit = (column >= 0) & (column <= _MAX_DIGITS)
    is_point = (column == position) & (position < _NO_POINT)
    return (
        (is_digit & (column < position)).astype(np.uint8),
        is_point * np.uint8(ord(".")),
        (is_digit & (column >= position)).astype(np.uint8),
    )


@cache
def _four_digit_texts() -> Array:
    text = "".join(f"{k:04d}" for k in range(10_000))
    return np.frombuffer(text.encode(), np.uint8).reshape(-1, 4)


@cache
def _exponent_texts() -> Array:
    """Return the texts of the exponents from -324 to 324, padded with null characters."""
    exponents = range(-_LARGEST_EXPONENT, _LARGEST_EXPONENT + 1)
    text = b"".join(f"e{k:+03d}".encode().ljust(5, b"\0") for k in exponents)
    return np.frombuffer(text, np.uint8).reshape(-1, 5)
