"""Equations of motion without redundant constraints, and the reactions of all constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import (
    analyze_constraint_rank,
    build_constraint_jacobian,
    find_dependent_sets,
)
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.structure import intern_structure
from beamdae.errors import BeamdaeError

Array = np.ndarray


@dataclass(frozen=True)
class ReducedEquations:
    """Equations of motion before and after the removal of dependent constraints.

    Attributes
    ----------
    full, equations
        Equations with all constraints, and equations without the redundant constraints and without
        observables.
    independent, redundant
        Indices of the constraints of `full` that are kept and that are removed, ascending.
    """

    full: EquationsOfMotion
    equations: EquationsOfMotion
    independent: Array
    redundant: Array

    @property
    def description(self) -> str:
        """Phrase that names the removed constraints, for the results."""
        names = ", ".join(self.full.lam_names[k] for k in self.redundant)
        follow = "follows" if len(self.redundant) == 1 else "follow"
        return f"minimum norm: {names} {follow} from the others, and reactions have minimum norm"

    def require_agreement(self, time: Array) -> None:
        """Reject removed constraints that contradict others or are independent at nearby positions.

        Raises
        ------
        BeamdaeError
            If there is such a constraint; the message names it or the set to which it belongs.
        """
        state = ConsistencySolver(self.equations).state(time, self.equations.q0, self.equations.v0)
        evaluator = StateEvaluator(self.full)
        constraint_rank = analyze_constraint_rank(evaluator, time, state.q)
        sets = find_dependent_sets(evaluator, time, state.q, state.v, constraint_rank)
        needed_set = next((x for x in sets if max(x.contradiction) > 0.0 or not x.everywhere), None)
        if needed_set is not None:
            raise BeamdaeError(
                f"{', '.join(needed_set.constraints)}: none of these constraints is "
                f"redundant because {needed_set}; remove or correct one of them, or use "
                "redundant='refuse' for a list of all dependent constraints."
            )

    def restore_reactions(self, times: Array, q: Array, lam: Array) -> Array:
        """Return the minimum-norm multipliers of all constraints, (rows, m), that replace `lam`.

        They exert the same forces as the multipliers `lam` of the independent constraints. The norm
        weights each multiplier by the length of the scaled gradient of its constraint, so that
        forces and moments are comparable.

        Parameters
        ----------
        times, q, lam
            Rows of (t, branch), of coordinates, and of multipliers of the independent constraints.
        """
        multipliers = np.zeros((len(lam), self.full.m))
        jacobian = build_constraint_jacobian(self.full)
        lengths = np.zeros_like(multipliers)
        for k in range(len(lam)):
            (matrix,), lengths[k] = jacobian.scaled(times[k : k + 1], q[k : k + 1])
            # G^T lam = (D G)^T lam / D, where the rows of D G have length one.
            left_vectors, _, _ = la.svd(matrix, full_matrices=False)
            # The rank at regular positions: at singular ones, a smaller rank would lose reactions.
            basis = left_vectors[:, : len(self.independent)]
            multipliers[k, self.independent] = lam[k] * lengths[k, self.independent]
            multipliers[k] = basis @ (basis.T @ multipliers[k])
        return multipliers / np.where(lengths > 0.0, lengths, 1.0)


def remove_redundant_constraints(
    equations: EquationsOfMotion, time: Array
) -> ReducedEquations | None:
    """Return the equations without the constraints that are redundant at the start.

    Returns None if none is, or if the model does not request their removal. `time` is (t, branch).

    Raises
    ------
    BeamdaeError
        If redundant constraints contradict the others, or are independent at nearby positions.
    """
    reduction = drop_dependent_constraints(equations, time) if equations.redundant else None
    if reduction is not None:
        reduction.require_agreement(time)
    return reduction


def select_independent_constraints(equations: EquationsOfMotion, time: Array) -> EquationsOfMotion:
    """Return the equations without the constraints that `remove_redundant_constraints` removes."""
    reduction = remove_redundant_constraints(equations, time)
    return equations if reduction is None else reduction.equations


def drop_dependent_constraints(
    equations: EquationsOfMotion, time: Array
) -> ReducedEquations | None:
    """Return the equations without dependent constraints, even if these contradict the others.

    Dependence is assessed at the positions `q0`. Returns None if no constraint is dependent.
    """
    rows = analyze_constraint_rank(StateEvaluator(equations), time, equations.q0).rows
    if not len(rows.dependent):
        return None
    reduced = keep_constraints(equations, rows.independent)
    return ReducedEquations(equations, reduced, rows.independent, rows.dependent)


def keep_constraints(equations: EquationsOfMotion, rows: Array) -> EquationsOfMotion:
    """Return equations with these constraints only, and without observables."""
    structure = equations.structure
    joints = tuple(replace(joint, rows=joint.rows[:, rows].tocsr()) for joint in structure.joints)
    return replace(
        equations,
        multipliers=tuple(equations.multipliers[k] for k in rows),
        observables=(),
        structure=intern_structure(replace(structure, m=len(rows), joints=joints)),
    )
