"""`mode_sensitivities`: derivatives of natural frequencies, damping ratios and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from beamdae.analysis.eigenproblems.eigensolution import RIGID
from beamdae.analysis.eigenproblems.linearized_equations import (
    LinearizedEquations,
    linearize_in_mixed_form,
)
from beamdae.analysis.linear_dynamics.linearization import (
    REFERENCE,
    Frame,
    frame_of,
    model_of_modes,
    rest_state,
    unbalances,
)
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compute_modes
from beamdae.analysis.sensitivities.implicit import Eigenpair, apply_pencil
from beamdae.analysis.sensitivities.neighbors import Difference, NumericModel, difference_models
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    select_parameters,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.equations.starts.steady_rotation import rotating_state
from beamdae.errors import BeamdaeError, record_warnings, short_repr, warn_user
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.read_only import read_only_data
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "mode_sensitivities"
_MODE = "mode"
_FREQUENCY, _DAMPING_RATIO, _GROWTH_RATE = (
    "frequency [Hz]",
    "damping ratio [-]",
    "growth rate [1/s]",
)
# Eigenvalues with a smaller relative distance are repeated: their shapes are arbitrary up to
# rounding errors divided by this distance.
_MIN_GAP = 1e-6
# Shift, relative to the lowest eigenvalue, that gives free motions a stiffness, and number of
# solutions that remove its effect.
_SHIFT, _SOLUTIONS = 1e-2, 6
# Net forces above this fraction of the largest force mean that there is no equilibrium.
_MAX_UNBALANCED_FORCE = 1e-6
# Rounding errors of elastic forces, relative to the stiffness times the natural sizes, if they are
# differentiated with respect to a relative change of a parameter.
_FORCE_ROUNDING = 1e-11


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class ModeSensitivities(SensitivityResult):
    """Natural modes and their derivatives; see `mode_sensitivities`.

    Attributes
    ----------
    modes
        The modes.
    parameters
        Values by name of the parameters with respect to which the modes are differentiated.
    eigenvalues
        Derivatives (k,) of the complex eigenvalues [1/s] with respect to each parameter, by its
        name; NaN for free motions and repeated eigenvalues.
    shapes
        Derivatives (k, n) of the complex mode shapes with respect to each parameter, by its name;
        NaN for free motions and repeated eigenvalues.
    warnings
        Warnings that the call issued.
    """

    modes: Modes
    parameters: Mapping[str, float]
    eigenvalues: Mapping[str, Array] = field(repr=False)
    shapes: Mapping[str, Array] = field(repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)

    @property
    def _summary(self) -> str:
        return repr(self.modes)

    @property
    def _index(self) -> tuple[str, Array]:
        return _MODE, np.arange(1, len(self.modes) + 1)

    @property
    def _values(self) -> dict[str, Array]:
        return {
            _FREQUENCY: self.modes.frequencies,
            _DAMPING_RATIO: self.modes.damping_ratios,
            _GROWTH_RATE: self.modes.growth_rates,
        }

    @property
    def _columns(self) -> dict[str, dict[str, Array]]:
        value, result = self.modes.eigenvalues, {}
        size = np.where(value == 0.0, 1.0, np.abs(value))
        for name, rate in self.eigenvalues.items():
            growth = np.real(value.conj() * rate) / size
            result[name] = {
                # No negative zeros in tables.
                _FREQUENCY: np.sign(value.imag) * rate.imag / (2.0 * np.pi) + 0.0,
                _DAMPING_RATIO: -rate.real / size + value.real * growth / size**2 + 0.0,
                _GROWTH_RATE: rate.real + 0.0,
            }
        return result


@single_threaded
@interruptible
@record_warnings
def mode_sensitivities(
    model: Model,
    by: Sequence[str] | str,
    about: Any = REFERENCE,
    n: int | None = 10,
    damping: bool = True,
    t: float = 0.0,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> ModeSensitivities:
    """Compute natural modes and differentiate them with respect to parameters of the model.

    With the mode z of the eigenvalue l, A(l; p) z = 0 with A = l^2 M + l C + K bordered by the
    constraints, the derivatives solve

        A dz + A'(l) z dl + dA z = 0

    together with the normalization x^H M x = 1 (Fox & Kapoor 1968, doi:10.2514/3.5008; Nelson 1976,
    doi:10.2514/3.7211). dA contains the changes of the numbers of the model and of the state about
    which it is linearized, which moves with the parameters. It is differenced along the model
    function, see `sensitivities`.

    Parameters
    ----------
    model
        Model function.
    by
        Names of the parameters with respect to which the modes are differentiated. They must be
        floats.
    about
        "reference", "equilibrium", positions by name, `bd.rotation(...)`, or an `Equilibrium` of
        the model with the same `parameters`, whose load factors remain constant; see `modes`. The
        state must be an equilibrium, in the rotating frame, for all values of the parameters.
    n, damping, t
        See `modes`.
    parameters
        Values of the parameters of the model that differ from the defaults.

    Returns
    -------
    ModeSensitivities
        The modes with their derivatives.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the state is not an equilibrium or moves, or a
        parameter changes the structure of the equations or is at a kink of the model function.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If an eigenvalue is repeated, because its modes are then not differentiable, if a parameter
        has no effect, and as `modes`.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def oscillator(stiffness=8.0):
    ...     mech = bd.Mechanism()
    ...     bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    ...     mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    ...     mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, stiffness))
    ...     return mech
    >>> result = bd.mode_sensitivities(oscillator, "stiffness")
    >>> round(float(result.sensitivity("frequency", "stiffness")[1]), 6)  # 1 / (4 pi sqrt(k m))
    0.019894
    """
    names, model = select_parameters(_NAME, model, by, parameters)
    if isinstance(about, Instant):
        raise BeamdaeError(
            f"{_NAME}: about must be a state at rest or in steady rotation, got "
            f"{short_repr(about)}; use differences of modes for moving states."
        )
    if isinstance(about, Equilibrium) and about.numbers is not None:
        raise BeamdaeError(
            f"{_NAME}: the path varies {about.quantity}, so its end is that of another model than "
            "the given one; use about='equilibrium' with t= or parameters= of this place."
        )
    result = compute_modes(model(), about, n, damping, t, has_accuracy=False)
    derivatives = differentiate_modes(model, names, result, about, damping, t)
    result._issue_warnings()
    return derivatives


def differentiate_modes(
    model: NumericModel,
    names: Sequence[str],
    result: Modes,
    about: Any,
    damping: bool,
    t: float,
) -> ModeSensitivities:
    """Return the derivatives of modes of a model; see `mode_sensitivities`."""
    lin = result._linearization
    if lin.zero_square > 0.0:
        raise BeamdaeError(
            f"{_NAME}: the state of {model.name} is not an equilibrium, so its modes cannot be "
            "differentiated; use about='equilibrium'."
        )
    is_drawn = not isinstance(about, Mapping)
    follows_start = not is_drawn or about in (REFERENCE, AS_DRAWN)

    def assemble(mechanism: Any) -> EquationsOfMotion:
        equations = as_equations(_NAME, model_of_modes(mechanism, about), AS_DRAWN)
        return equations if is_drawn else apply_initial_conditions(equations, about, t)

    drawn = assemble(model())
    base = replace(lin.full_equations, q0=drawn.q0, v0=drawn.v0)
    full, lam, idle = lin.linearized_equations, lin.state.lam, None
    if full.mixed is not None:
        lam, idle = full.mixed.multipliers, abs(full.mixed.rows).sum(axis=1) == 0.0
    state = np.append(lin.state.q, lam)
    speeds = np.abs(result.eigenvalues[result.eigenvalues != 0.0])
    solve = full.pencil.factorize(_SHIFT * float(speeds[0] if len(speeds) else 1.0))
    own = full if damping else full.symmetrized()
    modes = enumerate(zip(result.eigenvalues, result.shapes, result.kinds, strict=True))
    pairs = {
        k: Eigenpair(own, complex(value), shape)
        for k, (value, shape, kind) in modes
        if kind != RIGID
    }
    if repeated := [k for k, pair in pairs.items() if pair.gap < _MIN_GAP]:
        numbers = ", ".join(str(k + 1) for k in repeated)
        undamped = "; for overdamped modes, use damping=False" if damping else ""
        warn_user(
            f"{_NAME}: the eigenvalues of modes {numbers} of {model.name} are repeated (within "
            f"{_MIN_GAP:g}), so their derivatives are not known (NaN); request fewer modes "
            "(n=), model one half of a symmetric structure, or change a parameter so that the "
            f"eigenvalues differ{undamped}."
        )
        pairs = {k: pair for k, pair in pairs.items() if k not in repeated}
    eigenvalues, shapes = {}, {}
    for name, difference in difference_models(model, names, base, assemble).items():
        frames = [frame_of(e, about, t) for e in difference.models]
        along = np.zeros_like(state)
        if follows_start:
            starts = [rest_state(x) for x in frames]
            along[: base.n] = difference.combine(x.q for x in starts)
            pairs_at_rest = zip(frames, starts, strict=True)
            rate = difference.combine(x.tangent_at(at).residual for x, at in pairs_at_rest)
            if unbalances(difference.steps[-1] * rate, frame_of(base, about, t)):
                raise BeamdaeError(
                    f"{_NAME}: {name} of {model.name} moves the state out of equilibrium, so its "
                    "modes cannot be differentiated; use about='equilibrium'."
                )
        residuals = [
            x.tangent.residual for x in _linearize_along(difference, frames, state, along, idle)
        ]
        change = _balance(full, solve, difference.combine(residuals), model.parameters[name])
        if change is None:
            raise BeamdaeError(
                f"{_NAME}: the equilibrium has no derivative with respect to {name}, because a "
                "motion that it causes has no stiffness; add a spring or a joint."
            )
        neighbors = _linearize_along(difference, frames, state, along + change, idle)
        if not damping:
            neighbors = [x.symmetrized() for x in neighbors]
        eigenvalues[name] = np.full(len(result), complex(np.nan, np.nan))
        shapes[name] = np.full(result.shapes.shape, complex(np.nan, np.nan))
        for k, pair in pairs.items():
            products = [apply_pencil(x, pair.value, pair.vector) for x in neighbors]
            inertia = [x.tangent.mass @ pair.shape for x in neighbors]
            changes = (difference.combine(x) for x in (products, inertia))
            eigenvalues[name][k], shapes[name][k] = pair.derivative(*changes)
    return ModeSensitivities(
        result,
        {name: float(model.parameters[name]) for name in names},
        eigenvalues,
        shapes,
        result.warnings,
    )


def _linearize_along(
    difference: Difference,
    frames: Sequence[Frame],
    state: Array,
    change: Array,
    idle: Array | None,
) -> list[LinearizedEquations]:
    """Return the linearized equations of neighboring models.

    Parameters
    ----------
    difference, frames
        Neighboring models of a parameter, and their equations.
    state, change
        Coordinates, multipliers and stiff forces, and their derivatives.
    idle
        Mask of the forces without stiffness, see `introduce_resultants`.
    """
    result = []
    for (e, _, tangent_at, rotation), step in zip(frames, difference.steps, strict=True):
        q, lam = np.split(state + step * change, [e.n])
        at = State(q, np.zeros(e.n), np.zeros(e.n), lam)
        if rotation is not None:
            at = rotating_state(e, rotation, q, lam)
        result.append(linearize_in_mixed_form(e, at, tangent_at, idle))
    return result


def _balance(full: LinearizedEquations, solve: Any, force: Array, value: float) -> Array | None:
    """Return the change of the state that balances a derivative of the forces; None if none does.

    Free motions have no stiffness; the motion along them is zero. `solve` is that of the shifted
    equations, and `value` that of the parameter.
    """
    if solve is None:
        return None
    matrix, n, change = full.pencil.matrices[0], full.equations.n, np.zeros_like(force)
    for _ in range(_SOLUTIONS):
        change = change - solve(force + matrix @ change)
    scales, stiffness = full.equations.position_scales, abs(full.stiffness)
    error, sizes = np.abs(force + matrix @ change), abs(matrix) @ np.abs(change) + np.abs(force)
    limit = _MAX_UNBALANCED_FORCE * np.max(scales * sizes[:n], initial=0.0)
    rounding = np.max(scales * (stiffness @ scales), initial=0.0) / (abs(value) or 1.0)
    is_balanced = np.all(scales * error[:n] <= limit + _FORCE_ROUNDING * rounding)
    return change if is_balanced else None
