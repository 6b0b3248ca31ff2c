"""Hash of the structure, formulas and numbers of a model, the same in every process."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ConstraintTerm, ForceTerm

Array = np.ndarray


def hash_model(equations: EquationsOfMotion) -> str:
    """Return a hash of the model; initial conditions, observables and events do not affect it.

    Numbers enter with nine significant digits, so that rounding errors hardly ever change the hash.
    """
    e = equations
    digest = hashlib.sha256()
    for quantity in (*e.coordinates, *e.multipliers):
        digest.update(f"{quantity.header}\n".encode())
    digest.update(_number_bytes(e.breakpoints))
    functions: dict[int, bytes] = {}
    terms: list[ForceTerm | ConstraintTerm] = [*e.forces, *e.joints]
    for term in terms:
        kernel = term.kernel
        if id(kernel) not in functions:
            outputs = [ca.densify(x) for x in kernel.outputs]
            text: str = ca.Function("kernel", kernel.inputs, outputs).serialize()
            functions[id(kernel)] = hashlib.sha256(text.encode()).digest()
        digest.update(functions[id(kernel)])
        digest.update(_number_bytes(e.p[term.data]))
        digest.update(_operator_bytes(term.operator))
        if term.rows is not None:
            digest.update(_operator_bytes(term.rows))
    return digest.hexdigest()


def _operator_bytes(operator: sp.csr_array) -> bytes:
    indices = [np.asarray(x, np.int64).tobytes() for x in (operator.indptr, operator.indices)]
    return b"".join([*indices, _number_bytes(operator.data)])


def _number_bytes(values: Iterable[float]) -> bytes:
    # Adding zero removes the sign of -0.0.
    return ",".join(f"{x + 0.0:.9g}" for x in values).encode()
