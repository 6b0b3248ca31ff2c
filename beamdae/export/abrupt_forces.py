"""Forces that change abruptly with the motion, which fixed steps smear or pass over."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.errors import list_first, warn_user
from beamdae.symbolic.force_kernel import ForceKernel

# Arguments of a force kernel; see `ForceKernel.inputs`.
_MOTION_ARGUMENTS = (1, 2, 4)  # q, v and lam
# Operations with jumps or kinks, and calls of tables.
_ABRUPT_OPERATIONS = {
    ca.OP_LT,
    ca.OP_LE,
    ca.OP_EQ,
    ca.OP_NE,
    ca.OP_NOT,
    ca.OP_AND,
    ca.OP_OR,
    ca.OP_IF_ELSE_ZERO,
    ca.OP_SIGN,
    ca.OP_FABS,
    ca.OP_FLOOR,
    ca.OP_CEIL,
    ca.OP_FMOD,
    ca.OP_REMAINDER,
    ca.OP_COPYSIGN,
    ca.OP_FMIN,
    ca.OP_FMAX,
    ca.OP_CALL,
}
_MAX_NAMES = 3  # of parts in a warning


def choose_integrator(equations: EquationsOfMotion, gaps: Sequence[SurfaceGapTerm]) -> str:
    """Return "radau" for models with contacts, friction or other abrupt forces, else "alpha"."""
    kernels = {id(term.kernel): term.kernel for term in equations.forces}.values()
    is_abrupt = gaps or any(k.local.n_multipliers or has_kinks(k) for k in kernels)
    return "radau" if is_abrupt else "alpha"


def has_kinks(kernel: ForceKernel) -> bool:
    """Return True if the force has kinks or tables at positions, velocities or reactions."""
    function = ca.Function("force", kernel.inputs, [kernel.force])
    follows_motion: set[int] = set()
    for k in range(function.n_instructions()):
        code, sources = function.instruction_id(k), function.instruction_input(k)
        targets = function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            continue
        if code == ca.OP_INPUT:
            depends = sources[0] in _MOTION_ARGUMENTS
        else:
            depends = not follows_motion.isdisjoint(sources)
        # Of a conditional value, the condition decides.
        deciding = sources[:1] if code == ca.OP_IF_ELSE_ZERO else sources
        if code in _ABRUPT_OPERATIONS and not follows_motion.isdisjoint(deciding):
            return True
        # Places of the work vector are reused.
        (follows_motion.update if depends else follows_motion.difference_update)(targets)
    return False


def warn_of_fixed_steps(call: str, gaps: Sequence[SurfaceGapTerm], step: float) -> None:
    """Warn about contacts in a model that is exported with fixed steps of `step` [s]."""
    names = list(dict.fromkeys(gap.part for gap in gaps))
    if not names:
        return
    contacts = list_first(names, _MAX_NAMES)
    warn_user(
        f"{call}: fixed steps of {step:g} s are inaccurate where contacts ({contacts}) last only "
        'a few steps, and pass over shorter ones; use integrator="radau", or halve the step until '
        "the results stay the same."
    )
