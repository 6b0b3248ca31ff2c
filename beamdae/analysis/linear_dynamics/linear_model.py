"""Linear state-space models x' = A x + B u, y = C x + D u of a mechanism about a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import scipy
import scipy.linalg as la

from beamdae import deferred
from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import (
    REFERENCE,
    Linearization,
    linearize_about,
    model_of_modes,
    searched_start,
    solve_for_accelerations,
)
from beamdae.equations.assembly.building import Statements, build_terms
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.assembly.statement_checks import collect_statements
from beamdae.equations.equations_of_motion import EquationsOfMotion, InputTerm, Observable
from beamdae.equations.formulations.tangents import compute_tangent, differentiate_residual
from beamdae.equations.starts.dependent_constraints import normalize_rows, select_independent_rows
from beamdae.equations.starts.steady_rotation import RotatingCoordinates
from beamdae.errors import (
    BeamdaeError,
    format_count,
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
from beamdae.results.columns import select_observed_columns
from beamdae.results.displays import HasPage
from beamdae.symbolic.statements import Variable

Array = np.ndarray

Matrices = tuple[Array, Array, Array, Array]

# State matrices are dense; memory grows with the square of the number of coordinates.
_MAX_COORDINATES = 2000
# Smaller shares of the products of absolute values are rounding errors: half of the digits cancel.
_NOISE_SHARE = float(np.sqrt(np.finfo(float).eps))
# Smaller shares of the product of norms are rounding errors of the inverse.
_NORM_SHARE = 10.0 * float(np.finfo(float).eps)
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
    _linearization: Linearization = field(repr=False)
    _request: _Request | None = field(default=None, repr=False)

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

        They are those of `modes`, not of the matrix, whose rounding errors exceed the slow ones of
        stiff structures. Free motions, and drivers among the inputs, are pairs of zeros; so are
        decays that rounding hides, 1e13 times as fast as slow modes.
        """
        lin = self._linearization.linearized_equations
        upper = solve_eigenproblem(lin, None).values
        upper = upper[upper != 0.0]
        lower = -upper if lin.is_conservative else upper[upper.imag > 0.0].conj()
        zeros = np.zeros(len(self.states) - len(upper) - len(lower))
        poles = np.concatenate([zeros, upper, lower]) + 0.0
        return poles[np.argsort(np.abs(poles), kind="stable")]

    @single_threaded
    def state_space(self, every: float | None = None) -> scipy.signal.StateSpace:
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
        if every is None:
            return scipy.signal.StateSpace(self.A, self.B, self.C, self.D)
        step = require_positive("state_space", "every", every)
        # Elements of A of stiff structures differ so much that the exponential needs balancing.
        balanced, (scale, _) = la.matrix_balance(self.A, permute=False, separate=True)
        rows = scale[:, None]
        with np.errstate(all="ignore"):
            a, b, *_ = scipy.signal.cont2discrete((balanced, self.B / rows, self.C, self.D), step)
        a, b = rows * a / scale, rows * b
        if not (np.isfinite(a).all() and np.isfinite(b).all()):
            raise BeamdaeError(
                f"state_space: an unstable motion exceeds the range of numbers within {step:g} s; "
                "use a shorter interval."
            )
        return scipy.signal.StateSpace(a, b, self.C, self.D, dt=step)

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
            If errors exceed 4 % of the frequency or the largest magnitude (see `Bode.errors`),
            which are measured unless warnings are filtered out.
        """
        values = [
            require_finite("frequency_response", "frequencies", f)
            for f in require_sequence(
                "frequency_response", "frequencies", frequencies, "a list [Hz]"
            )
        ]
        response = self.evaluate_response(values)
        if values and not warnings_are_ignored():
            for sentence in self.measure_errors(np.array(values), response).sentences():
                # The response is an array, whose warnings cannot be read later.
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

    def bound_rounding(self, frequencies: Array) -> Array:
        """Return a bound of rounding errors of the transfer matrix near frequencies [Hz].

        It is the median of the larger one of two bounds, which are not zero where the response is
        zero by symmetry: 1.5e-8 of |C| |(i w I - A)^-1| |B| with absolute values of all elements,
        and 2.2e-15 of the product of the norms of C (i w I - A)^-1 and B, which depends on the
        units of states.
        """
        identity = np.eye(len(self.A))
        system = self.A, identity, identity, np.zeros_like(identity)
        inverses = np.array([transfer_matrix(system, 2j * np.pi * f) for f in frequencies])
        bounds = _NOISE_SHARE * np.abs(self.C) @ np.abs(inverses) @ np.abs(self.B)
        # Errors of stiff elements reach states that they do not move.
        gains = np.linalg.norm(self.C @ inverses, axis=2)[:, :, None]
        norms = _NORM_SHARE * gains * np.linalg.norm(self.B, axis=0)
        return np.asarray(np.median(np.maximum(bounds, norms), axis=0))

    def evaluate_response(self, values: Sequence[float]) -> Array:
        """Return the transfer matrix at frequencies [Hz], (k, outputs, inputs).

        Raises
        ------
        BeamdaeError
            If it is infinite at one of them.
        """
        responses = [
            transfer_matrix((self.A, self.B, self.C, self.D), 2j * np.pi * f) for f in values
        ]
        response = np.reshape(responses, (len(values), *self.D.shape)).astype(complex)
        is_finite = np.isfinite(response).all(axis=(1, 2))
        if not is_finite.all():
            raise BeamdaeError(
                f"frequency_response: the response at {values[int(np.argmin(is_finite))]:g} Hz is "
                "infinite because an undamped mode or a free motion has this frequency; choose "
                "other frequencies."
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
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
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
    warn_of_result(linear.warnings, linear._linearization.equations.build_warnings)
    if not warnings_are_ignored():
        warn_of_result(linear.errors.sentences())
    return linear


def require_linear_model(name: str, model: Any) -> None:
    """Reject models that `linearize` did not return; `name` is that of the calling function."""
    if not isinstance(model, LinearModel):
        raise BeamdaeError(
            f"{name}: model must be a result of linearize, got {short_repr(model)}; pass "
            "linearize(model)."
        )


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
    """Return the state-space model of a linearization with the requested inputs and outputs.

    Those without a finite derivative are omitted with a warning, or rejected if they are requested.
    """
    inputs = _resolve_inputs(model, lin, request.inputs)
    observables, headers = _resolve_outputs(lin, request.outputs)
    if lin.equations.n > _MAX_COORDINATES:
        raise BeamdaeError(
            f"linearize: the model has {lin.equations.n} coordinates, more than the "
            f"maximum of {_MAX_COORDINATES}; use fewer elements."
        )
    linear = reduce_to_states(lin, inputs, observables)
    place = {output.header: k for k, output in enumerate(linear.outputs)}
    rows, warnings = np.array([place[x] for x in headers], int), list(linear.warnings)
    columns = np.isfinite(linear.B).all(axis=0)
    outputs = np.hstack([linear.C, linear.D[:, columns]])[rows]
    is_finite = np.isfinite(outputs).all(axis=1)
    undefined = (
        ("inputs", [x.name for x in linear.inputs], columns, request.inputs),
        ("outputs", headers, is_finite, request.outputs),
    )
    for kind, names, are_finite, requested in undefined:
        if are_finite.all():
            continue
        which = list_first([x for x, y in zip(names, are_finite, strict=True) if not y])
        reason = "the derivative is not finite at this state"
        if requested is not None:
            raise BeamdaeError(
                f"linearize: {which} cannot be one of the {kind}, because {reason}; choose others, "
                f"{_FINITE_REMEDY}."
            )
        warnings.append(
            f"{which}: omitted from the {kind} of the linear model, because {reason}; linearize "
            f"about another state, {_FINITE_REMEDY}."
        )
    rows = rows[is_finite]
    return replace(
        linear,
        B=linear.B[:, columns],
        C=linear.C[rows],
        D=linear.D[rows][:, columns],
        inputs=tuple(x for x, y in zip(linear.inputs, columns, strict=True) if y),
        outputs=tuple(linear.outputs[k] for k in rows),
        output_values=linear.output_values[rows],
        warnings=tuple(warnings),
    )


class ModelInput(NamedTuple):
    """Input of a linear model.

    Attributes
    ----------
    owner
        Name of the input, the load or the driver.
    quantity
        Name and unit, such as "push.Fy" [N]; for drivers, the prescribed acceleration.
    change
        Derivative of forces and constraints with respect to the law, (n + m,).
    indices
        Indices of the numbers `p` of the full equations that are equal to the input; empty for the
        laws of parts.
    """

    owner: str
    quantity: Variable
    change: Array
    indices: tuple[int, ...] = ()


def _resolve_inputs(
    mechanism: Any, lin: Linearization, names: Sequence[str] | None
) -> list[ModelInput]:
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    terms = {term.name: term for term in lin.full_equations.inputs}
    candidates = {name: part for name, part in parts.items() if part.inputs} | terms
    names = list(candidates) if names is None else names
    inputs: list[ModelInput] = []
    for name in require_sequence("linearize", "inputs", names, "names"):
        columns: list[ModelInput] = []
        for owner in candidates:
            if not isinstance(name, str) or not name.startswith(owner):
                continue
            if owner in terms:
                columns.append(_differentiate_input(terms[owner], lin))
            else:
                columns += differentiate_part_laws(mechanism, parts[owner], lin)
        found = [x for x in columns if name in (x.owner, x.quantity.name, x.quantity.header)]
        if not found:
            choices = [*candidates, *(x.quantity.name for x in columns)]
            raise BeamdaeError(
                "linearize: there is no input "
                f"{short_repr(name)}{suggest(name, choices)}; use the name of an input, force, "
                f"moment or driver of the mechanism ({list_first(list(candidates))}), "
                "or of a column."
            )
        inputs += found
    return inputs


def _differentiate_input(term: InputTerm, lin: Linearization) -> ModelInput:
    """Return an input of the mechanism, with exact derivatives of all formulas that contain it."""
    e, dp = lin.equations, np.zeros(len(lin.equations.p))
    dp[[k for x in e.inputs if x.name == term.name for k in x.indices]] = 1.0
    change = differentiate_residual(e, lin.time, lin.state, dp)
    return _create_input(term.name, Variable(*term[:2]), e, change, term.indices)


def _create_input(
    owner: str, law: Variable, e: EquationsOfMotion, change: Array, indices: tuple[int, ...] = ()
) -> ModelInput:
    """Return an input whose law changes the residual of equations by `change`, (n + m,)."""
    if not change[e.n :].any():
        return ModelInput(owner, law, change, indices)
    if change[: e.n].any():
        raise BeamdaeError(
            f"linearize: the input {owner} is used both by a driver and by a force; use "
            "different inputs."
        )
    acceleration = Variable(f"{law.name}_ddot", f"{law.unit}/s^2")
    return ModelInput(owner, acceleration, change, indices)


def differentiate_part_laws(
    mechanism: Mechanism, part: Part, lin: Linearization
) -> list[ModelInput]:
    """Return an input for each law of a load or a driver, which depend linearly on their laws."""
    at_zero = _part_residual(mechanism, part, [0.0] * len(part.inputs), lin)
    inputs = []
    for law, values in zip(part.inputs, np.eye(len(part.inputs)).tolist(), strict=True):
        change = _part_residual(mechanism, part, values, lin) - at_zero
        quantity = Variable(f"{part.name}.{law.name}", law.unit)
        inputs.append(_create_input(part.name, quantity, lin.equations, change))
    return inputs


def _part_residual(
    mechanism: Mechanism, part: Part, laws: Sequence[float], lin: Linearization
) -> Array:
    """Return the residual of one part with constant laws, (n + m,)."""
    coordinate_map, e = map_coordinates(mechanism), lin.equations
    law = laws[0] if len(laws) == 1 else tuple(laws)
    part = replace(cast("Any", part), law=law)
    forces, constraints = collect_statements(part, mechanism.gravity, coordinate_map.sizes)
    terms = build_terms(Statements(forces, constraints), e.coordinates, e.parts, coordinate_map)
    equations = EquationsOfMotion(
        coordinates=e.coordinates,
        q0=e.q0,
        v0=e.v0,
        length=e.length,
        parts=e.parts,
        breakpoints=(),
        time_scale=None,
        **vars(terms),
    )
    state = lin.state._replace(lam=np.zeros(equations.m))
    residual = compute_tangent(equations, lin.time, state).residual
    row_of = {name: k for k, name in enumerate(e.lam_names, e.n)}
    if missing := [name for name in equations.lam_names if name not in row_of]:
        raise BeamdaeError(
            f"linearize: {missing[0]} is inactive or redundant and cannot be an input; "
            "choose other inputs."
        )
    total = np.zeros(e.n + e.m)
    total[[*range(e.n), *(row_of[name] for name in equations.lam_names)]] = residual
    return total


def _resolve_outputs(
    lin: Linearization, names: Sequence[str] | None
) -> tuple[list[Observable], list[str]]:
    """Return the observables to which the named outputs belong, and the headers of the outputs."""
    owners = {header: o for o in lin.full_equations.observables for header in o.headers}
    headers = [header for header, o in owners.items() if not o.is_magnitude]
    if names is not None:
        given = require_sequence("linearize", "outputs", names, "names")
        headers = select_observed_columns("linearize", given, list(owners))
    for header in headers:
        if owners[header].is_magnitude:
            raise BeamdaeError(
                f"linearize: the output {header} is a largest magnitude, whose derivatives jump; "
                "use outputs with a sign, such as beam.stress(...) at one section."
            )
    return list({owners[x].name: owners[x] for x in headers}.values()), headers


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
    by_inputs = np.reshape([x.change for x in inputs], (len(inputs), e.n + e.m)).T
    remains = ~by_inputs[e.n :].any(axis=1)
    by_q, by_v = tangent.position_jacobian.toarray(), tangent.velocity_jacobian.toarray()
    rolling = np.isin(np.arange(e.m), e.nonholonomic_rows)
    places, z = _independent_coordinates(by_q[remains & ~rolling], e.position_scales)
    velocity_rows = np.where(rolling[:, None], by_v, by_q)[remains]
    rates, y = _independent_coordinates(velocity_rows, e.position_scales)
    w = np.zeros_like(z)
    if rolling.any():
        right = np.where(rolling[:, None], -by_q @ z, 0.0)[remains]
        w = la.lstsq(velocity_rows, right)[0]
    w = w - y @ w[rates]
    # The rates of first-order states are not independent.
    has_inertia = ~np.isin(rates, e.states)
    rates, y = rates[has_inertia], y[:, has_inertia]
    # Derivatives with respect to (x, w, u), by columns.
    n_states = len(places) + len(rates)
    size = n_states + len(inputs)
    dq = np.hstack([z, np.zeros((e.n, size - len(places)))])
    dv = np.hstack([w, y, np.zeros((e.n, len(inputs)))])
    by_inputs = np.hstack([np.zeros((e.n + e.m, n_states)), by_inputs])
    dp = np.zeros((len(lin.full_equations.p), size))
    for k, one in enumerate(inputs, n_states):
        change, driven = np.eye(size)[k], np.flatnonzero(one.change[e.n :])
        for row in driven:
            # The displacement of a driver depends on the states.
            change = -by_q[row] @ dq / one.change[e.n + row]
        dp[list(one.indices)] = change
    # The rows of first-order states are x' - f.
    forces = tangent.stiffness @ dq + tangent.damping @ dv + by_inputs[: e.n]
    dv[e.states] -= forces[e.states]
    right = -by_inputs
    right[: e.n] -= tangent.stiffness @ dq + tangent.damping @ dv
    right[e.n :][rolling] -= by_q[rolling] @ dv
    solve = solve_for_accelerations(e, tangent)
    da, dlam = np.split(np.stack([solve(column) for column in right.T], axis=1), [e.n])
    derivatives = np.vstack([dv[places], da[rates]])
    if lin.rotation is not None:
        # Observables are functions of velocities in the inertial frame.
        generator = RotatingCoordinates.from_equations(e).generator
        dv = dv + lin.rotation.speed * (generator @ dq)
    outputs, values, names = _differentiate_outputs(lin, observables, dq, dv, da, dlam, dp)
    return LinearModel(
        derivatives[:, :n_states],
        derivatives[:, n_states:],
        outputs[:, :n_states],
        outputs[:, n_states:],
        (*(e.coordinates[k] for k in places), *(e.coordinates[k].rate for k in rates)),
        tuple(one.quantity for one in inputs),
        names,
        np.concatenate([lin.state.q[places], lin.state.v[rates]]),
        values,
        lin.about,
        lin.warnings,
        lin,
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
    row_of = {name: k for k, name in enumerate(e.lam_names)}
    rows = np.array([row_of.get(name, -1) for name in full.lam_names], int)
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
        names += [Variable(*split_unit(header)) for header in o.headers]
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
    if not len(rows):
        return np.arange(len(scales)), np.eye(len(scales))
    columns = select_independent_rows(normalize_rows(rows * scales)[0].T)
    dependent, independent = columns.independent, columns.dependent
    z = np.zeros((len(scales), len(independent)))
    z[independent, np.arange(len(independent))] = 1.0
    z[dependent] = -scales[dependent, None] * columns.coefficients.T / scales[independent]
    return independent, z
