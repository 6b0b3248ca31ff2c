"""What tells a model from others, in any process: its structure, its formulas and its numbers."""

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
    """Hash of equations of motion but for their start, and what is observed and watched of them.

    Numbers count with nine digits, so that rounding makes no other model.
    """
    e = equations
    found = hashlib.sha256()
    for named in (*e.coordinates, *e.multipliers):
        found.update(f"{named.header}\n".encode())
    found.update(_number_bytes(e.breakpoints))
    functions: dict[int, bytes] = {}
    terms: list[ForceTerm | ConstraintTerm] = [*e.forces, *e.joints]
    for term in terms:
        kernel = term.kernel
        if id(kernel) not in functions:
            functions[id(kernel)] = _hash_formulas(term)
        found.update(functions[id(kernel)])
        found.update(_number_bytes(e.p[term.data]))
        found.update(_operator_bytes(term.operator))
        if term.rows is not None:
            found.update(_operator_bytes(term.rows))
    return found.hexdigest()


def _hash_formulas(term: ForceTerm | ConstraintTerm) -> bytes:
    kernel = term.kernel
    outputs = [ca.densify(x) for x in kernel.outputs]
    text: str = ca.Function("kernel", kernel.inputs, outputs).serialize()
    return hashlib.sha256(text.encode()).digest()


def _operator_bytes(operator: sp.csr_array) -> bytes:
    places = [np.asarray(x, np.int64).tobytes() for x in (operator.indptr, operator.indices)]
    return b"".join([*places, _number_bytes(operator.data)])


def _number_bytes(values: Iterable[float]) -> bytes:
    # Zero has no sign here.
    return ",".join(f"{x + 0.0:.9g}" for x in values).encode()
