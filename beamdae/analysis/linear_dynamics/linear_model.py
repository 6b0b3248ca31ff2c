"""Linear state-space models x' = A x + B u, y = C x + D u of a mechanism about a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae import deferred
from beamdae.analysis.linear_dynamics.linearization import (
    REFERENCE,
    Linearization,
    linearize_about,
    model_of_modes,
    searched_start,
    solve_for_accelerations,
)
from beamdae.equations.assembly.building import build_equations
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.assembly.statement_checks import collect_statements
from beamdae.equations.equations_of_motion import EquationsOfMotion, InputTerm, Observable
from beamdae.equations.formulations.tangents import compute_tangent, differentiate_residual
from beamdae.equations.starts.rank import RANK_TOLERANCE
from beamdae.equations.starts.steady_rotation import RotatingCoordinates
from beamdae.errors import (
    BeamdaeError,
    format_count,
    format_percent,
    list_first,
    require_finite,
    require_positive,
    require_sequence,
    short_repr,
    suggest,
    warn_of_result,
    warn_user,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_parameters import split_unit
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasPage
from beamdae.symbolic.statements import Variable

Array = np.ndarray

if TYPE_CHECKING:
    from scipy.signal import StateSpace

Matrices = tuple[Array, Array, Array, Array]

# State matrices are dense; memory grows with the square of the number of coordinates.
_MAX_COORDINATES = 2000
# Shift of the inverse from which slow poles are computed [1/s]: not small, because free motions are
# poles at zero, and not a round number, because models may have poles at those.
_POLE_SHIFT = 0.618034
# Smaller damping ratios and relative growth rates are rounding errors.
_MIN_DAMPING_RATIO = 1e-9
# Fewer frequencies are single values rather than a curve whose peaks are read.
_MIN_GRID_SIZE = 20
# A resonance is missed if the response at the frequencies beside it is below this fraction of its
# peak.
_MIN_PEAK_SHARE = 0.95
# Distance from resonances at which their peaks are evaluated, relative to the frequency: those of
# modes without damping are infinite.
_PEAK_DISTANCE = 1e-6
_MAX_NAMES = 4  # of inputs or outputs without a finite derivative
_FINITE_REMEDY = "or add a small positive number under a square root of zero"


@read_only_data
@dataclass(frozen=True, repr=False)
class LinearModel(HasPage):
    """Linear state-space model of small deviations from a state; see `linearize`.

    Attributes
    ----------
    A, B, C, D
        Matrices of x' = A x + B u, y = C x + D u, with the shapes (states, states),
        (states, inputs), (outputs, states) and (outputs, inputs). `tuple(model)` returns them, for
        `scipy.signal` and python-control (whose names must not contain dots):
        `control.ss(*model, inputs=[u.name.replace(".", " ") for u in model.inputs])`.
    states
        Names and units of the states: independent coordinates of the mechanism, then independent
        velocities.
    inputs
        Names and units of the inputs, such as "push.Fy" [N]. The input of a driver is its
        acceleration, such as "motor.angle_ddot" [rad/s^2].
    outputs
        Names and units of the output columns.
    state_values, output_values
        Values of states and outputs at the state about which the model is linearized, in the units
        of `states` and `outputs`. At a steady rotation, velocities are absolute.
    about
        Description of the state.
    warnings
        Warnings if the state is at rest but not an equilibrium, if it is the end of an equilibrium
        path or a run that ended early, if the command of a controller has reached its limit, or if
        inputs or outputs are omitted because their derivatives are not finite.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    state_values: Array = field(repr=False)
    output_values: Array = field(repr=False)
    about: str
    warnings: tuple[str, ...]
    _linearization: Linearization | None = field(default=None, repr=False)
    _request: _Request | None = field(default=None, repr=False)
    _motions: Array | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        inputs, outputs = (", ".join(x.name for x in y) for y in (self.inputs, self.outputs))
        count = len(self.warnings)
        note = f"; {format_count(count, 'warning')}, see .warnings" if count else ""
        return (
            f"<LinearModel about {self.about}: {len(self.states)} states; "
            f"inputs: {inputs or 'none'}; outputs: {outputs or 'none'}{note}>"
        )

    def __iter__(self) -> Any:
        return iter((self.A, self.B, self.C, self.D))

    @cached_property
    @single_threaded
    def poles(self) -> Array:
        """Eigenvalues l of `A` [1/s], (states,), in ascending order of |l|.

        Slow ones of stiff structures are accurate, see `compute_poles`.
        """
        return compute_poles(self.A)

    @single_threaded
    def state_space(self, every: float | None = None) -> StateSpace:
        """Return the model as a `scipy.signal.StateSpace`, for step and impulse responses.

        Parameters
        ----------
        every
            Interval between samples [s], for the discrete-time model x_{k+1} = A_d x_k + B_d u_k of
            inputs that are held in between (zero-order hold), as a `Controller` holds them:
            [[A_d, B_d], [0, I]] = exp([[A, B], [0, 0]] every). Defaults to None, for the model in
            continuous time.

        Returns
        -------
        scipy.signal.StateSpace
            Its attribute `dt` is `every`.

        Raises
        ------
        BeamdaeError
            If `every` is not positive, or the model grows beyond the range of numbers within it.

        Examples
        --------
        Poles of a loop in which a law u = -4 y, sampled every 0.1 s, controls y = x:

        >>> import numpy as np
        >>> import beamdae as bd
        >>> mech = bd.Mechanism()
        >>> valve = mech.input("valve")
        >>> level = mech.state("level", valve)
        >>> plant = bd.linearize(mech, outputs=["level"]).state_space(every=0.1)
        >>> np.linalg.eigvals(plant.A - plant.B @ [[4.0]] @ plant.C).round(9).tolist()
        [0.6]
        """
        from scipy.signal import StateSpace

        if every is None:
            return StateSpace(self.A, self.B, self.C, self.D)
        step = require_positive("state_space", "every", every)
        n, size = len(self.A), len(self.A) + self.B.shape[1]
        # Elements of A of stiff structures differ so much that the exponential needs balancing.
        balanced, (scale, _) = la.matrix_balance(self.A, permute=False, separate=True)
        block = np.zeros((size, size))
        block[:n, :n], block[:n, n:] = balanced, self.B / scale[:, None]
        with np.errstate(all="ignore"):
            exponential = la.expm(step * block)[:n]
        if not np.all(np.isfinite(exponential)):
            raise BeamdaeError(
                f"state_space: an unstable motion exceeds the range of numbers within {step:g} s; "
                "use a shorter interval."
            )
        a, b = exponential[:, :n] * scale[:, None] / scale, exponential[:, n:] * scale[:, None]
        return StateSpace(a, b, self.C, self.D, dt=step)

    @single_threaded
    def frequency_response(self, frequencies: Any) -> Array:
        """Return the transfer matrix G = C (i w I - A)^-1 B + D, w = 2 pi f.

        Parameters
        ----------
        frequencies
            Frequencies f [Hz], (k,).

        Returns
        -------
        numpy.ndarray
            Complex, (k, outputs, inputs), in units of output per unit of input.

        Raises
        ------
        BeamdaeError
            If `frequencies` is not a list of finite numbers, or the response is infinite at one of
            them.

        Warns
        -----
        BeamdaeWarning
            If 20 or more frequencies miss the peak of a resonance between them by more than 5 %, or
            errors exceed 4 % of the frequency or the largest magnitude (see `Bode.errors`), which
            are measured unless warnings are filtered out.
        """
        values = [
            require_finite("frequency_response", "frequencies", f)
            for f in require_sequence(
                "frequency_response", "frequencies", frequencies, "a list [Hz]"
            )
        ]
        response, grid = self.evaluate_response(values), np.array(values)
        for warning in self.find_missed_peaks(grid, response):
            # The response is an array, whose warnings cannot be read later.
            warn_user(warning, merges=False)
        if values and not warnings_are_ignored():
            for sentence in self.measure_errors(grid, response).sentences():
                warn_user(f"frequency_response: {sentence}", merges=False)
        return response

    @cached_property
    def errors(self) -> Any:
        """Errors of the three slowest natural frequencies, see `Errors`.

        `Bode.errors` are those of natural frequencies and responses in a band.
        """
        return deferred.module("accuracy.linear_models").measure_frequencies(self)

    def measure_errors(self, frequencies: Array, response: Array) -> Any:
        """Return the errors of responses (k, outputs, inputs) at frequencies [Hz], (k,)."""
        module = deferred.module("accuracy.linear_models")
        return module.measure_response(self, frequencies, response)

    def bound_magnitudes(self, frequencies: Array) -> Array:
        """Return the median over the frequencies [Hz] of |C (i w I - A)^-1| |B|, w = 2 pi f.

        |.| are the norms of rows and columns. Rounding errors of the transfer matrix are
        proportional to this product, even where the response is zero by symmetry.
        """
        identity = np.eye(len(self.A))
        system = self.A, identity, self.C, np.zeros_like(self.C)
        gains = [transfer_matrix(system, 2j * np.pi * f) for f in frequencies]
        bounds = np.linalg.norm(gains, axis=2)[:, :, None] * np.linalg.norm(self.B, axis=0)
        return np.asarray(np.median(bounds, axis=0))

    def find_missed_peaks(self, frequencies: Array, response: Array) -> list[str]:
        """Return a warning if peaks at poles exceed the response at both adjacent frequencies."""
        grid, rows = np.unique(np.abs(frequencies), return_index=True)
        shares = {}
        for f in np.unique(self.poles.imag / (2.0 * np.pi)).tolist():
            if len(grid) >= _MIN_GRID_SIZE and grid[0] < f < grid[-1] and f not in grid:
                after = int(np.searchsorted(grid, f))
                nearest = np.max(np.abs(response[rows[after - 1 : after + 1]]), axis=0)
                peak = np.abs(self.evaluate_response([f * (1.0 + _PEAK_DISTANCE)])[0])
                shares[f] = float(np.min(nearest[peak > 0.0] / peak[peak > 0.0], initial=1.0))
        f = min(shares, key=lambda f: shares[f], default=0.0)
        if shares.get(f, 1.0) >= _MIN_PEAK_SHARE:
            return []
        return [
            f"frequency_response: the resonance at {f:.6g} Hz lies between frequencies that reach "
            f"{format_percent(shares[f])} of its peak; add the frequencies abs(model.poles.imag) / "
            "(2 * np.pi), or damping, without which peaks are infinite."
        ]

    def evaluate_response(self, values: Sequence[float]) -> Array:
        """Return the transfer matrix at frequencies [Hz], (k, outputs, inputs).

        Raises
        ------
        BeamdaeError
            If it is infinite at one of them.
        """
        response = np.zeros((len(values), *self.D.shape), complex)
        for row, f in zip(response, values, strict=True):
            row[:] = transfer_matrix((self.A, self.B, self.C, self.D), 2j * np.pi * f)
            if not np.isfinite(row).all():
                raise BeamdaeError(
                    f"frequency_response: the response at {f:g} Hz is infinite because an undamped "
                    "mode or a free motion has this frequency; choose other frequencies."
                )
        return response


