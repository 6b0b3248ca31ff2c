"""Evaluation of sums at single states.

For one state, CasADi's virtual machine evaluates the kernels of these sums sooner than their
machine code is loaded, unless they are large. Later evaluators with the same plan, as after events
or in studies, reuse the buffers and use machine code if it is in the cache. Results have the same
bits in any case.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import finalize

import numpy as np

from beamdae.core.library import load_core
from beamdae.core.tables import Loop, Workspace
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_plainly

Array = np.ndarray

# Largest inputs of sums that are kept for later models.
_MAX_IDLE_NUMBERS = 100_000


@dataclass
class _Buffers:
    """Sum of an evaluator, and its evaluation by the core; kept by plans for later models."""

    total: Sum
    is_native: bool = False
    evaluation: Workspace | None = None
    loop: Loop | None = None


class SumEvaluator:
    """Evaluates a sum at single states for one model; only one thread may use it at a time."""

    def __init__(self, plan: SumPlan, p: Array) -> None:
        try:
            # Not a test of the length, because a concurrent thread may take the last one.
            buffers = plan.idle_buffers.pop()
        except IndexError:
            buffers = _Buffers(plan.sum(False, p))
        else:
            if not buffers.is_native and plan.load_native(False):
                buffers = _Buffers(plan.sum(True, p), True)
            plan.set_data(buffers.total, p)
        self._buffers = buffers
        if plan.n_local <= _MAX_IDLE_NUMBERS:
            finalize(self, plan.idle_buffers.append, buffers).atexit = False

    @property
    def shared(self) -> Array:
        """Inputs common to all copies, see `Sum.shared`; set before an evaluation."""
        return self._buffers.total.shared

    def __call__(self, x: Array, size: int) -> Array:
        """Return the sum at x, (size,)."""
        buffers = self._buffers
        if load_core() is None:
            result = np.zeros(size)
            evaluate_plainly(buffers.total, x, result)
            return result
        last = buffers.evaluation
        # Models that share a plan may differ in the number of their observed quantities.
        if (
            buffers.loop is None
            or last is None
            or (len(last.x), len(last.result)) != (len(x), size)
        ):
            last = buffers.evaluation = Workspace(
                "Evaluation", total=buffers.total, x=np.zeros(len(x)), result=np.zeros(size)
            )
            buffers.loop = Loop("run_evaluation", last)
        last.x[:] = x
        buffers.loop()
        return last.result.copy()
