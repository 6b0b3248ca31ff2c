"""Linearization of mechanisms with more accurate beams about the same state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import (
    Linearization,
    linearize_about,
    linearize_at_rest,
    load_path_end,
)
from beamdae.analysis.statics.corrector import Corrector, CorrectorError
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.analysis.statics.path_controls import LoadControl
from beamdae.equations.assembly.refined_beams import RefinedBeams
from beamdae.errors import BeamdaeError
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.results.diagnostics.meshes.coarse_elements import find_refined_instant
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant

Array = np.ndarray

# Time in which the positions at an instant change, relative to 1 / |eigenvalue| of the slowest
# motion: long, so that beams are in equilibrium with the accelerations, but not free motions.
_DURATION_RATIO = 30.0
# Additional modes, because the order of modes may differ.
_FURTHER_MODES = 4


def solve_refined_eigenvalues(
    lin: Linearization,
    refined: RefinedBeams,
    about: Any,
    t: float,
    eigenvalues: Array,
    is_damped: bool,
) -> Array | None:
    """Return as many eigenvalues as `eigenvalues` and a few more; see `linearize_refined`."""
    finer = linearize_refined(lin, refined, about, t, eigenvalues)
    if finer is None:
        return None
    count = len(eigenvalues) + _FURTHER_MODES
    return solve_eigenproblem(finer.linearized_equations, count, is_damped).values


def linearize_refined(
    lin: Linearization, refined: RefinedBeams, about: Any, t: float, eigenvalues: Array
) -> Linearization | None:
    """Linearize a mechanism with more accurate beams about the same state, or return None.

    At an instant of a run, the beams are in equilibrium with the accelerations of the run. At the
    end of a path, the loads are the same.

    Parameters
    ----------
    lin
        Linearization of the original mechanism.
    refined
        The mechanism with more accurate beams.
    about, t
        State and time [s] of the original linearization; see `modes`.
    eigenvalues
        Eigenvalues of the original mechanism [1/s].
    """
    if isinstance(about, Mapping) and any(
        str(name).partition(".")[0] in (*refined.exact, *refined.halved) for name in about
    ):
        return None  # Positions of beams belong to their elements.
    try:
        if isinstance(about, Equilibrium):
            return _linearize_path_end(lin, refined, about)
        if isinstance(about, Instant):
            sizes = np.abs(eigenvalues)
            slowest = np.min(sizes[sizes > 0.0], initial=np.inf)
            duration = _DURATION_RATIO / slowest if np.isfinite(slowest) else 1.0
            about = find_refined_instant(lin.full_equations, refined, about, duration)
            if about is None:
                return None
        return linearize_about("modes", refined.equations, about, t)
    except (BeamdaeError, CorrectorError, SingularMatrixError):
        return None


def _linearize_path_end(
    lin: Linearization, refined: RefinedBeams, path: Equilibrium
) -> Linearization | None:
    e, mechanism = lin.full_equations, lin.full_equations.mechanism
    coarse, loaded, factor = load_path_end(mechanism, e, path)
    loads = [list(stage) for stage in path.loads] or None
    fine = build_loading(refined.mechanism, refined.equations, loads, path.t)
    k = [system.loaded is loaded.loaded for system in coarse.systems].index(True)
    system, names = fine.systems[k], loaded.equations.lam_names
    multipliers = dict(zip(names, lin.state.lam.tolist(), strict=True))
    lam = [multipliers.get(name, 0.0) for name in system.equations.lam_names]
    x = np.append(refined.start + refined.prolongation @ lin.state.q, lam)
    point = Corrector(system).correct(LoadControl(), factor, x, factor)
    equations = system.equations
    equations = replace(equations, q0=point.x[: equations.n], v0=np.zeros(equations.n))
    time = system.loaded.time
    rest = linearize_at_rest(equations, time, lambda state: system.motion_tangent(state, factor))
    return Linearization(equations, refined.equations, lin.about, time, *rest)
