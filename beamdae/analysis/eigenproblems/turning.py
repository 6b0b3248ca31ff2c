"""Detection of mechanisms that turn although an analysis holds them at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.slow_motions import solve_undamped
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Rotations at a lower speed, relative to the smallest natural frequency in rad/s, change it by less
# than about 1 %.
_MIN_RELATIVE_SPEED = 0.1
# Number of modes among which the smallest frequency that is not zero is sought.
_SLOW_MODES = 10
# A motion whose potential energy is below this multiple of its kinetic energy goes on.
_MAX_ENERGY_RATIO = 1e-2


def find_turning(
    e: EquationsOfMotion,
    time: Array,
    q: Array,
    linearize: Callable[[], LinearizedEquations],
    name: str,
    remedy: Callable[[float], str],
) -> tuple[str, ...]:
    """Return a warning of a rotation that a state at rest omits; none if it is slow or absent.

    Drivers cause it, or given velocities if the motion is a free rotation.

    Parameters
    ----------
    e
        Equations of motion of the active parts with independent constraints.
    time
        (t, branch).
    q
        Positions (n,) of the state at rest.
    linearize
        Function that returns the linearized equations at this state.
    name, remedy
        Name of the state, and function of the speed [rad/s] that returns a remedy.
    """
    at_rest, solver = np.zeros(e.n), ConsistencySolver(e)
    permits_rest = all(joint.kernel.is_scleronomic for joint in e.structure.joints)
    is_driven = not permits_rest and bool(np.any(solver.constraint_levels(time, q)[1]))
    if not is_driven and not np.any(e.v0):
        return ()
    try:
        v = solver.start_state(time, q, at_rest if is_driven else e.v0).v
    except BeamdaeError:
        # Systems that cannot start, such as those without inertia, have equilibria, too.
        return ()
    angles = [k for k in np.flatnonzero(e.is_angle).tolist() if k not in e.states]
    fastest = max(angles, key=lambda k: abs(v[k]), default=None)
    if fastest is None or v[fastest] == 0.0:
        return ()
    speed, linearized = float(v[fastest]), linearize()
    potential = float(linearized.energies(v[:, None])[0][0]) / speed**2
    kinetic = float(v @ (linearized.tangent.mass @ v))
    if not is_driven and abs(potential) > _MAX_ENERGY_RATIO * kinetic:
        return ()
    squares = np.abs(solve_undamped(linearized, _SLOW_MODES)[0])
    slowest = np.sqrt(np.min(squares[squares > 0.0], initial=np.inf))
    if abs(speed) <= _MIN_RELATIVE_SPEED * slowest:
        return ()
    part = next(x.name for x in e.parts if fastest in range(*x.rows.indices(e.n)))
    return (
        f"{'drivers' if is_driven else 'given velocities'} turn {part} at {speed:.6g} rad/s, but "
        f"{name} is at rest, without centrifugal forces; {remedy(speed)}.",
    )
