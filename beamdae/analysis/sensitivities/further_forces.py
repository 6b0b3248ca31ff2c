"""Forces that are missing in a model, because they vanish at the value of a parameter.

An example is drag with a coefficient of zero. Such a force vanishes for all motions and all values
of the other parameters, so that only its derivative with respect to this parameter is not zero. The
steps of the run without this force therefore serve all parameters, and this derivative is added to
the right-hand side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure, comparison_key

Array = np.ndarray


@dataclass(frozen=True)
class FurtherForces:
    """Derivatives of a model along directions of which some have further forces.

    Attributes
    ----------
    equations
        Equations with the further forces.
    numbers
        Derivatives of the numbers p of these equations for directions with further forces, and
        zeros for others, (k, n_p).
    is_present
        1 for directions with further forces, otherwise 0, (k,).
    """

    equations: EquationsOfMotion
    numbers: Array
    is_present: Array

    @classmethod
    def none(cls, equations: EquationsOfMotion, count: int) -> FurtherForces:
        """Return an object for `count` directions without further forces."""
        return cls(equations, np.zeros((count, len(equations.p))), np.zeros(count, np.intp))

    @classmethod
    def of(
        cls, run: EquationsOfMotion, models: Sequence[EquationsOfMotion], numbers: Sequence[Array]
    ) -> tuple[FurtherForces, Array]:
        """Return the further forces, and the derivatives of the numbers of the run, (k, n_p).

        Parameters
        ----------
        run
            Equations of the run.
        models, numbers
            Equations and derivatives of their numbers for each direction. The `further_key` of all
            equations with further forces must be the same.
        """
        is_present = np.array([x.structure != run.structure for x in models], np.intp)
        extended = next((x for x in models if x.structure != run.structure), run)
        rows = list(zip(numbers, is_present, strict=True))
        further = [x if y else np.zeros(len(extended.p)) for x, y in rows]
        others = [np.zeros(len(run.p)) if y else x for x, y in rows]
        return cls(extended, np.array(further), is_present), np.array(others)


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
