"""Evaluation of sums at single states, in machine code if a process evaluates them often.

In a single run, CasADi's virtual machine evaluates the kernels of these sums sooner than their
machine code is loaded. Runs of the same model with other numbers share the plans of sums, see
`row_kernels`. Only studies compile the kernels, see `compile_sums`. Results have the same bits in
any case.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any
from weakref import finalize

import numpy as np

from beamdae.core.library import load_core
from beamdae.core.tables import Loop
from beamdae.symbolic.sums.kernel_sums import Evaluation, Sum, SumPlan, evaluate_plainly

Array = np.ndarray

# Largest inputs of sums that are kept for later models.
_MAX_IDLE_NUMBERS = 100_000

_compiles: ContextVar[bool] = ContextVar("compilation of kernels of sums", default=False)


@contextmanager
def compile_sums() -> Iterator[None]:
    """Compile the kernels of sums that are evaluated often, within this context."""
    token = _compiles.set(True)
    try:
        yield
    finally:
        _compiles.reset(token)


@dataclass
class _Buffers:
    """Sum of an evaluator, and its evaluation by the core; kept by plans for later models."""

    total: Sum
    is_native: bool = False
    evaluation: Evaluation | None = None
    loop: Loop | None = None

    def evaluate(self, x: Array, size: int) -> Array:
        """Return the sum at x, (size,)."""
        if load_core() is None:
            result = np.zeros(size)
            evaluate_plainly(self.total, x, result)
            return result
        last = self.evaluation
        # Models that share a plan may differ in the number of their observed quantities.
        if self.loop is None or last is None or (len(last.x), len(last.result)) != (len(x), size):
            last = self.evaluation = Evaluation(self.total, np.zeros(len(x)), np.zeros(size))
            self.loop = Loop("run_evaluation", self.evaluation)
        last.x[:] = x
        self.loop.call_loaded()
        return last.result.copy()


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
        plan = self._plan
        if not self._buffers.is_native and plan.code.find(
            plan.operations_per_kernel, self.load_native, _compiles.get()
        ):
            # Another evaluator of the plan may have loaded the machine code.
            self.load_native(compiles=False)
        return self._buffers.evaluate(x, size)

    def load_native(self, compiles: bool) -> bool:
        """Use machine code from now on; return False if it is not available.

        Only machine code in the cache is used if `compiles` is False.
        """
        buffers = self._buffers
        if not buffers.is_native and self._plan.load_native(compiles):
            total = self._plan.sum(True, self._p)
            total.shared[:] = self.shared
            buffers.total, buffers.is_native = total, True
            buffers.evaluation = buffers.loop = None
        return self._buffers.is_native
