"""Array operations of loops agree in machine code and in numpy."""

import copy
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from beamdae.linear.lane_operations import substitute_backward, substitute_forward
from beamdae.native.loop_functions import (
    accumulate,
    add,
    add_tiles,
    add_weighted,
    combine,
    count_negative_pivots,
    euclidean_norm,
    fill,
    gather,
    inner_product,
    locate_largest,
    max_norm,
    minimum,
    multiply,
    pick,
    pick_tiles,
    rotate,
    scatter,
    scatter_magnitudes,
    split_complex,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from test_loops import compile_without_warnings

from beamdae.linear.fixed_order import FixedOrder, FixedOrderFactors
from beamdae.native import loop_functions
from beamdae.native.object_code import is_native_enabled

pytestmark = pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")

SPECIAL = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, 5e-324])


@dataclass(slots=True)
class Operands:
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    w: np.ndarray
    out: np.ndarray
    at: np.ndarray
    of: np.ndarray
    weights: np.ndarray
    factor: float
    answer: float = 0.0


def combine_one(o):
    combine(o.out, (o.factor,), (o.x,))
    return 0


def combine_two(o):
    combine(o.out, (o.factor, -1.0), (o.x, o.y))
    return 0


def combine_three(o):
    combine(o.out, (o.factor, 2.0, o.answer), (o.x, o.y, o.z))
    return 0


def combine_four(o):
    combine(o.out, (1.0, o.factor, 0.5, -3.0), (o.x, o.y, o.z, o.w))
    return 0


def combine_in_place(o):
    combine(o.x, (1.0, o.factor), (o.x, o.y))
    combine(o.out[: o.at.size], (o.factor,), (o.weights,))
    return 0


def fill_all(o):
    fill(o.out, o.factor)
    fill(o.x[: o.at.size], 0.0)
    return 0


def compute_max_norm(o):
    o.answer = max_norm(o.x, o.y)
    return 0


def compute_euclidean_norm(o):
    o.answer = euclidean_norm(o.x, o.y)
    return 0


def multiply_entries(o):
    multiply(o.out, o.x, o.y)
    multiply(o.x, o.x, o.x)
    return 0


def accumulate_some(o):
    accumulate(o.out, o.of, o.at, o.weights)
    return 0


def locate_largest_entry(o):
    o.answer = float(locate_largest(o.x, o.y)) if o.x.size > 0 else 0.0
    return 0


def compute_minimum(o):
    minimum(o.out, o.x, o.factor, o.y)
    return 0


