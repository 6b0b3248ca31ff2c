"""Equations of motion without constraints that follow from others, and reactions of all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import build_constraint_jacobian
from beamdae.equations.starts.redundant_constraints import (
    analyze_constraint_rank,
    find_dependent_sets,
)
from beamdae.equations.structure import Structure, intern_structure
from beamdae.errors import BeamdaeError

Array = np.ndarray

# What redundant constraints may differ by where the others are closed, of the mechanism.
_AGREE = 1e-9
# Singular values of the scaled joints below this are none.
_NONE = 1e-9


@dataclass(frozen=True)
class ReducedEquations:
    """Equations with independent constraints only.

    Attributes
    ----------
    whole, equations
        The mechanism with all of its constraints, and without those that can be spared.
    kept, dropped
        Which of all constraints are in the equations, and which not.
    """

    whole: EquationsOfMotion
    equations: EquationsOfMotion
    kept: Array
    dropped: Array

    @property
    def told(self) -> str:
        """What was done, for those who read the result."""
        names = ", ".join(self.whole.lam_names[k] for k in self.dropped)
        follow = "follows" if len(self.dropped) == 1 else "follow"
        return (
            f"minimum norm: {names} {follow} from the others, reactions are the least that balance"
        )

    def require_agreement(self, time: Array) -> None:
        """Refuse redundant constraints that contradict those kept, or are needed elsewhere.

        Raises
        ------
        BeamdaeError
            Naming one of them.
        """
        state = ConsistencySolver(self.equations).state(time, self.equations.q0, self.equations.v0)
        starter = ConsistencySolver(self.whole)
        joints = analyze_constraint_rank(starter, time, state.q)
        sets = find_dependent_sets(starter, time, state.q, state.v, joints)
        wrong = next((x for x in sets if max(x.contradiction) > 0.0 or not x.everywhere), None)
        if wrong is not None:
            raise BeamdaeError(
                f"{', '.join(wrong.constraints)}: none of them can be spared, {wrong}."
            )
        for off in starter.constraint_levels(time, state.q, state.v)[:2]:
            worst = int(np.argmax(np.abs(off)))
            if abs(off[worst]) > _AGREE * max(1.0, self.whole.length):
                raise BeamdaeError(
                    f"{self.whole.lam_names[worst]}: it contradicts the constraints it depends on "
                    f"at t = {time[0]:g}, by {abs(off[worst]):.3g}."
                )

    def reactions(self, times: Array, q: Array, lam: Array) -> Array:
        """Multipliers of all constraints that give the forces of those kept, of least norm.

        The norm is that of forces in natural units: moments count by the size of the mechanism.
        """
        whole = np.zeros((len(lam), self.whole.m))
        lengths = self._lengths(times, q)
        matrices = build_constraint_jacobian(self.whole)
        for k in range(len(lam)):
            matrix = matrices.at(times[k : k + 1], q[k : k + 1])[0]
            # G^T lam = (D G)^T lam / D, rows of D G of length one.
            scaled = lam[k] * lengths[k, self.kept]
            left, singular, _ = la.svd(matrix, full_matrices=False)
            held = left[:, singular > _NONE]
            whole[k, self.kept] = scaled
            whole[k] = held @ (held.T @ whole[k])
        return whole / np.where(lengths > 0.0, lengths, 1.0)

    def _lengths(self, times: Array, q: Array) -> Array:
        """Lengths of the rows of G in natural sizes."""
        starter = ConsistencySolver(self.whole)
        return np.array(
            [
                np.sqrt(
                    (starter.constraint_matrix(time, x).multiply(self.whole.position_scales[None]))
                    .power(2)
                    .sum(axis=1)
                ).ravel()
                for time, x in zip(times, q, strict=True)
            ]
        )


def remove_redundant_constraints(whole: EquationsOfMotion, time: Array) -> ReducedEquations | None:
    """The mechanism without constraints that can be spared at its start; None if there are none.

    Raises
    ------
    BeamdaeError
        If these contradict the others.
    """
    found = drop_dependent_constraints(whole, time)
    if found is not None:
        found.require_agreement(time)
    return found


def drop_dependent_constraints(whole: EquationsOfMotion, time: Array) -> ReducedEquations | None:
    """The same, whatever they say."""
    split = analyze_constraint_rank(ConsistencySolver(whole), time, whole.q0).split
    if not len(split.dropped):
        return None
    kept, own = split.kept, whole.structure
    joints = tuple(replace(joint, rows=joint.rows[:, kept].tocsr()) for joint in own.joints)
    equations = replace(
        whole,
        multipliers=tuple(whole.multipliers[k] for k in kept),
        observables=(),
        structure=intern_structure(Structure(own.n, len(kept), own.forces, joints)),
    )
    return ReducedEquations(whole, equations, kept, split.dropped)
