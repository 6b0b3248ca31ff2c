"""Calls of the linear solvers of the core, one at a time."""

import ctypes

import numpy as np

from beamdae.core.library import load_core
from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import DONE, NEW_PIVOTS
from beamdae.core.tables import Layout


class _Vector(ctypes.Structure):
    _fields_ = (("at", ctypes.c_void_p), ("size", ctypes.c_int64))


class LinearSystem:
    """Linear solver, the non-zeros of its matrix, and a right-hand side, real or complex."""

    def __init__(self, linear, nonzeros, right):
        self.linear, self.nonzeros, self.right = linear, nonzeros, right

    def factorize(self):
        """Factorize the matrix; return DONE, NEW_PIVOTS or SINGULAR."""
        return self._call("factorize", self.nonzeros)

    def solve(self):
        """Replace the right-hand side by the solution computed with the last factors."""
        self._call("solve", self.right)

    def _call(self, name, array):
        call, numbers = self._bind(name, array)
        code = call()
        for x in numbers:
            setattr(x.owner, x.name, x.words[x.word])
        return code

    def _bind(self, name, array):
        is_complex = np.iscomplexobj(array)
        layout = Layout("ComplexSolver" if is_complex else "LinearSolver", self.linear)
        table = np.array(layout.words, np.int64)
        numbers = layout.numbers_in(table)
        for x in numbers:
            x.words[x.word] = getattr(x.owner, x.name)
        function = getattr(load_core(), name + "_complex" * is_complex)
        function.argtypes, function.restype = (ctypes.c_void_p, _Vector), ctypes.c_int
        vector = _Vector(array.ctypes.data, array.size)

        def call(_kept=(self, table, array)):
            return function(table.ctypes.data, vector)

        return call, numbers


def refactorize(plan, factors, nonzeros):
    """Return True if the pivots of a plan suit the matrix with these non-zeros."""
    nonzeros = nonzeros.astype(factors.x.dtype)
    system = LinearSystem(LinearSolver(plan, factors), nonzeros, np.zeros_like(factors.x))
    code = system.factorize()
    assert code in (DONE, NEW_PIVOTS)
    assert system.linear.needs_pivots == (code == NEW_PIVOTS)
    assert system.linear.factorizations == (code == DONE)
    return code == DONE


def solve(plan, factors, right):
    """Replace a right-hand side by the solution with the last factors."""
    LinearSystem(LinearSolver(plan, factors), factors.matrix, right).solve()
