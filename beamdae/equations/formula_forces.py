"""Forces that are formulas of a model, evaluated for many states at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.building import select_input_laws
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.kernel_groups import group_by_kernel

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class FormulaForceTerm:
    """One copy of a force that is a formula.

    Attributes
    ----------
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

    kernel: ForceKernel
    operator: sp.csr_array
    columns: Array
    to_local: sp.csr_array
    numbers: Array

    def evaluate(self, t: Array, branch: float, q: Array, v: Array) -> Array:
        """Return generalized forces (rows, size) at times `t` [s] and q and v, (rows, n) each."""
        return self.evaluate_local(t, branch, q[:, self.columns], v[:, self.columns])

    def evaluate_local(self, t: Array, branch: float, q: Array, v: Array) -> Array:
        """Return generalized forces, given the coordinates `columns` and their velocities."""
        times = np.column_stack([t, np.full(len(t), branch)])
        local = (np.asarray(self.to_local @ x.T).T for x in (q, v))
        return self.kernel.load_function(times, *local, self.numbers)


def name_formula_forces(equations: EquationsOfMotion) -> list[str]:
    """Return the name of the part of each force that `compile_formula_forces` returns."""
    inputs = {} if equations.mechanism is None else equations.mechanism.inputs
    laws = select_input_laws(inputs)
    forces = [x.with_laws(laws) for part in equations.statements for x in part.forces]
    names = []
    for group, term in zip(group_by_kernel(forces), equations.forces, strict=False):
        if term.kernel.may_have_peaks:
            members = (forces[k] for k in group.members)
            names += [x.part for x in members for _ in range(x.data.shape[1])]
    # Equations of a `ConstrainedSystem` have no statements.
    return names or ["force"] * len(compile_formula_forces(equations))


def compile_formula_forces(equations: EquationsOfMotion) -> tuple[FormulaForceTerm, ...]:
    """Return the forces that may have narrow peaks over time or over the motion."""
    terms = []
    for term in equations.forces:
        if not term.kernel.may_have_peaks:
            continue
        size = term.kernel.local.size
        numbers = equations.p[term.data].reshape(term.count, -1)
        for k in range(term.count):
            operator = term.operator[k * size : (k + 1) * size]
            columns = np.unique(operator.indices)
            terms.append(
                FormulaForceTerm(term.kernel, operator, columns, operator[:, columns], numbers[k])
            )
    return tuple(terms)
