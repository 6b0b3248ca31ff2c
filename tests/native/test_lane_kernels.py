"""Lane kernels agree with CasADi's virtual machine to the last bit."""

import itertools
import math
import threading

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from beamdae.beams.floating_frame import FloatingFrameElement
from beamdae.native.lane_code import is_supported, write_lane_module
from beamdae.native.lane_kernels import LANE_WIDTH, build_lane_kernel, pad_copies

SX = ca.SX

UNARY = [
    *(ca.OP_NEG, ca.OP_EXP, ca.OP_LOG, ca.OP_SQRT, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV),
    *(ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN),
    *(ca.OP_SINH, ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ACOSH, ca.OP_ATANH),
    *(ca.OP_NOT, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FABS, ca.OP_SIGN, ca.OP_ERF),
    *(ca.OP_EXPM1, ca.OP_LOG1P),
]
BINARY = [
    *(ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_POW, ca.OP_ATAN2, ca.OP_HYPOT),
    *(ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO),
    *(ca.OP_FMIN, ca.OP_FMAX, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN),
]
POWERS = (3.0, -1.5, 0.3)
SPECIAL = [
    *(0.0, 1.0, 2.0, 0.5, 0.3, 3.7, 1e-3, 22.0, 700.0, 1e17, 1e200, math.inf),
    *(5e-324, 1e-310, 2.2250738585072014e-308, 1.7976931348623157e308, 1.0000000000000002),
]
VALUES = np.array([*SPECIAL, *(-x for x in SPECIAL), math.nan])
EVERYTHING = st.floats(width=64)


