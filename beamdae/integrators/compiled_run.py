"""Runs of loops, compiled where they can be, and what Python does for them in between."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from beamdae.linear.elimination import Linear, Plan
from beamdae.linear.factorizations import SingularMatrixError, factorization
from beamdae.linear.pivots import plans
from beamdae.linear.return_codes import NEW_PIVOTS
from beamdae.native.loops import prepared

Array = np.ndarray
W = TypeVar("W")


class PlainLinear:
    """What plain Python factorizes and solves with in the place of `Linear`."""

    def __init__(self, pattern: sp.csc_array, method: str, dtype: type) -> None:
        self._factors = factorization(pattern, method, dtype)
        self.singular = self.factorizations = self.solves = 0

    def factorized(self, nonzeros: Array) -> bool:
        """Factorize a matrix; whether that is possible."""
        self.factorizations += 1
        try:
            self._factors.factorize(nonzeros)
        except SingularMatrixError:
            return False
        return True

    def solve(self, right: Array) -> Array:
        """Solution of matrix @ x = right."""
        self.solves += 1
        return self._factors.solve(right)


@dataclass
class Matrix:
    """A matrix that a loop factorizes.

    Attributes
    ----------
    pattern, nonzeros
        Its CSC pattern, and where the loop puts its numbers.
    like
        One of the same pattern whose pivots are tried first: finding them takes longer than many
        factorizations.
    """

    pattern: sp.csc_array
    nonzeros: Array
    like: Matrix | None = None
    _plan: Plan | None = field(default=None, init=False)
    _plans: Iterator[Plan] = field(default_factory=lambda: iter(()), init=False)

    @classmethod
    def of(cls, pattern: sp.csc_array, dtype: type = float, like: Matrix | None = None) -> Matrix:
        """A matrix of this pattern."""
        return cls(pattern, np.zeros(pattern.nnz, dtype), like)

    def linear(self, native: bool, method: str) -> Any:
        """What is to factorize it; `method` is "auto", "dense" or "sparse" in plain Python."""
        dtype = self.nonzeros.dtype.type
        return Linear.empty(dtype) if native else PlainLinear(self.pattern, method, dtype)

    def renew(self, linear: Linear) -> None:
        """Give `linear` pivots that may serve the numbers there are, or tell it there are none."""
        linear.asks = 0
        try:
            if not linear.fresh:
                self._plans = chain(self._given(), plans(self.pattern, self.nonzeros))
            plan = next(self._plans, None)
        except SingularMatrixError:
            plan = None
        if plan is None:
            linear.singular, linear.fresh = 1, 0
        else:
            self._plan = plan
            linear.take(plan)

    def _given(self) -> Iterator[Plan]:
        """Pivots of the other matrix, unless they are those that served no longer."""
        plan = self.like._plan if self.like else None
        if plan is not None and plan is not self._plan:
            yield plan


class Running(Generic[W]):
    """A loop and what it works on.

    Attributes
    ----------
    work
        Numbers and arrays; what Python sets between calls has to be set in place.
    """

    def __init__(
        self,
        function: Callable[[W], int],
        make: Callable[[bool], W],
        matrices: Callable[[W], Sequence[tuple[Any, Matrix]]],
        native: bool,
    ) -> None:
        """Prepare a loop.

        Parameters
        ----------
        make
            Makes what it works on, for machine code or for plain Python.
        matrices
            What of it factorizes which matrix.
        native
            Whether machine code is possible.
        """
        self._function = function
        self.work, self._loop = prepared(function, make, native)
        self.is_native = self._loop is not None
        self._matrices = matrices(self.work)

    def __call__(self) -> int:
        """Run the loop until it comes back with anything but a wish for other pivots."""
        if self._loop is None:
            return self._function(self.work)
        while (code := self._loop()) == NEW_PIVOTS:
            for linear, matrix in self._matrices:
                if linear.asks:
                    matrix.renew(linear)
            # The arrays of a plan are of its own size.
            self._loop.bind()
        return code