def pick_some(o):
    pick(o.out, o.at, o.x, o.of, o.of.size // 4, o.of.size)
    return 0


def gather_some(o):
    gather(o.out, o.of, o.weights, o.x, o.at, o.of.size // 4, o.of.size)
    return 0


def add_some(o):
    add(o.out, o.of, o.x, o.at, o.of.size // 4, o.of.size)
    return 0


def add_weighted_some(o):
    add_weighted(o.out, o.of, o.weights, o.x, o.at, o.of.size // 4, o.of.size)
    return 0


def scatter_some(o):
    scatter(o.out, o.of, o.weights, o.x, o.at)
    return 0


def scatter_some_magnitudes(o):
    scatter_magnitudes(o.out, o.of, o.weights, o.x, o.at)
    return 0


def operands(size, count, specials, seed):
    """Random operands, some of them special; `at` has distinct indices, `of` repeats some."""
    random = np.random.default_rng(seed)

    def numbers(length):
        values = random.normal(size=length) * 10.0 ** random.integers(-8, 8, length)
        is_special = random.random(length) < specials
        values[is_special] = random.choice(SPECIAL, length)[is_special]
        return values

    return Operands(
        *(numbers(size) for _ in range(5)),
        at=random.permutation(size)[:count],
        of=random.integers(0, max(size, 1), min(count, size)),
        weights=numbers(min(count, size)),
        factor=float(numbers(1)[0]),
    )


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "function",
    [
        combine_one,
        combine_two,
        combine_three,
        combine_four,
        combine_in_place,
        fill_all,
        compute_max_norm,
        compute_euclidean_norm,
        multiply_entries,
        accumulate_some,
        locate_largest_entry,
        compute_minimum,
        pick_some,
        gather_some,
        add_some,
        add_weighted_some,
        scatter_some,
        scatter_some_magnitudes,
    ],
)
@given(
    size=st.integers(0, 30),
    count=st.integers(0, 30),
    specials=st.sampled_from([0.0, 0.1, 1.0]),
    seed=st.integers(0, 2**32 - 1),
)
@example(size=0, count=0, specials=0.0, seed=0)
@example(size=9, count=0, specials=0.1, seed=0)
@settings(max_examples=50, deadline=None)
def test_compiled_array_operations_agree(function, size, count, specials, seed):
    plain = operands(size, count, specials, seed)
    compiled = copy.deepcopy(plain)
    compile_without_warnings(function, compiled)()
    with np.errstate(all="ignore"):
        function(plain)
    for name in ("x", "y", "z", "w", "out", "at", "of", "weights"):
        assert_array_equal(getattr(compiled, name), getattr(plain, name))
    # BLAS adds in another order.
    rtol = 1e-14 if function is compute_euclidean_norm else 0.0
    assert_allclose(compiled.answer, plain.answer, rtol=rtol, atol=0.0)


@dataclass(slots=True)
class Parts:
    vector: np.ndarray
    real: np.ndarray
    imaginary: np.ndarray


def split_parts(o):
    split_complex(o.real, o.imaginary, o.vector)
    combine(o.vector, (2.0 - 1.0j, 1.0j), (o.vector, o.real))
    return 0


@pytest.mark.parametrize("size", [0, 1, 9])
def test_compiled_complex_operations_agree(size):
    random = np.random.default_rng(size)
    vector = random.normal(size=size) + 1j * random.normal(size=size)
    plain = Parts(vector, np.zeros(size), np.zeros(size))
    compiled = copy.deepcopy(plain)
    compile_without_warnings(split_parts, compiled)()
    split_parts(plain)
    assert_array_equal(compiled.real, plain.real)
    assert_array_equal(compiled.imaginary, plain.imaginary)
    assert_allclose(compiled.vector, plain.vector, rtol=1e-14)


@dataclass(slots=True)
class ComplexOperands:
    vector: np.ndarray
    weights: np.ndarray
    answer: float = 0.0


def compute_complex_norm(o):
    o.answer = max_norm(o.vector, o.weights)
    return 0


@pytest.mark.parametrize("size", [1, 9, 20])
def test_regression_norms_of_complex_vectors(size):
    # Read as real numbers, the first half of the entries gave a norm that was too small, and
    # Newton's iteration of Radau stopped early: an error of 4e-9 became 1e-7.
    vector = np.zeros(size, complex)
    vector[-1] = 3.0 - 4.0j
    operands = ComplexOperands(vector, np.full(size, 2.0))
    compile_without_warnings(compute_complex_norm, operands)()
    assert operands.answer == pytest.approx(10.0, rel=1e-15)


def rotate_and_multiply(o):
    rotate(o.x, o.y, o.z)
    o.answer = inner_product(o.x, o.w)
    return 0


@pytest.mark.parametrize("size", [0, 1, 9, 20])
def test_compiled_rotations_and_inner_products_agree(size):
    plain = operands(size, 0, 0.0, 0)
    for vector in (plain.x, plain.y, plain.z, plain.w):
        vector[:] = np.random.default_rng(1).normal(size=size)
    compiled = copy.deepcopy(plain)
    compile_without_warnings(rotate_and_multiply, compiled)()
    rotate_and_multiply(plain)
    # The C library rounds sines otherwise, and BLAS adds in another order.
    for name in ("x", "y", "answer"):
        assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=1e-13, atol=1e-13)


@dataclass(slots=True)
class TileOperands:
    start: int
    stride: int
    begin: int
    end: int
    tiles: np.ndarray
    vector: np.ndarray
    rows: np.ndarray


def pick_all_tiles(o):
    pick_tiles(o.rows, o.start, o.stride, o.vector, o.tiles, o.begin, o.end)
    return 0


def add_all_tiles(o):
    add_tiles(o.vector, o.rows, o.stride, o.tiles, o.begin, o.end)
    return 0


@pytest.mark.parametrize("function", [pick_all_tiles, add_all_tiles])
@pytest.mark.parametrize("equal_lanes", [False, True])
def test_compiled_tiles_agree(function, equal_lanes):
    random = np.random.default_rng(0)
    count, width, size = 12, 8, 50
    first = random.integers(0, size - 3, (count, width))
    if equal_lanes:
        first[:] = first[:, :1]
    table = np.column_stack([8 * np.arange(count), random.integers(1, 5, count), first])
    plain = TileOperands(
        0, 24, 2, count, table.astype(np.uint32), random.normal(size=size), np.zeros(8 * 25)
    )
    plain.rows[:] = random.normal(size=plain.rows.size)
    compiled = copy.deepcopy(plain)
    compile_without_warnings(function, compiled)()
    function(plain)
    assert_array_equal(compiled.vector, plain.vector)
    assert_array_equal(compiled.rows, plain.rows)


@dataclass(slots=True)
class BlockOperands:
    right: np.ndarray
    at: np.ndarray
    block_x: np.ndarray
    blocks: np.ndarray
    interior: int
    neighbors: int
    shared: int


def substitute_block(o):
    substitute_forward(o.right, o.at, o.block_x, 1, o.blocks, 2, o.interior, o.neighbors, o.shared)
    substitute_backward(o.right, o.at, o.block_x, 1, o.blocks, 2, o.interior, o.neighbors, o.shared)
    return 0


@pytest.mark.parametrize("interior", [2, 3, 6])
@pytest.mark.parametrize(("neighbors", "shared"), [(9, 3), (6, 0), (4, 1)])
@pytest.mark.parametrize("kind", [float, complex])
def test_compiled_substitution_agrees(interior, neighbors, shared, kind):
    random = np.random.default_rng(0)
    size, lanes = interior + neighbors, 8
    unknowns = random.permutation(size * lanes).reshape(size, lanes)
    unknowns[size - shared :] = unknowns[size - shared :, :1]

    def numbers(count):
        values = random.normal(size=count)
        return values if kind is float else values + 1j * random.normal(size=count)

    plain = BlockOperands(
        numbers(size * lanes),
        np.concatenate([np.zeros(lanes, int), unknowns.ravel()]).astype(np.uint32),
        np.zeros((size + 1) * lanes, kind),
        numbers((2 + interior * (size + neighbors)) * lanes),
        interior,
        neighbors,
        shared,
    )
    compiled = copy.deepcopy(plain)
    if kind is complex:
        # In machine code, the real parts of all lanes precede the imaginary parts.
        blocks = plain.blocks.reshape(-1, lanes)
        parts = np.stack([blocks.real, blocks.imag], axis=1)
        compiled.blocks = parts.ravel().view(complex)
    compile_without_warnings(substitute_block, compiled)()
    substitute_block(plain)
    # Complex products of numpy are rounded differently.
    rtol = 0.0 if kind is float else 1e-13
    assert_allclose(compiled.right, plain.right, rtol=rtol, atol=0.1 * rtol)


@dataclass(slots=True)
class SymmetricOperands:
    factors: FixedOrderFactors
    nonzeros: np.ndarray
    negative: int = 0


def count_negative(o):
    o.negative = count_negative_pivots(o.factors, o.nonzeros)
    return 0


@pytest.mark.parametrize("seed", range(3))
def test_compiled_pivots_of_symmetric_matrices_agree(seed):
    random = np.random.default_rng(seed)
    size = 8
    entries = np.where(random.random((size, size)) < 0.3, random.normal(size=(size, size)), 0.0)
    dense = entries + entries.T + np.diag(random.normal(size=size))
    matrix = sp.csc_array(dense)
    plan = FixedOrder.of(matrix, random.permutation(size))
    plain = SymmetricOperands(FixedOrderFactors.of(plan), matrix.data)
    compiled = copy.deepcopy(plain)
    compile_without_warnings(count_negative, compiled)()
    count_negative(plain)
    assert compiled.negative == plain.negative == np.sum(np.linalg.eigvalsh(dense) < 0.0)
    assert_allclose(compiled.factors.pivots, plain.factors.pivots, rtol=1e-9)
    assert compiled.factors.smallest_pivot == pytest.approx(plain.factors.smallest_pivot)


def test_every_overload_is_tested():
    """A new function of `loop_functions` needs a test here or an entry in the list below."""
    public = {
        name
        for name, value in vars(loop_functions).items()
        if getattr(value, "__module__", "") == loop_functions.__name__ and not name.startswith("_")
    }
    elsewhere = {"array_at", "call_for_int", "call_for_pointer"}
    elsewhere |= {"call_kernel", "factorize", "solve", "solve_lanes"}
    assert public - elsewhere <= set(globals())
