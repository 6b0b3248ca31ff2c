"""Kernels are rewritten only if their machine code is not in the cache."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from beamdae.native.lane_kernels import pad_copies
from beamdae.symbolic.sums import kernel_sums
from beamdae.symbolic.sums.kernel_sums import Batch, CompiledKernel, InterpretedKernel, Kernel

SX = ca.SX
COPIES = 5


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("BEAMDAE_NATIVE", raising=False)


def build_kernel():
    """Return a kernel with a repeated subexpression and three sines."""
    shared, local = SX.sym("shared", 2), SX.sym("local", 3)
    results = ca.sin(local * shared[0]) + ca.sqrt(local[0] ** 2 + 1.0)
    return Kernel.of("kernel", shared, local, [results, ca.sqrt(local[0] ** 2 + 1.0)])


def count(function, operation):
    codes = [function.instruction_id(k) for k in range(function.n_instructions())]
    return codes.count(operation)


def test_rewrites():
    kernel = build_kernel()
    functions = kernel.source, kernel.function, kernel.with_vector_sines.function
    assert [count(x, ca.OP_SQRT) for x in functions] == [2, 1, 1]
    assert [count(x, ca.OP_SIN) for x in functions] == [3, 3, 0]


@pytest.mark.parametrize("uses_polynomials", [False, True])
def test_machine_code_in_the_cache_is_found_without_rewriting(uses_polynomials):
    codes = []
    for _ in range(2):
        kernel = build_kernel().with_vector_sines if uses_polynomials else build_kernel()
        codes.append(kernel.load_native(compiles=not codes))
    assert None not in codes
    assert "function" not in vars(kernel)
    other = kernel if uses_polynomials else kernel.with_vector_sines
    assert (other.load_native(compiles=False) is None) is not uses_polynomials


def test_large_kernels_at_single_states_use_machine_code_in_the_cache(monkeypatch):
    monkeypatch.setattr(kernel_sums, "_MIN_INSTRUCTIONS_OF_CACHED_CODE", 0)
    kernel = build_kernel().with_vector_sines
    batch = Batch(kernel, 4, pad_copies(COPIES), COPIES)
    interpreted = kernel_sums._create_evaluator(batch)
    assert isinstance(interpreted, InterpretedKernel)
    assert kernel.native is not None
    cached = Batch(build_kernel().with_vector_sines, *batch[1:])
    compiled = kernel_sums._create_evaluator(cached)
    assert isinstance(compiled, CompiledKernel)
    local = np.random.default_rng(0).normal(size=4 + kernel.n_local * batch.lanes)
    results = []
    for evaluate in (interpreted, compiled):
        out = np.full(kernel.n_out * batch.lanes + 3, np.nan)
        evaluate(np.array([0.7, 0.0]), local, out)
        assert np.isnan(out[-3:]).all()
        results.append(out[:-3].reshape(kernel.n_out, batch.lanes)[:, :COPIES])
    assert_array_equal(*results)
    assert "function" not in vars(cached.kernel)
