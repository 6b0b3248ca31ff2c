"""Forces that are formulas of a model, evaluated for many states at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.numbers import select_input_laws
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.kernel_groups import group_by_kernel

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class FormulaForceTerm:
    """One copy of a force that is a formula.

    Attributes
    ----------
    part
        Name of the part, see `name_copies`.
    kernel
        Kernel of the force.
    operator
        Maps global to local coordinates.
    columns
        Indices of the global coordinates on which the force depends.
    to_local
        Columns of `operator` with these indices.
    numbers
        Numbers of the copy.
    """

    part: str
    kernel: ForceKernel
    operator: sp.csr_array
    columns: Array
    to_local: sp.csr_array
    numbers: Array

    def evaluate(self, times: Array, q: Array, v: Array) -> Array:
        """Return generalized forces (rows, size) at rows (t, branch), q and v of `columns`."""
        return self.kernel.load_function(times, *self._to_local(q, v), self.numbers)

    def evaluate_arguments(self, times: Array, q: Array, v: Array) -> Array:
        """Return the values of `ForceKernel.peak_arguments`, (rows, k), as `evaluate`."""
        return self.kernel.peak_arguments(times, *self._to_local(q, v), self.numbers)

    def _to_local(self, *rows: Array) -> list[Array]:
        return [np.asarray(self.to_local @ x.T).T for x in rows]


def name_copies(equations: EquationsOfMotion) -> list[list[str]]:
    """Return the name of the part of each copy of each term in `equations.forces`.

    Equations of a `ConstrainedSystem` have no statements: their forces are called "force".
    """
    laws = select_input_laws({} if equations.mechanism is None else equations.mechanism.inputs)
    forces = [x.with_laws(laws) for part in equations.statements for x in part.forces]
    if not forces:
        return [["force"] * term.count for term in equations.forces]
    return [
        [forces[k].part for k in group.members for _ in range(forces[k].count)]
        for group in group_by_kernel(forces)
    ]


def compile_formula_forces(equations: EquationsOfMotion) -> tuple[FormulaForceTerm, ...]:
    """Return the forces that may have narrow peaks over time or over the motion."""
    terms = []
    for term, names in zip(equations.forces, name_copies(equations), strict=True):
        if term.rotation is not None or not term.kernel.may_have_peaks:
            continue
        size = term.kernel.local.size
        numbers = equations.p[term.data].reshape(term.count, -1)
        for k, name in enumerate(names):
            operator = term.operator[k * size : (k + 1) * size]
            columns = np.unique(operator.indices)
            to_local = operator[:, columns]
            terms.append(
                FormulaForceTerm(name, term.kernel, operator, columns, to_local, numbers[k])
            )
    return tuple(terms)
