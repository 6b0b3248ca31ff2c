"""Compiled or interpreted step loops of integrators, and the matrices they factorize."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from beamdae.linear.elimination import EliminationPlan, empty_plan
from beamdae.linear.factorizations import SingularMatrixError, create_factorization
from beamdae.linear.pivots import propose_plans
from beamdae.native.linear_solver import LaneSolver, LinearSolver
from beamdae.native.loops import prepare_loop
from beamdae.native.return_codes import NEW_PIVOTS

Array = np.ndarray
W = TypeVar("W")


class InterpretedSolver:
    """Linear solver of an interpreted loop, with the counters of the compiled `LinearSolver`.

    Attributes
    ----------
    singular
        Always 0: `try_factorize` returns False instead. Step loops may reset it, as in
        `LinearSolver`.
    factorizations, solves
        Counters as in `LinearSolver`.
    """

    def __init__(self, pattern: sp.csc_array, method: str, dtype: type) -> None:
        self._factors = create_factorization(pattern, method, dtype)
        self.singular = self.factorizations = self.solves = 0

    def try_factorize(self, nonzeros: Array) -> bool:
        """Factorize the matrix with these non-zeros; return False if it is singular."""
        self.factorizations += 1
        try:
            self._factors.factorize(nonzeros)
        except SingularMatrixError:
            return False
        return True

    def solve(self, right: Array) -> Array:
        """Return the solution of matrix @ x = right."""
        self.solves += 1
        return self._factors.solve(right)


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
        True if right-hand sides hold one system per vector lane, see `loop_functions.solve_lanes`.
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

    def make_solver(self, native: bool, method: str) -> Any:
        """Return the solver for a compiled loop (`native`) or an interpreted loop.

        `method` is "auto", "dense" or "sparse"; compiled loops ignore it.
        """
        dtype = self.nonzeros.dtype.type
        if not native:
            return InterpretedSolver(self.pattern, method, dtype)
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

    def forget_pivots(self, linear: LinearSolver) -> None:
        """Let `linear` request pivots as if no matrix had been factorized before."""
        self._plan, self._plans, self._planned_nonzeros = None, iter(()), np.full(1, np.nan)
        linear.set_plan(empty_plan())
        linear.needs_pivots = linear.is_untried = linear.singular = 0

    def _source_plans(self) -> Iterator[EliminationPlan]:
        # Pivots that have just failed are not tried again.
        plan = self.pivot_source._plan if self.pivot_source else None
        if plan is not None and plan is not self._plan:
            yield plan


class StepLoop(Generic[W]):
    """Loop over steps, in machine code if available, otherwise in plain Python.

    Attributes
    ----------
    work
        Workspace of the loop, a dataclass of numbers and arrays. Between calls, numbers may be
        assigned, but arrays must be changed in place.
    is_native
        True if the loop runs in machine code.
    """

    def __init__(
        self,
        function: Callable[[W], int],
        make: Callable[[bool], W],
        matrices: Callable[[W], Sequence[tuple[Any, FactorizedMatrix]]],
        native: bool,
        compiles: bool = True,
    ) -> None:
        """Compile the loop if possible.

        Parameters
        ----------
        function
            The loop, restricted to the language that numba compiles and to `native.loop_functions`.
            It returns a code of `native.return_codes` or a loop-specific code.
        make
            Function that creates the workspace for machine code (True) or plain Python (False).
        matrices
            Function that returns the linear solvers in the workspace, each with the matrix it
            factorizes.
        native
            True to compile the loop if possible, False to run it in plain Python.
        compiles
            False to use only machine code in the cache.
        """
        self._function = function
        self.work, self._loop = prepare_loop(function, make, native, compiles)
        self.is_native = self._loop is not None
        self._matrices = matrices(self.work)

    def forget_pivots(self) -> None:
        """Remove the pivots of a compiled loop, so that later results do not depend on them."""
        assert self._loop is not None
        if any(len(linear.plan.rows) for linear, _ in self._matrices):
            for linear, matrix in self._matrices:
                matrix.forget_pivots(linear)
            self._loop.bind(*(linear for linear, _ in self._matrices))

    def __call__(self) -> int:
        """Run the loop, renewing pivots whenever it requests new ones; return its code."""
        if self._loop is None:
            return self._function(self.work)
        while (code := self._loop()) == NEW_PIVOTS:
            self._renew_pivots()
        return code

    def _renew_pivots(self) -> None:
        assert self._loop is not None
        renewed = [(linear, matrix) for linear, matrix in self._matrices if linear.needs_pivots]
        for linear, matrix in renewed:
            matrix.renew_pivots(linear)
        # The arrays of the new pivots differ in size and address.
        self._loop.bind(*(linear for linear, _ in renewed))