def transfer_matrix(system: Matrices, point: complex) -> Array:
    """Return C (s I - A)^-1 B + D of a system at a point s; it is not finite at a pole."""
    a, b, c, d = system
    shifted = -a.astype(complex)
    np.einsum("ii->i", shifted)[...] += point
    try:
        with np.errstate(all="ignore"):
            return np.asarray(c @ np.linalg.solve(shifted, b.astype(complex)) + d)
    except np.linalg.LinAlgError:
        return np.full(d.shape, complex("nan"))


def compute_poles(matrix: Array) -> Array:
    """Return the eigenvalues l of a state matrix A [1/s], (states,), in ascending order of |l|.

    Elements of A of stiff structures are so large that errors of eigenvalues of A, which are
    relative to its norm, exceed the slow ones. The left and right eigenvectors x and y are
    therefore those of the inverse of A - s I (shift and invert), and l = y^H A x / y^H x. Its error
    is second-order in those of the vectors and, for relative errors eps of the elements of A, eps
    |y|^T |A| |x| / |y^H x| (Higham, Accuracy and Stability of Numerical Algorithms, 2002). Real
    parts within this bound are zero.
    """
    if not matrix.size:
        return np.zeros(0, complex)
    a, _ = la.matrix_balance(matrix, permute=False)
    inverse = np.linalg.inv(a - _POLE_SHIFT * np.eye(len(a)))
    values, y, x = la.eig(inverse, left=True, right=True)
    products = np.einsum("ij,ij->j", y.conj(), x)
    # Vectors of multiple poles, such as those of free motions, are orthogonal.
    is_single = np.abs(products) > np.sqrt(np.finfo(float).eps)
    divisors = np.where(is_single, products, 1.0)
    quotients = np.einsum("ij,ij->j", y.conj(), a @ x) / divisors
    sizes = np.einsum("ij,ij->j", np.abs(y), np.abs(a) @ np.abs(x)) / np.abs(divisors)
    poles = np.where(is_single, quotients, _POLE_SHIFT + 1.0 / values)
    errors = np.where(is_single, np.finfo(float).eps * sizes, 0.0)
    errors = errors + _MIN_DAMPING_RATIO * np.abs(poles)
    poles.real[np.abs(poles.real) <= errors] = 0.0
    return poles[np.argsort(np.abs(poles), kind="stable")]


