"""Kernels across elements do what CasADi's virtual machine does, to the last bit."""

import itertools
import math
import pickle
import threading

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from beamdae.beams.floating_frame.element import FloatingFrameElement, floating_frame_kernel
from beamdae.native import lane_code as operations
from beamdae.native.lane_code import write_lane_module
from beamdae.native.lane_kernels import LANE_WIDTH, LaneKernel, build_lane_kernel, pad_copies

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
    """It is wanted, and kept apart."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("BEAMDAE_NATIVE", raising=False)
        yield


def by_virtual_machine(function, shared, local):
    mapped = function.map(local.shape[1])
    return mapped(np.tile(np.c_[shared], local.shape[1]), local).full()


def assert_same_bits(found, expected, unsigned=False):
    """Of a NaN neither sign nor payload counts, of a remainder that is zero the sign does not.

    The virtual machine may have that from an instruction of its own.
    """
    found, expected = (np.where(np.isnan(x), np.nan, x) for x in (found, expected))
    found, expected = (
        np.where(np.reshape(unsigned, (-1, 1)), x + 0.0, x) for x in (found, expected)
    )
    assert_array_equal(found.view(np.int64), expected.view(np.int64))


def assert_same(function, kernel, shared, local):
    shared, local = np.array(shared, dtype=float), np.array(local, dtype=float)
    by_machine, expected = kernel(shared, local), by_virtual_machine(function, shared, local)
    assert_same_bits(by_machine, expected, is_remainder(function))


def is_remainder(function):
    """Of each output, whether it is one."""
    found, last = np.zeros(function.numel_out(0), bool), {}
    for k in range(function.n_instructions()):
        operation, results = function.instruction_id(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            found[results[1]] = last.get(function.instruction_input(k)[0]) == ca.OP_REMAINDER
        else:
            last[results[0]] = operation
    return found


def ids(function):
    return [function.instruction_id(k) for k in range(function.n_instructions())]


def all_operations():
    """Each operation on numbers of a copy, of all copies, and of one and the other."""
    s, x = SX.sym("s", 2), SX.sym("x", 2)
    outputs = []
    for a, b in itertools.product((x[0], s[0]), (x[1], s[1])):
        outputs += [SX.binary(operation, a, b) for operation in BINARY]
    for a in (x[0], s[0]):
        outputs += [SX.unary(operation, a) for operation in UNARY]
        outputs += [a**power for power in POWERS]
    return ca.Function("every", [s, x], [ca.vertcat(*outputs, x[1], s[0], 7.0)])


@pytest.fixture(scope="module")
def every():
    function = all_operations()
    return function, build_lane_kernel(function)


def test_all_operations_that_can_be_compiled_are_tried(every):
    tried = set(ids(every[0]))
    known = [getattr(ca, name) for name in dir(ca) if name.startswith("OP_")]
    assert {operation for operation in known if operations.is_supported(operation)} <= tried
    assert {*UNARY, *BINARY, ca.OP_CONSTPOW, ca.OP_CONST} <= tried


@pytest.mark.slow(reason="all pairs of values in all operations")
def test_every_operation_has_the_same_bits_at_every_pair_of_special_values(every):
    pairs = np.array(list(itertools.product(VALUES, VALUES))).T
    pairs = np.c_[pairs, np.zeros((2, pad_copies(pairs.shape[1]) - pairs.shape[1]))]
    for first, second in itertools.product(VALUES, (0.3, -0.0, math.nan)):
        assert_same(*every, [first, second], pairs)
    for second in VALUES:
        assert_same(*every, [0.3, second], pairs)


@pytest.mark.parametrize("repeated", [2, 3, LANE_WIDTH])
def test_lanes_with_the_numbers_of_the_one_before_have_its_results(every, repeated):
    numbers = np.repeat([0.0, -0.0, 0.3, math.nan, 2.0, -2.0, math.inf, 1e-310], repeated)
    local = np.stack([numbers, np.roll(numbers, 1)])
    assert_same(*every, [0.3, -0.0], local)


@pytest.mark.slow(reason="thousands of values in all operations")
@settings(max_examples=300)
@given(st.lists(EVERYTHING, min_size=2 * LANE_WIDTH + 2, max_size=2 * LANE_WIDTH + 2))
def test_every_operation_has_the_same_bits_anywhere(every, numbers):
    assert_same(*every, numbers[:2], np.reshape(numbers[2:], (2, LANE_WIDTH)))


@st.composite
def expressions(draw):
    """A function of a few operations on each other's results."""
    s, x = SX.sym("s", 2), SX.sym("x", 3)
    terms = [*ca.vertsplit(s), *ca.vertsplit(x), SX(draw(EVERYTHING))]
    for _ in range(draw(st.integers(1, 30))):
        a, b = (draw(st.sampled_from(terms)) for _ in range(2))
        if draw(st.booleans()):
            terms.append(SX.unary(draw(st.sampled_from(UNARY)), a))
        else:
            operation = draw(st.sampled_from(BINARY))
            if operation == ca.OP_COPYSIGN:
                # Of what is computed and no number nobody promises the sign.
                b = draw(st.sampled_from(terms[:5]))
            terms.append(SX.binary(operation, a, b))
    return ca.Function("drawn", [s, x], [ca.densify(ca.vertcat(*terms[-8:]))])


