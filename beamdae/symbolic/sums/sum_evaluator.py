"""Evaluation of sums at single states, in machine code if a process evaluates them often.

In a single run, CasADi's virtual machine evaluates these sums sooner than their machine code is
loaded. Runs of the same model with other numbers share the plans of sums, see `row_kernels`.
Loops take seconds to compile, and therefore only studies compile them, see `compile_sums`. Results
have the same bits in any case.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import finalize

import numpy as np

from beamdae.native.llvm import MachineCodeError
from beamdae.native.loops import CompiledLoop
from beamdae.native.return_codes import DONE
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_sum

Array = np.ndarray

# Largest inputs of sums that are kept for later models.
_MAX_IDLE_NUMBERS = 100_000

_compiles: ContextVar[bool] = ContextVar("compilation of loops of sums", default=False)


@contextmanager
def compile_sums() -> Iterator[None]:
    """Compile the loops of sums that are evaluated often, within this context."""
    token = _compiles.set(True)
    try:
        yield
    finally:
        _compiles.reset(token)


@dataclass(slots=True)
class Evaluation:
    """Sum, its input and its result; argument of `run_evaluation`."""

    total: Sum
    x: Array
    result: Array


def run_evaluation(evaluation: Evaluation) -> int:
    """Write the sum at `x` into `result`; return DONE."""
    evaluate_sum(evaluation.total, evaluation.x, evaluation.result)
    return DONE


@dataclass
class _Buffers:
    """Sum of an evaluator, and its machine code if it is in use; kept by plans for later models."""

    total: Sum
    native: tuple[Evaluation, CompiledLoop] | None = None


class SumEvaluator:
    """Evaluates a sum at single states for one model; only one thread may use it at a time."""

    def __init__(self, plan: SumPlan, p: Array, buffers: _Buffers | None = None) -> None:
        self._plan, self._p = plan, p
        self._buffers = buffers or _Buffers(plan.sum(False, p))

    @classmethod
    def borrow(cls, plan: SumPlan, p: Array, borrower: Any) -> SumEvaluator:
        """Return an evaluator with the numbers p of a model, for one object.

        Its buffers are reused after `borrower` has been deleted, because creating them takes as
        long as several evaluations.
        """
        try:
            # Not a test of the length, because a concurrent thread may take the last one.
            evaluator = cls(plan, p, plan.idle_buffers.pop())
        except IndexError:
            evaluator = cls(plan, p)
        else:
            plan.set_data(evaluator._buffers.total, p)
        if plan.n_local <= _MAX_IDLE_NUMBERS:
            finalize(borrower, plan.idle_buffers.append, evaluator._buffers).atexit = False
        return evaluator

    @property
    def shared(self) -> Array:
        """Inputs common to all copies, see `Sum.shared`; set before an evaluation."""
        return self._buffers.total.shared

    def __call__(self, x: Array, size: int) -> Array:
        """Return the sum at x, (size,); all calls have equal sizes of x and of the result."""
        buffers, plan = self._buffers, self._plan
        if buffers.native is None:
            load = partial(self.load_native, len(x), size)
            if plan.code.find(plan.operations_per_kernel, load, _compiles.get()):
                # Another evaluator of the plan may have loaded the machine code.
                load(compiles=False)
        if buffers.native is None:
            result = np.zeros(size)
            evaluate_sum(buffers.total, x, result)
            return result
        evaluation, loop = buffers.native
        evaluation.x[:] = x
        loop.call_loaded()
        return evaluation.result.copy()

    def load_native(self, n_inputs: int, size: int, compiles: bool) -> bool:
        """Use machine code from now on; return False if it is not available.

        Only machine code in the cache is used if `compiles` is False.
        """
        if self._buffers.native is not None:
            return True
        if not self._plan.load_native(compiles):
            return False
        total = self._plan.sum(True, self._p)
        total.shared[:] = self.shared
        evaluation = Evaluation(total, np.zeros(n_inputs), np.zeros(size))
        try:
            loop = CompiledLoop(run_evaluation, evaluation, compiles=compiles)
        except MachineCodeError:
            return False
        self._buffers.total, self._buffers.native = total, (evaluation, loop)
        return True
