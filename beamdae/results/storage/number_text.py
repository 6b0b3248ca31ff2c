"""Shortest decimal text of many floating-point numbers.

The text of a number is that of `repr`: the shortest decimal that is read back as the same number
and, of several, the closest. In machine code, the digits are found by Schubfach (R. Giulietti, The
Schubfach way to render doubles, 2020, https://fmt.dev/papers/Schubfach4.pdf), which needs only
integers of 128 bits and takes a tenth of the time of `repr`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from beamdae.native.loops import prepare_loop
from beamdae.native.return_codes import DONE

Array = np.ndarray

# For fewer numbers, `repr` takes less time than preparing the loop.
_MIN_COMPILED = 500
# Numbers formatted together, so that their data stay in the processor cache.
_BLOCK_NUMBERS = 4000
_MAX_CHARACTERS = 25  # of a number and the following separator: "-2.2250738585072014e-308,"

# Range of exponents of the powers of ten by which doubles are multiplied.
_SMALLEST_POWER, _LARGEST_POWER = -292, 324
_POWER_BITS = 128
# `repr` uses an exponent for numbers below 1e-4 and from 1e16 on.
_MIN_POINT, _MAX_POINT = -3, 16

# Integers have types here, because numba converts the sum of a signed and an unsigned integer to a
# floating-point number.
_SIGN_BIT = np.uint64(1 << 63)
_HIDDEN_BIT = np.uint64(1 << 52)  # of significands
_INFINITY = np.uint64(0x7FF << 52)
_SIGNIFICAND_BITS = np.uint64(52)
_EXPONENT_BIAS = 1075  # of significands that are integers
_LOW_HALF = np.uint64(0xFFFFFFFF)
_HALF_BITS = np.uint64(32)
_ZERO, _ONE, _TWO, _TEN, _FORTY = (np.uint64(k) for k in (0, 1, 2, 10, 40))
_DIGIT, _POINT, _MINUS, _PLUS, _E = (np.uint64(ord(x)) for x in "0.-+e")
_COMMA, _NEWLINE = np.uint64(ord(",")), np.uint64(ord("\n"))
_I, _N, _F = (np.uint64(ord(x)) for x in "inf")


def format_rows(rows: Array, compiles: bool = True) -> str:
    """Return rows of numbers (k, columns) as lines of comma-separated values.

    Numbers have the text of `repr`; NaN is empty. If `compiles` is False, only machine code in the
    cache is used.
    """
    if rows.size >= _MIN_COMPILED:
        count = max(_BLOCK_NUMBERS // rows.shape[1], 1)
        work, loop = prepare_loop(
            write_rows, lambda _: _create_buffers(count, rows.shape[1]), True, compiles
        )
        if loop is not None:
            blocks = []
            for first in range(0, len(rows), count):
                block = rows[first : first + count]
                work.n_rows = len(block)
                work.numbers.view(float)[: len(block)] = block
                loop()
                blocks.append(work.text[: work.length].tobytes())
            return b"".join(blocks).decode("ascii")
    lines = (",".join(map(repr, row)) for row in rows.tolist())
    return "".join(f"{line}\n" for line in lines).replace("nan", "")


@dataclass(slots=True)
class _TextBuffers:
    """Rows of numbers and their text.

    Attributes
    ----------
    numbers
        Bits of the numbers, (rows, columns).
    powers
        Upper and lower 64 bits of powers of ten, see `_power_table`.
    text
        Characters of the numbers and separators.
    n_rows, length
        Number of rows in use and of characters written.
    """

    numbers: Array
    powers: Array
    text: Array
    n_rows: int = 0
    length: int = 0


def _create_buffers(rows: int, columns: int) -> _TextBuffers:
    text = np.zeros(_MAX_CHARACTERS * rows * columns, np.uint8)
    return _TextBuffers(np.zeros((rows, columns), np.uint64), _power_table(), text)


def write_rows(work: _TextBuffers) -> int:
    """Write the text of the rows in use and return DONE."""
    text, end = work.text, 0
    columns = work.numbers.shape[1]
    for i in range(work.n_rows):
        for j in range(columns):
            end = _write_number(text, end, work.numbers[i, j], work.powers)
            text[end] = _COMMA if j + 1 < columns else _NEWLINE
            end += 1
    work.length = end
    return DONE


def _write_number(text: Array, start: int, bits: np.uint64, powers: Array) -> int:
    """Write the text of a number, given by its bits, and return the end of the text."""
    magnitude = bits & ~_SIGN_BIT
    if magnitude > _INFINITY:
        return start
    if magnitude != bits:
        text[start] = _MINUS
        start += 1
    if magnitude == _INFINITY:
        text[start], text[start + 1], text[start + 2] = _I, _N, _F
        return start + 3
    significand, exponent = _find_shortest(magnitude, powers)
    count, limit = 1, _TEN
    while significand >= limit:
        count += 1
        limit *= _TEN
    point = count + exponent
    if point < _MIN_POINT or point > _MAX_POINT:
        return _write_with_exponent(text, start, significand, count, point - 1)
    if point <= 0:
        first = start + 2 - point
        _write_digits(text, start, first, _ZERO)
        text[start + 1] = _POINT
        _write_digits(text, first, first + count, significand)
        return first + count
    # At least one digit follows the point.
    for _ in range(count, point + 1):
        significand *= _TEN
        count += 1
    whole = _write_digits(text, start + point + 1, start + count + 1, significand)
    text[start + point] = _POINT
    _write_digits(text, start, start + point, whole)
    return start + count + 1


def _write_with_exponent(
    text: Array, start: int, significand: np.uint64, count: int, exponent: int
) -> int:
    end = start + 1
    if count > 1:
        end = start + count + 1
        significand = _write_digits(text, start + 2, end, significand)
        text[start + 1] = _POINT
    text[start] = _DIGIT + significand
    text[end] = _E
    text[end + 1] = _MINUS if exponent < 0 else _PLUS
    size = abs(exponent)
    width = 3 if size >= 100 else 2
    _write_digits(text, end + 2, end + 2 + width, np.uint64(size))
    return end + 2 + width


def _write_digits(text: Array, start: int, end: int, value: np.uint64) -> np.uint64:
    """Write the last digits of an integer to text[start:end] and return the leading digits."""
    for k in range(end - 1, start - 1, -1):
        leading = value // _TEN
        text[k] = _DIGIT + (value - leading * _TEN)
        value = leading
    return value


def _find_shortest(bits: np.uint64, powers: Array) -> tuple[np.uint64, int]:
    """Return the significand and the exponent of the shortest decimal of a number >= 0."""
    if bits == _ZERO:
        return _ZERO, 0
    c, biased = bits & (_HIDDEN_BIT - _ONE), bits >> _SIGNIFICAND_BITS
    is_lower_closer = c == _ZERO and biased > _ONE
    if biased > _ZERO:
        c |= _HIDDEN_BIT
    else:
        biased = _ONE
    q: Any = np.int64(biased) - _EXPONENT_BIAS
    # Floor of log10(2^q), or of log10(3/4 2^q) if the lower neighbor is closer.
    k = (q * 1262611 - (524031 if is_lower_closer else 0)) >> 22
    h = np.uint64(q + ((-k * 1741647) >> 19) + 1)
    high, low = powers[-k - _SMALLEST_POWER, 0], powers[-k - _SMALLEST_POWER, 1]
    center = c << _TWO
    # Significands at the bounds are read as the number only if its significand is even.
    is_odd = c & _ONE
    lower = center - (_ONE if is_lower_closer else _TWO)
    lower_bound = _multiply_to_odd(high, low, lower << h) + is_odd
    value = _multiply_to_odd(high, low, center << h)
    upper_bound = _multiply_to_odd(high, low, (center + _TWO) << h) - is_odd
    s = value >> _TWO
    if s >= _TEN:
        shorter = s // _TEN
        is_below_inside = lower_bound <= shorter * _FORTY
        is_above_inside = (shorter + _ONE) * _FORTY <= upper_bound
        if is_below_inside != is_above_inside:
            return _remove_trailing_zeros(shorter + (_ONE if is_above_inside else _ZERO), k + 1)
    is_s_inside = lower_bound <= s << _TWO
    is_next_inside = (s + _ONE) << _TWO <= upper_bound
    middle = (s << _TWO) + _TWO
    rounds_up = value > middle or (value == middle and s & _ONE == _ONE)
    if is_s_inside != is_next_inside:
        rounds_up = is_next_inside
    return _remove_trailing_zeros(s + (_ONE if rounds_up else _ZERO), k)


def _remove_trailing_zeros(significand: np.uint64, exponent: int) -> tuple[np.uint64, int]:
    leading = significand // _TEN
    while leading * _TEN == significand:
        significand, exponent = leading, exponent + 1
        leading = significand // _TEN
    return significand, exponent


def _multiply_to_odd(high: np.uint64, low: np.uint64, factor: np.uint64) -> np.uint64:
    """Return (2^64 high + low) factor / 2^128, rounded down to an integer, or up if it is even.

    Rounding to odd keeps the information whether the product lies above an integer.
    """
    carry = _multiply_high(low, factor)
    lower = high * factor + carry
    upper = _multiply_high(high, factor)
    if lower < carry:
        upper += _ONE
    return upper | (_ONE if lower > _ONE else _ZERO)


def _multiply_high(a: np.uint64, b: np.uint64) -> np.uint64:
    """Return the upper 64 bits of a b."""
    a_low, a_high = a & _LOW_HALF, a >> _HALF_BITS
    b_low, b_high = b & _LOW_HALF, b >> _HALF_BITS
    mixed, other = a_low * b_high, a_high * b_low
    middle = (a_low * b_low >> _HALF_BITS) + (mixed & _LOW_HALF) + (other & _LOW_HALF)
    return a_high * b_high + (mixed >> _HALF_BITS) + (other >> _HALF_BITS) + (middle >> _HALF_BITS)


@cache
def _power_table() -> Array:
    """Return rows (upper, lower 64 bits) of powers of ten, scaled to 128 bits and rounded up."""
    powers = []
    for k in range(_SMALLEST_POWER, _LARGEST_POWER + 1):
        numerator, denominator = 10 ** max(k, 0), 10 ** max(-k, 0)
        shift = _POWER_BITS + denominator.bit_length() - numerator.bit_length()
        shift -= (numerator << max(shift, 0)) // (denominator << max(-shift, 0)) >> _POWER_BITS
        scaled = numerator << max(shift, 0), denominator << max(-shift, 0)
        power = -(-scaled[0] // scaled[1])
        powers.append(power << 1 if power.bit_length() < _POWER_BITS else power)
    mask = (1 << 64) - 1
    return np.array([(x >> 64, x & mask) for x in powers], np.uint64)