@pytest.mark.slow(reason="half a second and more")
@settings(max_examples=40)
@given(expressions(), st.integers(0, 2**32 - 1))
def test_operations_on_each_other_have_the_same_bits(function, seed):
    kernel = build_lane_kernel(function)
    random = np.random.default_rng(seed)
    local = random.normal(0.0, 2.0, (3, 2 * LANE_WIDTH))
    local[:, LANE_WIDTH:] = random.choice(VALUES, (3, LANE_WIDTH))
    assert_same(function, kernel, random.choice(VALUES, 2), local)


@pytest.mark.parametrize("copies", [8, 24, 256])
def test_the_force_of_an_element_has_the_same_bits(copies):
    kind = FloatingFrameElement(strain="green")
    kernel = floating_frame_kernel(kind)
    x = kernel.local
    own = ca.vertcat(x.q, x.v, x.a, x.data)
    function = ca.Function("force_of_test", [x.time, own], [ca.densify(kernel.force)])
    local = np.random.default_rng(0).normal(size=(own.shape[0], copies))
    assert_same(function, build_lane_kernel(function), [0.1, 0.2], local)


# What is handed in and out.


def small(name="small"):
    s, x = SX.sym("s", 2), SX.sym("x", 3)
    return ca.Function(name, [s, x], [ca.vertcat(s[0] * ca.sin(x[0]), x[1] - x[2])])


def test_a_kernel_tells_its_sizes_and_stays_alive():
    kernel = build_lane_kernel(small())
    assert isinstance(kernel, LaneKernel)
    assert kernel.name == "small"
    assert (kernel.n_shared, kernel.n_local, kernel.n_out) == (2, 3, 2)
    assert kernel.address == kernel.code.addresses["small"] != 0


@pytest.mark.parametrize("shared", [0, 2])
@pytest.mark.parametrize("own", [0, 3])
def test_either_input_may_be_empty(shared, own):
    s, x = SX.sym("s", shared), SX.sym("x", own)
    own_sum = ca.densify(ca.sum1(ca.exp(x)))
    function = ca.Function("empty", [s, x], [ca.vertcat(ca.sum1(s) + 2.0, own_sum)])
    kernel = build_lane_kernel(function)
    local = np.linspace(0.0, 1.0, own * LANE_WIDTH).reshape(own, LANE_WIDTH)
    found = kernel(np.ones(shared), local)
    assert_array_equal(found[0], np.full(LANE_WIDTH, shared + 2.0))
    for copy in range(LANE_WIDTH):
        assert_array_equal(found[:, copy], function(np.ones(shared), local[:, copy]).full()[:, 0])


def test_no_copies_are_none():
    assert build_lane_kernel(small())(np.ones(2), np.ones((3, 0))).shape == (2, 0)


@pytest.mark.parametrize("offset", [0, 1, 3])
def test_memory_need_not_be_aligned_and_nothing_else_is_written(offset):
    kernel = build_lane_kernel(small())
    memory = np.full(2 * 16 + 8, np.nan)
    out = memory[offset : offset + 32].reshape(2, 16)
    source = np.linspace(0.0, 1.0, 3 * 16 + 8)[offset : offset + 48].reshape(3, 16)
    assert kernel(np.ones(2), source, out) is out
    assert_same_bits(out, by_virtual_machine(small(), np.ones(2), source))
    assert np.isnan(memory[:offset]).all()
    assert np.isnan(memory[offset + 32 :]).all()


