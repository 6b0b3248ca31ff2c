"""Numbers of the equations as exact functions of inputs and model parameters.

A number p may depend on parameters x, y, ... through products of powers,

    p = sum over subsets T of {x, y, ...} of c_T prod_{x in T} x^e_x,

such as stiffness E w h^3 / 12 with its thickness h. Exponents and coefficients are found by
building the model with other values, and verified with further values. Everything else is rejected.
The range of each parameter is the range for which the model can be built and has these numbers.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations, product

import casadi as ca
import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import BeamdaeError, format_exception
from beamdae.export.model_source import NumberMap, Value
from beamdae.model_checks.contacts import starts_in_equilibrium

Array = np.ndarray
SX = ca.SX
# Equations and consistent start for values of parameters.
Build = Callable[[dict[str, float]], tuple[EquationsOfMotion, State]]

# Relative changes of a parameter at which exponents are determined, and verified together.
_CHANGES = (0.25, -0.2, 0.1)
_VERIFIED_CHANGES = ((0.13, -0.07), (-0.11, 0.19))
# Factors of all changes above, tried in this order, for models that reject the larger values.
_CHANGE_SCALES = (1.0, 0.1, 0.01)
# Change instead of a relative change for a parameter with the value zero.
_CHANGE_FROM_ZERO = 1.0
_EXPONENTS = (1, 2, 3, 4, -1, -2, -3)
# Changes of one parameter that are built before its limits are searched.
_SMALL_DECREASES, _SMALL_INCREASES = (-0.11, -0.2), (0.13, 0.25)
# Further values of the search, relative to the default (to 1 for zero). It ends at the first value
# that is rejected.
_FACTORS_DOWN = (0.5, 0.1, 1e-3, 1e-6, 0.0, -1e-3, -1.0, -1e3, -1e6)
_FACTORS_UP = (2.0, 10.0, 1e3, 1e6)
# Numbers with the default zero are rarely negative: the first value is small.
_FACTORS_BELOW_ZERO = (-1e-3, -0.25, -2.0, -10.0, -1e3, -1e6)
# Bisection between the last value that is accepted and the first that is rejected.
_MAX_BISECTIONS = 8
_LIMIT_ACCURACY = 0.01  # relative to the limit
# Difference of equal numbers, relative to the largest number of the same index.
_ROUNDING = 1e-11
# Change of the start, relative to max(1, largest coordinate).
_START_ROUNDING = 1e-10


def map_numbers(
    part: str,
    build: Build,
    equations: EquationsOfMotion,
    state: State,
    inputs: Sequence[tuple[Value, Array]],
    parameters: Mapping[str, float],
) -> NumberMap:
    """Return the numbers that depend on inputs and parameters.

    Parameters
    ----------
    part
        Name of the calling function, for messages.
    build
        Function of values of parameters.
    equations, state
        Equations and consistent start with the default values.
    inputs
        Inputs, each with the indices of the numbers that are equal to it.
    parameters
        Default values by name.

    Raises
    ------
    BeamdaeError
        If the numbers depend on a parameter in another way, or a parameter changes the structure
        of the equations or the start of the run.
    """
    samples = _Samples(part, build, equations, state, parameters)
    symbols = SX.sym("values", len(inputs) + len(parameters))
    targets: list[int] = []
    expressions: list[SX] = []
    for k, (_, indices) in enumerate(inputs):
        targets += indices.tolist()
        expressions += [symbols[k]] * len(indices)
    exponents = [_find_exponents(samples, name) for name in parameters]
    by_name = dict(zip(parameters, ca.vertsplit(symbols)[len(inputs) :], strict=True))
    is_input = set(targets)
    for index in sorted(set(chain.from_iterable(exponents)) - is_input):
        powers = {
            name: by_index[index]
            for name, by_index in zip(parameters, exponents, strict=True)
            if index in by_index
        }
        targets.append(index)
        expressions.append(_fit_number(samples, index, powers, by_name))
    numbers = ca.vertcat(SX(0, 1), *expressions)
    values = [value for value, _ in inputs]
    values += [Value(name, "-", x, is_input=False) for name, x in parameters.items()]
    number_map = NumberMap(tuple(values), symbols, np.array(targets, int), numbers)
    check = _NumberCheck(samples, number_map, len(inputs))
    _verify(samples, check)
    for k, name in enumerate(parameters, len(inputs)):
        low, high = _find_limits(samples, check, name)
        values[k] = replace(values[k], low=low, high=high)
    return replace(number_map, values=tuple(values))


class _RejectedValuesError(BeamdaeError):
    """Raised if a model cannot be built with other values of its parameters."""


class _Samples:
    """Numbers p for values of parameters, cached."""

    def __init__(
        self,
        part: str,
        build: Build,
        equations: EquationsOfMotion,
        state: State,
        parameters: Mapping[str, float],
    ) -> None:
        self.part, self.parameters = part, dict(parameters)
        self._build, self._equations, self._state = build, equations, state
        self._numbers: dict[tuple[float, ...], Array] = {tuple(parameters.values()): equations.p}
        self._scales = dict.fromkeys(parameters, 1.0)
        for name in parameters:
            self._reduce_changes(name)

    def _reduce_changes(self, name: str) -> None:
        """Set the scale of the changes of a parameter so that the model accepts them."""
        for scale in _CHANGE_SCALES:
            self._scales[name] = scale
            try:
                for change in _CHANGES:
                    self.numbers({name: self.changed_value(name, change)})
                return
            except _RejectedValuesError:
                if scale == _CHANGE_SCALES[-1]:
                    raise

    def changed_value(self, name: str, change: float) -> float:
        """Return the value of a parameter after a relative change, which may be reduced."""
        value, change = self.parameters[name], change * self._scales[name]
        # Numbers with the default zero, such as dampings, are rarely negative.
        return value * (1.0 + change) if value else abs(change) * _CHANGE_FROM_ZERO

    def numbers(self, changes: Mapping[str, float]) -> Array:
        """Return p with these values, and all others at their defaults."""
        values = {**self.parameters, **changes}
        key = tuple(values.values())
        if key not in self._numbers:
            try:
                e, state = self._build(values)
            except Exception as problem:  # of the model function, whatever it raises
                listed = ", ".join(f"{name} = {value:g}" for name, value in changes.items())
                raise _RejectedValuesError(
                    f"{self.part}: the model cannot be built with {listed} "
                    f"({format_exception(problem)}); choose defaults inside the limits of the "
                    "model, or export fewer parameters."
                ) from problem
            first, what = self._equations, ""
            if e.structure != first.structure or len(e.p) != len(first.p):
                what = "the structure of the equations, such as its mesh or geometry"
            elif e.breakpoints != first.breakpoints or not np.array_equal(
                e.position_scales, first.position_scales
            ):
                what = "the times of breakpoints or the size of the mechanism"
            else:
                for new, old in ((state.q, self._state.q), (state.v, self._state.v)):
                    size = max(1.0, float(np.max(np.abs(old), initial=0.0)))
                    if np.max(np.abs(new - old), initial=0.0) > _START_ROUNDING * size:
                        what = "positions or velocities at the start"
                        if starts_in_equilibrium(first):
                            what += ", which is the equilibrium of the model"
            if what:
                raise BeamdaeError(
                    f"{self.part}: changes of {', '.join(changes)} affect {what}; export only "
                    "parameters that change nothing but numbers of the equations."
                )
            self._numbers[key] = e.p
        return self._numbers[key]


def _find_exponents(samples: _Samples, name: str) -> dict[int, int]:
    """Return the exponent of a parameter in each number that depends on it, by index."""
    at_default = samples.numbers({})
    x0 = samples.parameters[name]
    points = [samples.changed_value(name, change) for change in _CHANGES]
    rows = np.array([samples.numbers({name: x}) for x in points])
    size = np.maximum(np.abs(at_default), np.abs(rows).max(axis=0))
    (depends,) = np.nonzero(np.any(np.abs(rows - at_default) > _ROUNDING * size, axis=0))
    exponents: dict[int, int] = {}
    for index in depends.tolist():
        differences = rows[:, index] - at_default[index]
        for exponent in _EXPONENTS:
            if exponent < 0 and x0 == 0.0:
                continue
            steps = np.array([x**exponent - x0**exponent for x in points])
            coefficient = differences[0] / steps[0]
            if np.all(np.abs(differences - coefficient * steps) <= _ROUNDING * size[index]):
                exponents[index] = exponent
                break
        else:
            raise BeamdaeError(
                f"{samples.part}: numbers of the model depend on the parameter {name}, but not "
                "through a power of it; export the model without this parameter."
            )
    return exponents


def _fit_number(
    samples: _Samples, index: int, powers: dict[str, int], symbols: dict[str, SX]
) -> SX:
    """Return number p[index] as a sum of products of powers of parameters."""
    names = list(powers)
    points = {name: (samples.parameters[name], samples.changed_value(name, 0.25)) for name in names}
    matrix = np.ones((1, 1))
    for name in names:
        columns = [[1.0, x ** powers[name]] for x in points[name]]
        matrix = np.kron(matrix, np.array(columns))
    values = [
        samples.numbers(dict(zip(names, choice, strict=True)))[index]
        for choice in product(*(points[name] for name in names))
    ]
    coefficients = np.linalg.solve(matrix, np.array(values))
    terms = np.abs(matrix[0] * coefficients)
    expression = SX(0)
    # In the order of the Kronecker products, the last name varies fastest.
    for k, is_in_term in enumerate(product((False, True), repeat=len(names))):
        if terms[k] > _ROUNDING * max(terms.max(), abs(values[0])) or terms.max() == 0.0:
            factor = SX(coefficients[k])
            for name, is_factor in zip(names, is_in_term, strict=True):
                if is_factor:
                    factor = factor * symbols[name] ** powers[name]
            expression = expression + factor
    return expression


class _NumberCheck:
    """Comparison of the map with the numbers of models that are built with other values."""

    def __init__(self, samples: _Samples, number_map: NumberMap, n_inputs: int) -> None:
        self._samples, self._targets = samples, number_map.targets
        self._inputs = [value.start for value in number_map.values[:n_inputs]]
        expressions = [ca.densify(number_map.numbers)]
        self._function = ca.Function("numbers", [number_map.symbols], expressions)

    def agrees(self, values: Mapping[str, float]) -> bool:
        """Return True if the map gives the numbers of the model with these values."""
        samples = self._samples
        expected, default = samples.numbers(values), samples.numbers({})
        result = self._function(self._inputs + list({**samples.parameters, **values}.values()))
        numbers = np.array(default)
        numbers[self._targets] = np.array(result).ravel()
        size = np.maximum(np.abs(expected), np.abs(default))
        return bool(np.all(np.abs(numbers - expected) <= 10.0 * _ROUNDING * size))


def _verify(samples: _Samples, check: _NumberCheck) -> None:
    """Require that the map gives the numbers of models with other values of all parameters."""
    names = list(samples.parameters)
    subsets = [(name,) for name in names] + list(combinations(names, 2)) + [tuple(names)]
    for subset in dict.fromkeys(x for x in subsets if x):
        for changes in _VERIFIED_CHANGES:
            values = {x: samples.changed_value(x, changes[k % 2]) for k, x in enumerate(subset)}
            if not check.agrees(values):
                raise BeamdaeError(
                    f"{samples.part}: numbers of the model do not depend on the parameters "
                    f"{', '.join(subset)} through products of powers; export the model without "
                    "these parameters."
                )


def _find_limits(samples: _Samples, check: _NumberCheck, name: str) -> tuple[float, float]:
    """Return the smallest and the largest value of a parameter; infinite without a limit."""
    default = samples.parameters[name]

    def is_possible(value: float) -> bool:
        # Warnings about such values are not those of the exported model.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return check.agrees({name: value})
            except Exception:  # of the model function, whatever it raises for impossible values
                return False

    def find_limit(values: Sequence[float]) -> float:
        accepted = default
        for value in values:
            if not is_possible(value):
                return bisect(accepted, value)
            accepted = value
        return math.copysign(math.inf, accepted)

    def bisect(accepted: float, rejected: float) -> float:
        # Ratios of the values are bisected; next to zero, the accepted value is close enough.
        if accepted * rejected <= 0.0:
            return accepted
        for _ in range(_MAX_BISECTIONS):
            if abs(rejected - accepted) <= _LIMIT_ACCURACY * abs(accepted):
                break
            middle = math.copysign(math.sqrt(accepted * rejected), accepted)
            if is_possible(middle):
                accepted = middle
            else:
                rejected = middle
        # Limits of models are mostly round numbers, which users expect to be accepted.
        rounded = _round_between(accepted, rejected)
        return rounded if is_possible(rounded) else accepted

    size = default or 1.0
    up = [samples.changed_value(name, x) for x in _SMALL_INCREASES]
    up += [size * x for x in _FACTORS_UP]
    down = [samples.changed_value(name, x) for x in _SMALL_DECREASES] if default else []
    down += [size * x for x in (_FACTORS_DOWN if default else _FACTORS_BELOW_ZERO)]
    ends = find_limit(down), find_limit(up)
    return min(ends), max(ends)


def _round_between(a: float, b: float) -> float:
    """Return a number between a and b with as few digits as possible."""
    middle = 0.5 * (a + b)
    rounded = (float(f"{middle:.{digits}g}") for digits in range(1, 17))
    return next((x for x in rounded if min(a, b) < x < max(a, b)), a)
