"""Step loops in the core, and the matrices they factorize."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from beamdae.core.library import load_core
from beamdae.core.linear_solver import LaneSolver, LinearSolver
from beamdae.core.return_codes import NEW_PIVOTS
from beamdae.core.tables import Loop
from beamdae.errors import BeamdaeError
from beamdae.linear.elimination import EliminationPlan
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.pivots import propose_plans

Array = np.ndarray
W = TypeVar("W")


@dataclass
class FactorizedMatrix:
    """Matrix that a loop fills and factorizes.

    Attributes
    ----------
    pattern
        Sparsity pattern (CSC).
    nonzeros
        Values on the pattern, written by the loop.
    pivot_source
        Matrix with the same pattern whose pivots are tried first, because a search for pivots takes
        longer than many factorizations; None if there is none.
    in_lanes
        True if right-hand sides hold one system per vector lane.
    """

    pattern: sp.csc_array
    nonzeros: Array
    pivot_source: FactorizedMatrix | None = None
    in_lanes: bool = False
    _plan: EliminationPlan | None = field(default=None, init=False)
    _plans: Iterator[EliminationPlan] = field(default_factory=lambda: iter(()), init=False)
    _planned_nonzeros: Array = field(default_factory=lambda: np.full(1, np.nan), init=False)

    @classmethod
    def from_pattern(
        cls,
        pattern: sp.csc_array,
        dtype: type = float,
        pivot_source: FactorizedMatrix | None = None,
        in_lanes: bool = False,
    ) -> FactorizedMatrix:
        """Return a zero matrix with this pattern."""
        return cls(pattern, np.zeros(pattern.nnz, dtype), pivot_source, in_lanes)

    def make_solver(self) -> LinearSolver:
        """Return the solver for a loop."""
        dtype = self.nonzeros.dtype.type
        return (LaneSolver if self.in_lanes else LinearSolver).empty(dtype)

    def renew_pivots(self, linear: LinearSolver) -> None:
        """Set the next proposed pivots in `linear`; mark `linear` as singular if there are none."""
        linear.needs_pivots = 0
        try:
            # Pivots of a nearly singular matrix may pass the test of the factors and still give
            # inaccurate solutions; the same proposals for the same matrix would never end.
            is_repeated = np.array_equal(self.nonzeros, self._planned_nonzeros)
            if not (linear.is_untried or is_repeated):
                candidates = propose_plans(self.pattern, self.nonzeros, not self.in_lanes)
                self._plans = chain(self._source_plans(), candidates)
                self._planned_nonzeros = self.nonzeros.copy()
            plan = next(self._plans, None)
        except SingularMatrixError:
            plan = None
        if plan is None:
            linear.singular, linear.is_untried = 1, 0
            self._planned_nonzeros = np.full(1, np.nan)
        else:
            self._plan = plan
            linear.set_plan(plan)

    def _source_plans(self) -> Iterator[EliminationPlan]:
        # Pivots that have just failed are not tried again.
        plan = self.pivot_source._plan if self.pivot_source else None
        if plan is not None and plan is not self._plan:
            yield plan


def require_core(
    part: str = "core: this method or analysis",
    alternative: str = ", or use GeneralizedAlpha with fixed steps",
) -> None:
    """Raise a BeamdaeError if there is no core."""
    if load_core() is None:
        raise BeamdaeError(
            f"{part} requires the compiled core; install a C compiler, for example by "
            f'`pip install "beamdae[fmu]"`{alternative}.'
        )


class StepLoop(Generic[W]):
    """Loop of the core that factorizes matrices.

    Attributes
    ----------
    work
        Workspace of the loop, with the fields of its structure in `core.h`. Between calls, numbers
        may be assigned, but arrays must be changed in place.
    """

    def __init__(self, function: str, work: W, *matrices: tuple[Any, FactorizedMatrix]) -> None:
        """Bind the loop.

        Parameters
        ----------
        function
            Name of the loop in `core.h`. It returns a code of `core.return_codes`.
        work
            The workspace.
        matrices
            Linear solvers in the workspace, each with the matrix it factorizes.

        Raises
        ------
        BeamdaeError
            If there is no core.
        """
        require_core()
        self.work, self._matrices = work, matrices
        self._loop = Loop(function, work)

    def __call__(self) -> int:
        """Run the loop, renewing pivots whenever it requests new ones; return its code."""
        while (code := self._loop()) == NEW_PIVOTS:
            renewed = [(linear, matrix) for linear, matrix in self._matrices if linear.needs_pivots]
            for linear, matrix in renewed:
                matrix.renew_pivots(linear)
            # The arrays of the new pivots differ in size and address.
            self._loop.bind(*(linear for linear, _ in renewed))
        return code