@pytest.fixture(autouse=True, scope="module")
def machine_code(tmp_path_factory):
    """Switch machine code on, with a separate cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("BEAMDAE_NATIVE", raising=False)
        yield


def evaluate_by_virtual_machine(function, shared, local):
    mapped = function.map(local.shape[1])
    return mapped(np.tile(np.c_[shared], local.shape[1]), local).full()


def assert_same_bits(values, expected, unsigned=False):
    """Compare bits, except sign and payload of NaN and the sign of a remainder that is zero.

    The virtual machine may compute remainders by a special instruction.
    """
    values, expected = (np.where(np.isnan(x), np.nan, x) for x in (values, expected))
    values, expected = (
        np.where(np.reshape(unsigned, (-1, 1)), x + 0.0, x) for x in (values, expected)
    )
    assert_array_equal(values.view(np.int64), expected.view(np.int64))


def assert_same(function, kernel, shared, local):
    shared, local = np.array(shared, dtype=float), np.array(local, dtype=float)
    values, expected = kernel(shared, local), evaluate_by_virtual_machine(function, shared, local)
    assert_same_bits(values, expected, is_remainder(function))


def is_remainder(function):
    """Return a mask of the outputs that are remainders."""
    mask, last = np.zeros(function.numel_out(0), bool), {}
    for k in range(function.n_instructions()):
        operation, results = function.instruction_id(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            mask[results[1]] = last.get(function.instruction_input(k)[0]) == ca.OP_REMAINDER
        else:
            last[results[0]] = operation
    return mask


def operations_of(function):
    return [function.instruction_id(k) for k in range(function.n_instructions())]


def build_all_operations():
    """Each operation on numbers of a copy, on shared numbers, and on one of each."""
    s, x = SX.sym("s", 2), SX.sym("x", 2)
    outputs = []
    for a, b in itertools.product((x[0], s[0]), (x[1], s[1])):
        outputs += [SX.binary(operation, a, b) for operation in BINARY]
    for a in (x[0], s[0]):
        outputs += [SX.unary(operation, a) for operation in UNARY]
        outputs += [a**power for power in POWERS]
    return ca.Function("all_operations", [s, x], [ca.vertcat(*outputs, x[1], s[0], 7.0)])


@pytest.fixture(scope="module")
def all_operations():
    function = build_all_operations()
    return function, build_lane_kernel(function)


def test_all_supported_operations_are_tested(all_operations):
    tested = set(operations_of(all_operations[0]))
    operations = [getattr(ca, name) for name in dir(ca) if name.startswith("OP_")]
    assert {operation for operation in operations if is_supported(operation)} <= tested
    assert {*UNARY, *BINARY, ca.OP_CONSTPOW, ca.OP_CONST} <= tested


@pytest.mark.slow(reason="all pairs of values in all operations")
def test_operations_have_the_same_bits_at_special_values(all_operations):
    pairs = np.array(list(itertools.product(VALUES, VALUES))).T
    pairs = np.c_[pairs, np.zeros((2, pad_copies(pairs.shape[1]) - pairs.shape[1]))]
    for first, second in itertools.product(VALUES, (0.3, -0.0, math.nan)):
        assert_same(*all_operations, [first, second], pairs)
    for second in VALUES:
        assert_same(*all_operations, [0.3, second], pairs)


@pytest.mark.parametrize("repeated", [2, 3, LANE_WIDTH])
def test_lanes_with_equal_numbers_have_equal_results(all_operations, repeated):
    numbers = np.repeat([0.0, -0.0, 0.3, math.nan, 2.0, -2.0, math.inf, 1e-310], repeated)
    local = np.stack([numbers, np.roll(numbers, 1)])
    assert_same(*all_operations, [0.3, -0.0], local)


@pytest.mark.slow(reason="thousands of values in all operations")
@settings(max_examples=300)
@given(st.lists(EVERYTHING, min_size=2 * LANE_WIDTH + 2, max_size=2 * LANE_WIDTH + 2))
def test_operations_have_the_same_bits_at_random_values(all_operations, numbers):
    assert_same(*all_operations, numbers[:2], np.reshape(numbers[2:], (2, LANE_WIDTH)))


@st.composite
def expressions(draw):
    """A function that applies a few operations to results of others."""
    s, x = SX.sym("s", 2), SX.sym("x", 3)
    terms = [*ca.vertsplit(s), *ca.vertsplit(x), SX(draw(EVERYTHING))]
    for _ in range(draw(st.integers(1, 30))):
        a, b = (draw(st.sampled_from(terms)) for _ in range(2))
        if draw(st.booleans()):
            terms.append(SX.unary(draw(st.sampled_from(UNARY)), a))
        else:
            operation = draw(st.sampled_from(BINARY))
            if operation == ca.OP_COPYSIGN:
                # The sign of a computed NaN is not defined.
                b = draw(st.sampled_from(terms[:5]))
            terms.append(SX.binary(operation, a, b))
    return ca.Function("random", [s, x], [ca.densify(ca.vertcat(*terms[-8:]))])


@pytest.mark.slow(reason="half a second and more")
@settings(max_examples=40)
@given(expressions(), st.integers(0, 2**32 - 1))
def test_nested_operations_have_the_same_bits(function, seed):
    kernel = build_lane_kernel(function)
    random = np.random.default_rng(seed)
    local = random.normal(0.0, 2.0, (3, 2 * LANE_WIDTH))
    local[:, LANE_WIDTH:] = random.choice(VALUES, (3, LANE_WIDTH))
    assert_same(function, kernel, random.choice(VALUES, 2), local)


@pytest.mark.parametrize("copies", [8, 24, 256])
def test_element_force_has_the_same_bits(copies):
    kind = FloatingFrameElement(strain="green")
    kernel = kind.kernel()
    x = kernel.local
    inputs = ca.vertcat(x.q, x.v, x.a, x.data)
    function = ca.Function("force_of_test", [x.time, inputs], [ca.densify(kernel.force)])
    local = np.random.default_rng(0).normal(size=(inputs.shape[0], copies))
    assert_same(function, build_lane_kernel(function), [0.1, 0.2], local)


# Arguments and results.


def small(name="small"):
    s, x = SX.sym("s", 2), SX.sym("x", 3)
    return ca.Function(name, [s, x], [ca.vertcat(s[0] * ca.sin(x[0]), x[1] - x[2])])


@pytest.mark.parametrize("n_shared", [0, 2])
@pytest.mark.parametrize("n_local", [0, 3])
def test_either_input_may_be_empty(n_shared, n_local):
    s, x = SX.sym("s", n_shared), SX.sym("x", n_local)
    local_sum = ca.densify(ca.sum1(ca.exp(x)))
    function = ca.Function("empty", [s, x], [ca.vertcat(ca.sum1(s) + 2.0, local_sum)])
    kernel = build_lane_kernel(function)
    local = np.linspace(0.0, 1.0, n_local * LANE_WIDTH).reshape(n_local, LANE_WIDTH)
    values = kernel(np.ones(n_shared), local)
    assert_array_equal(values[0], np.full(LANE_WIDTH, n_shared + 2.0))
    for copy in range(LANE_WIDTH):
        assert_array_equal(
            values[:, copy], function(np.ones(n_shared), local[:, copy]).full()[:, 0]
        )


def test_zero_copies_give_an_empty_result():
    assert build_lane_kernel(small())(np.ones(2), np.ones((3, 0))).shape == (2, 0)


@pytest.mark.parametrize("offset", [0, 1, 3])
def test_unaligned_memory_is_supported_and_nothing_else_is_written(offset):
    kernel = build_lane_kernel(small())
    memory = np.full(2 * 16 + 8, np.nan)
    out = memory[offset : offset + 32].reshape(2, 16)
    source = np.linspace(0.0, 1.0, 3 * 16 + 8)[offset : offset + 48].reshape(3, 16)
    assert kernel(np.ones(2), source, out) is out
    assert_same_bits(out, evaluate_by_virtual_machine(small(), np.ones(2), source))
    assert np.isnan(memory[:offset]).all()
    assert np.isnan(memory[offset + 32 :]).all()


def test_kernels_are_built_in_several_threads():
    functions = [small(f"small_{k}") for k in range(8)]
    results = {}

    def build(function):
        results[function.name()] = build_lane_kernel(function)(np.ones(2), np.ones((3, LANE_WIDTH)))

    threads = [threading.Thread(target=build, args=(function,)) for function in functions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == len(functions)
    for result in results.values():
        assert_same_bits(
            result, evaluate_by_virtual_machine(small(), np.ones(2), np.ones((3, LANE_WIDTH)))
        )


# Unsupported functions.


@pytest.mark.parametrize("operation", [ca.OP_ERFINV, ca.OP_PRINTME])
def test_unsupported_operations_are_reported(operation):
    s, x = SX.sym("s"), SX.sym("x")
    function = ca.Function("without", [s, x], [SX.binary(operation, x, s)])
    assert operation in operations_of(function)
    assert build_lane_kernel(function) is None
    with pytest.raises(
        ValueError, match=r"without: the function has operations that cannot be compiled\."
    ):
        write_lane_module(function)


def test_calls_are_not_compiled():
    s, x = SX.sym("s"), SX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    function = ca.Function("calls", [s, x], [inner(x) + s])
    assert ca.OP_CALL in operations_of(function)
    assert build_lane_kernel(function) is None
