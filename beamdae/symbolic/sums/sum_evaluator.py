"""Evaluation of sums at single states.

CasADi's virtual machine evaluates the kernels of these sums sooner than their machine code is
loaded. Results have the same bits as those of machine code.
"""

from __future__ import annotations

import numpy as np

from beamdae.core.library import load_core
from beamdae.core.tables import Loop
from beamdae.symbolic.sums.kernel_sums import Evaluation, SumPlan, evaluate_plainly

Array = np.ndarray


class SumEvaluator:
    """Evaluates a sum at single states for one model; only one thread may use it at a time."""

    def __init__(self, plan: SumPlan, p: Array) -> None:
        self._total = plan.sum(False, p)
        self._evaluation: Evaluation | None = None

    @property
    def shared(self) -> Array:
        """Inputs common to all copies, see `Sum.shared`; set before an evaluation."""
        return self._total.shared

    def __call__(self, x: Array, size: int) -> Array:
        """Return the sum at x, (size,); all calls have equal sizes of x and of the result."""
        if load_core() is None:
            result = np.zeros(size)
            evaluate_plainly(self._total, x, result)
            return result
        if self._evaluation is None:
            self._evaluation = Evaluation(self._total, np.zeros(len(x)), np.zeros(size))
            self._loop = Loop("run_evaluation", self._evaluation)
        self._evaluation.x[:] = x
        self._loop.call_loaded()
        return self._evaluation.result.copy()
