"""Stability of the equilibrium in which a run starts."""

from __future__ import annotations

import numpy as np

from beamdae.analysis.linear_dynamics.linearization import active_equations
from beamdae.analysis.statics.corrector import EquilibriumPoint
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.stability import MAX_DENSE_STIFFNESS
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import format_count


def describe_unstable_start(equations: EquationsOfMotion, t: float) -> str:
    """Return a sentence on the equilibrium q0 at time `t` [s] if it is unstable; otherwise "".

    Sampled controllers and friction of joints and contacts, which may hold an unstable equilibrium,
    are not assessed, and neither are large models in which the signs of pivots do not suffice.
    """
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    laws = (getattr(part, "regularized_friction", None) for part in parts.values())
    has_friction = any(law is not None and law.coefficient for law in laws)
    if equations.controllers or has_friction:
        return ""
    active, time = active_equations(equations, None, t)
    static = StaticEquations(active, time)
    state = ConsistencySolver(active).state(time, active.q0, np.zeros(active.n))
    point = EquilibriumPoint(
        LoadedEquations(static, static), np.concatenate([state.q, state.lam]), 1.0
    )
    if not point.is_count_certain and active.n > MAX_DENSE_STIFFNESS:
        return ""
    count = point.unstable_count
    if count <= 0:
        return ""
    return (
        f"start: the equilibrium is unstable in {format_count(count, 'direction')}; a real "
        "structure leaves it at the smallest disturbance, but a run without disturbances stays "
        "until rounding errors have grown; start from other positions, or add an imperfection "
        "(bd.imperfect) or a small load."
    )
