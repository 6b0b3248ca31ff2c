"""Forces that are missing in a model, because they vanish at the value of a parameter.

An example is drag with a coefficient of zero. Such a force vanishes for all motions and all values
of the other parameters. The equations with this force therefore serve all parameters.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure, comparison_key

Array = np.ndarray


def further_key(equations: EquationsOfMotion) -> Any:
    """Return a key that is equal if the same equations serve two parameters.

    Forces that are missing in the run may have the same kernels and operators, but other numbers,
    such as the points on which they act. Their structures are equal; their derivatives are not.
    """
    return equations.structure, (equations.p + 0.0).tobytes()  # not -0.0


def locate_numbers(run: EquationsOfMotion, extended: EquationsOfMotion) -> Array | None:
    """Return the indices of the numbers p of `run` in those of `extended`, (n_p,).

    Return None if `extended` does not consist of `run` and further forces. Events may start or stop
    forces; None is returned for models with events.
    """
    one, other = run.structure, extended.structure
    if (
        any(e.events or e.configurations is not None or e.redundant for e in (run, extended))
        or (one.n, one.m, one.states) != (other.n, other.m, other.states)
        or len(one.joints) != len(other.joints)
        or len(run.observables) != len(extended.observables)
    ):
        return None
    available = {_term_key(x): x.data for x in _terms_of(other)}
    pairs = [(x.data, available.get(_term_key(x))) for x in _terms_of(one)]
    pairs += [(x.data, y.data) for x, y in zip(run.observables, extended.observables, strict=True)]
    result = np.full(len(run.p), -1)
    for source, target in pairs:
        if target is None or target.stop - target.start != source.stop - source.start:
            return None
        result[source] = np.arange(target.start, target.stop)
    is_complete = np.all(result >= 0) and len(np.unique(result)) == len(result)
    return result if is_complete else None


def _terms_of(structure: Structure) -> list[ForceTerm | ConstraintTerm]:
    return [*structure.forces, *structure.joints]


def _term_key(term: ForceTerm | ConstraintTerm) -> Any:
    return tuple(comparison_key(x) for name, x in vars(term).items() if name != "data")