@pytest.mark.parametrize(
    ("shared", "local", "out", "words"),
    [
        (np.ones(3), np.ones((3, 8)), None, r"small: shared must have shape \(2,\), got \(3,\)"),
        (np.ones(2), np.ones((2, 8)), None, r"small: local must have shape \(3, a multiple of 8\)"),
        (np.ones(2), np.ones((3, 9)), None, r"a multiple of 8\), got \(3, 9\)"),
        (np.ones(2), np.ones(8), None, r"a multiple of 8\), got \(8,\)"),
        (np.ones(2), np.ones((3, 8)), np.ones((2, 16)), r"out must be .* got float64 \(2, 16\)"),
        (np.ones(2), np.ones((3, 8)), np.ones((2, 8), "f4"), "out must be .* got float32"),
        (np.ones(2), np.ones((3, 8)), np.ones((8, 2)).T, "out must be a writable C-contiguous"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(shared, local, out, words):
    with pytest.raises(ValueError, match=words):
        build_lane_kernel(small())(shared, local, out)


def test_arrays_of_other_kinds_and_orders_are_read():
    local = np.arange(48)[::2].reshape(8, 3).T
    found = build_lane_kernel(small())([1, 2], local)
    assert_same_bits(found, by_virtual_machine(small(), np.array([1.0, 2.0]), local.astype(float)))


def test_kernels_run_in_several_threads_at_once():
    kernel = build_lane_kernel(small())
    local = np.random.default_rng(0).normal(size=(3, 4096))
    right = kernel(np.ones(2), local)
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(kernel(np.ones(2), local))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    for each in found:
        assert_same_bits(each, right)


def test_kernels_are_built_in_several_threads_at_once():
    functions = [small(f"small_{k}") for k in range(8)]
    found = {}

    def build(function):
        found[function.name()] = build_lane_kernel(function)(np.ones(2), np.ones((3, LANE_WIDTH)))

    threads = [threading.Thread(target=build, args=(function,)) for function in functions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == len(functions)
    for each in found.values():
        assert_same_bits(each, by_virtual_machine(small(), np.ones(2), np.ones((3, LANE_WIDTH))))


@pytest.mark.parametrize(
    ("copies", "length"), [(0, 0), (1, 8), (8, 8), (9, 16), (127, 136), (128, 136), (129, 136)]
)
def test_rows_have_whole_vectors_and_do_not_evict_each_other(copies, length):
    assert pad_copies(copies) == length


def test_a_kernel_does_not_leave_its_process():
    with pytest.raises((TypeError, ValueError, pickle.PicklingError)):
        pickle.dumps(build_lane_kernel(small()))


# What cannot be compiled.


@pytest.mark.parametrize("shape", ["three inputs", "two outputs", "sparse", "MX"])
def test_functions_of_another_form_are_refused(shape):
    s, x, more = SX.sym("s", 2), SX.sym("x", 2), SX.sym("more")
    inputs, outputs = {
        "three inputs": ([s, x, more], [x]),
        "two outputs": ([s, x], [s, x]),
        "sparse": ([s, x], [ca.vertcat(x, SX(1, 1))]),
        "MX": ([ca.MX.sym("s")], [ca.MX(1)]),
    }[shape]
    with pytest.raises(ValueError, match="form: a kernel must be an SX function of two columns"):
        build_lane_kernel(ca.Function("form", inputs, outputs))


@pytest.mark.parametrize("operation", [ca.OP_ERFINV, ca.OP_PRINTME])
def test_what_cannot_be_compiled_is_told(operation):
    s, x = SX.sym("s"), SX.sym("x")
    function = ca.Function("without", [s, x], [SX.binary(operation, x, s)])
    assert operation in ids(function)
    assert build_lane_kernel(function) is None
    with pytest.raises(ValueError, match=r"without: it has operations that cannot be compiled\."):
        write_lane_module(function)


def test_calls_are_not_compiled():
    s, x = SX.sym("s"), SX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    function = ca.Function("calls", [s, x], [inner(x) + s])
    assert ca.OP_CALL in ids(function)
    assert build_lane_kernel(function) is None


def test_machine_code_that_is_not_wanted_is_done_without(monkeypatch):
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    assert build_lane_kernel(small()) is None


def test_the_same_function_has_the_same_source():
    assert write_lane_module(small()) == write_lane_module(small())
    assert write_lane_module(small()) != write_lane_module(small("other"))
