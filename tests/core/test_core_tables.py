"""Tables of Python objects for the core."""

import re
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

from beamdae.core.library import FOLDER
from beamdae.core.tables import Loop
from beamdae.linear.elimination import LANES
from beamdae.native.lane_code import LANE_WIDTH
from beamdae.symbolic.sums.kernel_sums import Kernel, evaluate_plainly, evaluate_sum
from beamdae.symbolic.sums.sum_builder import LocalInput, SumBuilder


def test_lanes_of_kernels_and_of_the_core_are_the_same():
    assert re.findall(r"#define LANES (\d+)", (FOLDER / "arrays.h").read_text("utf-8")) == [
        str(LANES)
    ]
    assert LANES == LANE_WIDTH


@dataclass
class Rows:
    """Some fields of the balance of no rows."""

    value: np.ndarray = field(default_factory=lambda: np.zeros(0))
    n: int = 3


@pytest.mark.parametrize("value", [np.zeros(0, np.int32), np.zeros((0, 2)), np.zeros((4, 2))[:, 0]])
def test_arrays_of_other_types_are_rejected(value):
    with pytest.raises(TypeError, match=r"^BalanceBuffers.value: (int|float)"):
        Loop("evaluate_balance", Rows(value))


@pytest.mark.parametrize("copies", [1, 5, 8, 21])
def test_sums_of_the_core_are_those_of_plain_python(copies):
    """Inputs and outputs of 8 and more copies are moved in tiles."""
    shared, local = ca.SX.sym("shared", 2), ca.SX.sym("local", 7)
    values = ca.vertcat(local[:3] * local[6], shared[0] * local[3:6])
    kernel = Kernel.of("products", shared, local, [values])
    size = 3 * copies + 3
    operator = np.concatenate([np.eye(6, size, 3 * k) for k in range(copies)])
    builder = SumBuilder(2)
    added = builder.add(kernel, [LocalInput(sparse(operator), 0)], slice(0, copies), copies)
    builder.add_column(added, 0, sparse(operator), 0)
    plan, random = builder.vector(), np.random.default_rng(copies)
    p, x = random.normal(size=(2, max(size, copies)))
    results = np.zeros((3, size))
    for native, result in zip((False, True), results, strict=False):
        total = plan.sum(native, p[:copies])
        total.shared[:] = 0.5, 0.7
        evaluate_sum(total, x[:size], result)
    plain = replace(total, **plan._untiled_entries, code_owners=plan.sum(False, p).code_owners)
    evaluate_plainly(plain, x[:size], results[2])
    expected = sum(
        b.T @ np.concatenate([(y := b @ x[:size])[:3] * p[k], 0.5 * y[3:]])
        for k, b in enumerate(operator.reshape(copies, 6, size))
    )
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_allclose(results, [expected] * 3, rtol=1e-14, atol=1e-14)


def sparse(matrix):
    return sp.csr_array(matrix)
