"""Sliding of regularized friction in contacts and joints, evaluated for many states at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.equations.assembly.building import NumberStore, build_observable, select_input_laws
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.parts.forces.regularized_friction import RegularizedFriction

Array = np.ndarray


@dataclass(frozen=True)
class SlidingTerm:
    """Sliding of one part with friction.

    Attributes
    ----------
    name, law
        Name of the part, and the law of its friction.
    observable, numbers
        Compiled `law.sliding`, and the numbers to which it refers.
    """

    name: str
    law: RegularizedFriction
    observable: Observable
    numbers: Array

    def evaluate(self, times: Array, state: State) -> Array:
        """Return sliding velocities [m/s] at rows of (t, branch), NaN without a normal force."""
        law = self.law
        columns = self.observable.evaluate(self.numbers, times, state.q, state.v, state.lam)
        force, slip = columns.T
        if not law.is_contact:
            # Normal forces in joints are NaN at a sliding velocity of zero.
            coefficient = np.abs(law.friction_coefficient(slip)) * (law.radius or 1.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                force = np.abs(force) / coefficient
        return np.where(force > law.min_force, slip, np.nan)


def friction_laws(equations: EquationsOfMotion) -> dict[str, RegularizedFriction]:
    """Return the laws of all parts with friction, by name; none for a constrained system."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    return {
        name: law
        for name, part in parts.items()
        if (law := getattr(part, "regularized_friction", None)) is not None and law.coefficient
    }


def compile_sliding(equations: EquationsOfMotion) -> Sequence[SlidingTerm]:
    """Return the sliding of all parts with friction; an empty tuple for a constrained system."""
    laws, mechanism = friction_laws(equations), equations.mechanism
    if not laws or mechanism is None:
        return ()
    coordinates, numbers = map_coordinates(mechanism), NumberStore()
    rows = _rows_of_joints(equations)
    inputs = select_input_laws(mechanism.inputs)
    observables = {
        name: build_observable(name, law.sliding, coordinates, numbers, rows, inputs)
        for name, law in laws.items()
    }
    p = numbers.all(mechanism.inputs)
    return [SlidingTerm(name, law, observables[name], p) for name, law in laws.items()]


def _rows_of_joints(equations: EquationsOfMotion) -> dict[str, slice]:
    """Return the slice of the multipliers of each joint, by name."""
    joints = [name.rpartition(".")[0] for name in equations.lam_names]
    return {x: slice(joints.index(x), joints.index(x) + joints.count(x)) for x in joints}