@single_threaded
@interruptible
def linearize(
    model: Any,
    about: Any = REFERENCE,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    t: float = 0.0,
    *,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> LinearModel:
    """Linearize a mechanism into a state-space model with named inputs and outputs.

    Dependent coordinates are eliminated, so there are two states for each degree of freedom (fewer
    if constraints act on velocities only); outputs may include reactions. The displacement and
    velocity of a driver that is an input become states, and its acceleration is the input. About a
    rotation, states are deviations in the rotating frame; velocities among the outputs are absolute
    velocities, in the axes of that frame.

    Parameters
    ----------
    model, about, t
        See `modes`.
    inputs
        Names of inputs, forces, moments and drivers, which select all their columns, or of columns
        such as "push.Fy", with or without the unit. Defaults to all of them. Those that are not
        named keep the values that they have at the state.
    outputs
        Names of observables, which select all their columns, or of columns such as "tip.y", with
        or without the unit. Defaults to all of them except largest magnitudes, such as
        `Beam.largest_stress`, whose derivatives jump, and those whose derivatives are not finite.
    accuracy
        Largest error of a required value [-], from 1e-6 to 0.1, see `Errors`. The analysis is
        repeated, up to four times, with finer meshes and exact strains until its measured errors
        are small enough; `errors.status` says what was reached.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to the three slowest natural
        frequencies; see `bode` for frequency responses.

    Returns
    -------
    LinearModel
        Matrices with the names and units of states, inputs and outputs.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the state, an input or an output does not exist, an output is a
        largest magnitude, the derivative of a named input or output is not finite, a driver among
        the inputs is inactive or redundant, an output is a reaction while redundant constraints are
        removed, a coordinate has no inertia, or the model has more than 2000 coordinates.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        For each of `LinearModel.warnings`, and if `LinearModel.errors` exceed 4 %, which are
        measured unless warnings are filtered out.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    >>> line = mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    >>> push = mech.add(bd.Force("push", bob.point, (0.0, 0.0)))
    >>> mech.observe("bob", bob.point)
    >>> linear = bd.linearize(mech, inputs=["push"])
    >>> [x.header for x in (*linear.states, linear.inputs[0])]
    ['bob.x [m]', 'bob.x_dot [m/s]', 'push.Fx [N]']
    >>> linear.B[:, 0].tolist()
    [0.0, 0.5]
    """
    request = _Request(about, require_finite("linearize", "t", t), inputs, outputs)
    until = deferred.module("accuracy.until")
    analysis = until.Analysis(
        "linearize",
        lambda model, _: compute_linear_model(model, request),
        start=searched_start("linearize", about, accuracy),
    )
    model = model_of_modes(model, about)
    linear = until.reach_accuracy(analysis, model, accuracy, accuracy_columns)
    assert linear._linearization is not None
    warn_of_result(linear.warnings, linear._linearization.equations.build_warnings)
    if not warnings_are_ignored():
        warn_of_result(linear.errors.sentences())
    return linear


class _Request(NamedTuple):
    """Arguments of `linearize`."""

    about: Any
    t: float
    inputs: Sequence[str] | None
    outputs: Sequence[str] | None


def compute_linear_model(model: Any, request: _Request) -> LinearModel:
    """Return the result of `linearize` for a built model, without issuing warnings."""
    lin = linearize_about("linearize", model, request.about, request.t)
    linear = build_linear_model(model, lin, request)
    return replace(linear, _request=request) if isinstance(model, Mechanism) else linear


def build_linear_model(model: Any, lin: Linearization, request: _Request) -> LinearModel:
    """Return the state-space model of a linearization with the requested inputs and outputs."""
    model_inputs = _resolve_inputs(model, lin, request.inputs)
    undefined = [x.quantity.name for x in model_inputs if not np.all(np.isfinite(x.force))]
    warnings = _report_undefined(undefined, "inputs", request.inputs)
    model_inputs = [x for x in model_inputs if x.quantity.name not in undefined]
    observables, columns = _resolve_outputs(lin, request.outputs)
    if lin.equations.n > _MAX_COORDINATES:
        raise BeamdaeError(
            f"linearize: the model has {lin.equations.n} coordinates, more than the "
            f"maximum of {_MAX_COORDINATES}; use fewer elements."
        )
    linear = reduce_to_states(lin, model_inputs, observables)
    is_finite = np.isfinite(np.hstack([linear.C, linear.D])).all(axis=1)
    undefined = [
        x.header for x, finite in zip(linear.outputs, is_finite, strict=True) if not finite
    ]
    undefined = [x for x in columns if x in undefined]
    warnings += _report_undefined(undefined, "outputs", request.outputs)
    linear = replace(linear, warnings=(*linear.warnings, *warnings))
    return _select_outputs(linear, [x for x in columns if x not in undefined])


def _report_undefined(
    names: Sequence[str], kind: str, requested: Sequence[str] | None
) -> list[str]:
    """Return a warning that inputs or outputs without a finite derivative are omitted, or none.

    Raises
    ------
    BeamdaeError
        If the user requested them.
    """
    if not names:
        return []
    which, reason = list_first(names, _MAX_NAMES), "the derivative is not finite at this state"
    if requested is not None:
        raise BeamdaeError(
            f"linearize: {which} cannot be one of the {kind}, because {reason}; choose others, "
            f"{_FINITE_REMEDY}."
        )
    return [
        f"{which}: omitted from the {kind} of the linear model, because {reason}; linearize about "
        f"another state, {_FINITE_REMEDY}."
    ]


class ModelInput(NamedTuple):
    """Input of a linear model.

    Attributes
    ----------
    quantity
        Name and unit, such as "push.Fy" [N]; for drivers, the prescribed acceleration.
    force
        Derivative of the residual F of the equations of motion with respect to the law, (n,).
    constraints
        Nonzero derivatives of the constraints with respect to the law, by name of the multiplier;
        empty for loads.
    indices
        Indices of the numbers `p` of the full equations that are equal to the input; empty for the
        laws of parts.
    """

    quantity: Variable
    force: Array
    constraints: dict[str, float]
    indices: tuple[int, ...] = ()


def _resolve_inputs(
    mechanism: Any, lin: Linearization, part_names: Sequence[str] | None
) -> list[ModelInput]:
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    terms = {term.name: term for term in lin.full_equations.inputs}
    candidates = {name: part for name, part in parts.items() if part.inputs} | terms
    if part_names is None:
        part_names = list(candidates)
    inputs: list[ModelInput] = []
    for name in require_sequence("linearize", "inputs", part_names, "names"):
        text = name if isinstance(name, str) else ""
        owners = [text] if text in candidates else [x for x in candidates if text.startswith(x)]
        columns: list[ModelInput] = []
        for owner in owners:
            if owner in terms:
                columns.append(_differentiate_input(terms[owner], lin))
            else:
                columns += differentiate_part_laws(mechanism, parts[owner], lin)
        quantities, selected = [x.quantity for x in columns], columns
        if text not in candidates:
            selected = [columns[k] for k in find_inputs(quantities, text)]
        if not selected:
            names = [*candidates, *(x.name for x in quantities)]
            raise BeamdaeError(
                "linearize: there is no input "
                f"{short_repr(name)}{suggest(name, names)}; use the name of an input, force, "
                "moment or driver of the mechanism, or of a column."
            )
        inputs += selected
    return inputs


def find_inputs(inputs: Sequence[Variable], name: Any) -> list[int]:
    """Return the indices of the inputs with this name or header, or else of those of this part."""
    if not isinstance(name, str):
        return []
    same = [k for k, x in enumerate(inputs) if name in (x.name, x.header)]
    return same or [k for k, x in enumerate(inputs) if x.name.startswith(f"{name}.")]


def _differentiate_input(term: InputTerm, lin: Linearization) -> ModelInput:
    """Return an input of the mechanism, with exact derivatives of all formulas that contain it."""
    e, dp = lin.equations, np.zeros(len(lin.equations.p))
    dp[[k for x in e.inputs if x.name == term.name for k in x.indices]] = 1.0
    change = differentiate_residual(e, lin.time, lin.state, dp)
    force, constraints = change[: e.n], _name_constraints(e, change[e.n :])
    if constraints and np.any(force):
        raise BeamdaeError(
            f"linearize: the input {term.name} is used both by a driver and by a force; use "
            "different inputs."
        )
    quantity = _driver_input(term.name, term.unit) if constraints else Variable(*term[:2])
    return ModelInput(quantity, force, constraints, term.indices)


def _name_constraints(e: EquationsOfMotion, change: Array) -> dict[str, float]:
    return {name: float(x) for name, x in zip(e.lam_names, change, strict=True) if x != 0.0}


def _driver_input(name: str, unit: str) -> Variable:
    return Variable(f"{name}_ddot", f"{unit}/s^2")


def differentiate_part_laws(
    mechanism: Mechanism, part: Part, lin: Linearization
) -> list[ModelInput]:
    """Return an input for each law of a load or a driver."""
    t = float(lin.time[0])
    values = [law.at(t) for law in part.laws]
    inputs = []
    for k, law_quantity in enumerate(part.inputs):
        # Loads and drivers depend linearly on their laws, so the difference is exact for any step.
        step = max(1.0, abs(values[k]))
        ends = []
        for sign in (1.0, -1.0):
            shifted = [x + (sign * step if j == k else 0.0) for j, x in enumerate(values)]
            ends.append(_part_residual(mechanism, part.with_constant_laws(shifted), lin))
        (equations, forward), (_, backward) = ends
        force, by_constraint = np.split((forward - backward) / (2.0 * step), [lin.equations.n])
        constraints = _name_constraints(equations, by_constraint)
        quantity = Variable(f"{part.name}.{law_quantity.name}", law_quantity.unit)
        if constraints:
            quantity = _driver_input(*quantity)
        inputs.append(ModelInput(quantity, force, constraints))
    return inputs


def _part_residual(
    mechanism: Mechanism, part: Part, lin: Linearization
) -> tuple[EquationsOfMotion, Array]:
    """Return the equations of one part in the coordinates of the mechanism, and their residual."""
    coordinate_map, e = map_coordinates(mechanism), lin.equations
    forces, constraints = collect_statements(part, mechanism.gravity, coordinate_map.sizes)
    equations = build_equations(
        coordinates=e.coordinates,
        q0=e.q0,
        v0=e.v0,
        length=e.length,
        parts=e.parts,
        breakpoints=(),
        time_scale=None,
        forces=forces,
        constraints=constraints,
        observables={},
        coordinate_map=coordinate_map,
    )
    state = lin.state._replace(lam=np.zeros(equations.m))
    return equations, compute_tangent(equations, lin.time, state).residual


def _resolve_outputs(
    lin: Linearization, names: Sequence[str] | None
) -> tuple[list[Observable], list[str]]:
    """Return the observables to which the named outputs belong, and the headers of the outputs."""
    observables = lin.full_equations.observables
    owners = {header: o for o in observables for header in o.headers}
    selected: dict[str, list[str]] = {o.name: o.headers for o in observables}
    for header in owners:
        selected.setdefault(header, [header])
        selected.setdefault(split_unit(header)[0], [header])
    if names is None:
        names = [o.name for o in observables if not o.is_magnitude]
    headers: list[str] = []
    for name in require_sequence("linearize", "outputs", names, "names"):
        if not isinstance(name, str) or name not in selected:
            raise BeamdaeError(
                "linearize: there is no output "
                f"{short_repr(name)}{suggest(name, selected)}; use the name of an "
                "observable or of a column."
            )
        if any(owners[header].is_magnitude for header in selected[name]):
            raise BeamdaeError(
                f"linearize: the output {name} is a largest magnitude, whose derivatives jump; use "
                "outputs with a sign, such as beam.stress(...) at one section."
            )
        headers += selected[name]
    return list({id(owners[x]): owners[x] for x in headers}.values()), headers


def _select_outputs(model: LinearModel, headers: Sequence[str]) -> LinearModel:
    """Return a linear model with these outputs, in this order."""
    available = [output.header for output in model.outputs]
    if list(headers) == available:
        return model
    rows = [available.index(header) for header in headers]
    return replace(
        model,
        C=model.C[rows],
        D=model.D[rows],
        outputs=tuple(model.outputs[k] for k in rows),
        output_values=model.output_values[rows],
    )


def reduce_to_states(
    lin: Linearization,
    inputs: Sequence[ModelInput] = (),
    observables: Sequence[Observable] = (),
) -> LinearModel:
    """Return the state-space model of independent coordinates x and rates w.

    dq = Z x and dv = Y w + W x satisfy the constraints without those of the inputs. W is nonzero
    only if constraints act on velocities; it satisfies V W = -J Z with the Jacobians J and V of
    these constraints (see `linearization`). The outputs are the columns of `observables`.
    """
    e, tangent = lin.equations, lin.tangent
    driven = [name for one in inputs for name in one.constraints]
    missing = [name for name in driven if name not in e.lam_names]
    if missing:
        raise BeamdaeError(
            f"linearize: {missing[0]} is inactive or redundant and cannot be an input; "
            "choose other inputs."
        )
    scales, nonholonomic = e.position_scales, lin.linearized_equations.nonholonomic
    by_q, by_v = tangent.position_jacobian.toarray(), tangent.velocity_jacobian.toarray()
    remains = np.array([name not in driven for name in e.lam_names], bool)
    places, z = _independent_coordinates(by_q[remains & ~nonholonomic], scales)
    velocity_rows = np.where(nonholonomic[:, None], by_v, by_q)[remains]
    rates, y = _independent_coordinates(velocity_rows, scales)
    w = np.zeros_like(z)
    if nonholonomic.any():
        right = np.where(nonholonomic[:, None], -by_q @ z, 0.0)[remains]
        w = la.lstsq(velocity_rows, right)[0]
    w = w - y @ w[rates]
    # The rates of first-order states are not independent.
    has_inertia = ~np.isin(rates, e.states)
    rates, y = rates[has_inertia], y[:, has_inertia]
    # Derivatives with respect to (x, w, u), by columns.
    n_states = len(places) + len(rates)
    dq = np.hstack([z, np.zeros((e.n, len(rates) + len(inputs)))])
    dv = np.hstack([w, y, np.zeros((e.n, len(inputs)))])
    by_inputs = np.zeros((e.n + e.m, dq.shape[1]))
    for k, one in enumerate(inputs, n_states):
        by_inputs[: e.n, k] = one.force
        for name, size in one.constraints.items():
            by_inputs[e.n + e.lam_names.index(name), k] = size
    # The rows of first-order states are x' - f.
    forces = tangent.stiffness @ dq + tangent.damping @ dv + by_inputs[: e.n]
    dv[e.states] -= forces[e.states]
    right = -by_inputs
    right[: e.n] -= tangent.stiffness @ dq + tangent.damping @ dv
    right[e.n :][nonholonomic] -= by_q[nonholonomic] @ dv
    solve = solve_for_accelerations(e, tangent)
    solution = np.stack([solve(column) for column in right.T], axis=1)
    da, dlam = solution[: e.n], solution[e.n :]
    derivatives = np.vstack([dv[places], da[rates]])
    if lin.rotation is not None:
        # Observables are functions of velocities in the inertial frame.
        generator = RotatingCoordinates.from_equations(e).generator
        dv = dv + lin.rotation.speed * (generator @ dq)
    dp = np.zeros((len(lin.full_equations.p), dq.shape[1]))
    for k, one in enumerate(inputs, n_states):
        change = np.eye(dq.shape[1])[k]
        for name, size in one.constraints.items():
            # The displacement of a driver depends on the states.
            change = -by_q[e.lam_names.index(name)] @ dq / size
        dp[list(one.indices)] = change
    outputs, values, names = _differentiate_outputs(lin, observables, dq, dv, da, dlam, dp)
    coordinates = [e.coordinates[k] for k in places]
    return LinearModel(
        derivatives[:, :n_states],
        derivatives[:, n_states:],
        outputs[:, :n_states],
        outputs[:, n_states:],
        (*coordinates, *(e.coordinates[k].rate for k in rates)),
        tuple(one.quantity for one in inputs),
        names,
        np.concatenate([lin.state.q[places], lin.state.v[rates]]),
        values,
        lin.about,
        lin.warnings,
        lin if e.mechanism is not None else None,
        _motions=dq[:, :n_states],
    )


def _differentiate_outputs(
    lin: Linearization,
    observables: Sequence[Observable],
    dq: Array,
    dv: Array,
    da: Array,
    dlam: Array,
    dp: Array,
) -> tuple[Array, Array, tuple[Variable, ...]]:
    """Return the Jacobian of the outputs, their values, and their names and units.

    The changes of coordinates, velocities, accelerations, multipliers and numbers, by columns,
    belong to (x, w, u).
    """
    e, full = lin.equations, lin.full_equations
    # Multipliers of inactive or redundant constraints are zero: row -1 is the appended zero.
    known = {name: k for k, name in enumerate(e.lam_names)}
    rows = np.array([known.get(name, -1) for name in full.lam_names], int)
    lam = np.append(lin.state.lam, 0.0)[rows]
    dlam = np.vstack([dlam, np.zeros((1, dlam.shape[1]))])[rows]
    # The changes of accelerations omit those of the constraints along a motion.
    moves = lin.rotation is not None or np.any(lin.state.v) or np.any(lin.state.a)
    derivatives, values, names = [np.zeros((0, dq.shape[1]))], [np.zeros(0)], []
    for o in observables:
        if full.redundant and o.rows.stop > o.rows.start and e.m < full.m:
            raise BeamdaeError(
                f"linearize: {o.name} cannot be an output because the linear model does not "
                "determine reactions of redundant joints; choose other outputs."
            )
        if o.has_accelerations and moves:
            frame = "in a rotating frame" if lin.rotation is not None else "of a moving state"
            raise BeamdaeError(
                f"linearize: {o.name} cannot be an output {frame}, because it depends on "
                "accelerations; choose other outputs, or linearize about='equilibrium'."
            )
        q, v, a = (o.operator @ x for x in lin.state[:3])
        arguments = [lin.time, q, v, full.p[o.data], lam[o.rows], *[a] * o.has_accelerations]
        changes = [o.operator @ dq, o.operator @ dv, dp[o.data], dlam[o.rows], o.operator @ da]
        _, *jacobians = o.function.jacobians(*arguments)
        pairs = zip(jacobians, changes, strict=False)
        derivatives.append(np.sum([_apply_derivative(*pair) for pair in pairs], axis=0))
        values.append(o.function(*(x[None] for x in arguments))[0])
        for column in o.columns:
            name = ".".join(filter(None, (o.name, column.name)))
            names.append(Variable(name, column.unit))
    return np.vstack(derivatives), np.concatenate(values), tuple(names)


def _apply_derivative(derivative: Array, changes: Array) -> Array:
    """Return the product, in which derivatives with respect to constants may be infinite.

    An example is the force of an open contact as a function of its exponent.
    """
    is_variable = np.any(changes, axis=1)
    with np.errstate(invalid="ignore"):  # Outputs that are not finite are omitted later.
        return np.asarray(derivative[:, is_variable] @ changes[is_variable])


def _independent_coordinates(rows: Array, scales: Array) -> tuple[Array, Array]:
    """Return the indices of independent coordinates, and the matrix Z with rows @ Z = 0.

    Every dq with rows @ dq = 0 equals Z @ dq[indices]. The indices are chosen by QR factorization
    with column pivoting of the scaled rows.
    """
    n = rows.shape[1]
    matrix = rows * scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    triangle, order = la.qr(matrix, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > RANK_TOLERANCE * np.max(diagonal, initial=0.0)))
    dependent, independent = order[:rank], np.sort(order[rank:])
    by_index = np.argsort(order[rank:])
    z = np.zeros((n, n - rank))
    z[independent, np.arange(n - rank)] = 1.0
    if rank:
        shares = la.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
        z[dependent] = -(scales[dependent, None] * shares / scales[order[rank:]])[:, by_index]
    return independent, z
