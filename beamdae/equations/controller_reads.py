"""Values that sampled controllers read, evaluated for one state in a few microseconds."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import ControllerTerm
from beamdae.symbolic.functions.compiled import Compiled

Array = np.ndarray


def compile_reads(term: ControllerTerm, p: Array) -> Callable[[float, float, Array, Array], Array]:
    """Return a function of t and branch [s], q and v that evaluates the reads of a controller.

    All reads are outputs of one function of the coordinates on which they depend.
    """
    if not term.reads:
        return lambda t, branch, q, v: np.zeros(0)
    columns = np.unique(np.concatenate([read.operator.indices for read in term.reads]))
    time, q_read, v_read = (
        ca.MX.sym(*x) for x in (("time", 2), ("q", len(columns)), ("v", len(columns)))
    )
    values = []
    for read in term.reads:
        to_local = ca.DM(sp.csc_matrix(read.operator[:, columns]))
        numbers = ca.MX(ca.DM(p[read.data]))
        values.append(read.function.apply(time, to_local @ q_read, to_local @ v_read, numbers))
    compiled = Compiled(ca.Function("reads", [time, q_read, v_read], [ca.vertcat(*values)]))
    (times, q_inputs, v_inputs), (outputs,) = compiled.inputs, compiled.outputs

    def read_values(t: float, branch: float, q: Array, v: Array) -> Array:
        times[0], times[1] = t, branch
        q_inputs[:] = q[columns]
        v_inputs[:] = v[columns]
        compiled.evaluate()
        return outputs.copy()

    return read_values
