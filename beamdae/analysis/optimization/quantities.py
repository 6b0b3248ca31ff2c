"""Quantities of a design: functions of the parameters of a model that can be differentiated."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beamdae.analysis.gradients.objectives import (
    AnalysisQuantity,
    Quantity,
    measure_norm,
    read_numbers,
    require_deviations,
    require_exponent,
)
from beamdae.errors import (
    BeamdaeError,
    as_text,
    require_choice,
    require_count,
    require_finite,
    require_mapping,
    require_sequence,
    require_unit,
    set_fields,
    short_repr,
)
from beamdae.model_parameters import parse_quantity

Array = np.ndarray

_MAX_NUMBER = 10_000
# Kinds of analyses.
EQUILIBRIUM_PATH, MODES, MASS, PARAMETERS = "path", "modes", "mass", "parameters"


@dataclass(frozen=True, eq=False)
class LargestOf(Quantity):
    """Smooth upper bound of the largest magnitude of several quantities.

    With the exponent p, the value is (sum |y_k|^p)^(1/p). It is not less than the largest |y_k| of
    N quantities and exceeds it at most by the factor N^(1/p), 6 % for N = 10 and p = 40. Use it for
    a limit of the stress at several sections, which is then satisfied at each of them. The gradient
    of `LargestOf` takes about as long as that of one stress.

    Attributes
    ----------
    quantities
        Quantities with the same unit.
    exponent
        The exponent p, between 1 and 1000. Larger exponents are closer to the maximum, but the
        derivative then changes abruptly if another quantity becomes the largest.

    Examples
    --------
    >>> import beamdae as bd
    >>> values = [bd.quantities.EquilibriumValue(f"stress {k}") for k in range(3)]
    >>> bd.quantities.LargestOf(values).label
    'largest of 3: stress 0 at equilibrium, ...'
    """

    quantities: Any
    exponent: float = 40.0

    def __post_init__(self) -> None:
        entries = require_sequence(
            "LargestOf", "quantities", self.quantities, "a list of quantities"
        )
        if not entries:
            raise BeamdaeError("LargestOf: quantities is empty; pass at least one quantity.")
        p = require_exponent("LargestOf", self.exponent)
        quantities = tuple(as_quantity("LargestOf: quantities", x) for x in entries)
        more = ", ..." if len(quantities) > 1 else ""
        label = f"largest of {len(quantities)}: {quantities[0].label}{more}"
        set_fields(self, quantities=quantities, exponent=p, parts=quantities, label=label)

    def combine(self, values: Array) -> tuple[float, Array]:
        """See `Quantity`."""
        return measure_norm(values, self.exponent)


@dataclass(frozen=True, eq=False)
class Mass(AnalysisQuantity):
    """Mass of the moving parts of the model [kg].

    It is r^T M r with the mass matrix M and the unit translation r of all points.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_most(bd.quantities.Mass(), 2.0).label
    'mass <= 2'
    """

    label = "mass"
    analysis = (MASS,)
    unit = "kg"


@dataclass(frozen=True, eq=False)
class ParameterFunction(AnalysisQuantity):
    """Function of the values of the parameters alone, such as a volume or a cost.

    Attributes
    ----------
    function
        Function that takes parameters of the model by name, like the model function, and returns a
        number. Without `**others`, it receives only the parameters that it names. It must be
        smooth; its derivatives are central differences of fourth order with four calls for each
        parameter. For results of analyses, `EquilibriumValue`, `Frequency` and objectives of runs
        are therefore faster and more accurate.
    name
        Name in tables.
    unit
        Unit of the value in tables and limits; "" if it is unknown.

    Examples
    --------
    >>> import beamdae as bd
    >>> volume = bd.quantities.ParameterFunction(lambda thickness: 0.02 * sum(thickness), "volume")
    >>> volume.label
    'volume'
    """

    function: Callable[..., float]
    name: str = "function of parameters"
    unit: str = ""
    analysis = (PARAMETERS,)

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise BeamdaeError(
                "ParameterFunction: function must take the parameters by name and return a number, "
                f"got {short_repr(self.function)}."
            )
        name = _require_text("ParameterFunction", "name", self.name)
        unit = "" if as_text(self.unit) == "" else require_unit("ParameterFunction", self.unit)
        set_fields(self, name=name, unit=unit, label=name)

    def call(self, parameters: Mapping[str, Any]) -> Any:
        """Return the value of the function for the parameters of the model."""
        try:
            accepted = inspect.signature(self.function).parameters
        except ValueError:
            # Some built-in functions have no signature.
            return self.function(**parameters)
        if any(x.kind is x.VAR_KEYWORD for x in accepted.values()):
            return self.function(**parameters)
        return self.function(**{x: y for x, y in parameters.items() if x in accepted})


@dataclass(frozen=True, eq=False, kw_only=True)
class EquilibriumQuantity(AnalysisQuantity):
    """Result of an equilibrium path; see `equilibrium` for the attributes."""

    loads: Any = None
    control: str | None = None
    step: float | None = None
    t: float = 0.0

    @property
    def path(self) -> dict[str, Any]:
        """Arguments of `equilibrium`."""
        return {name: getattr(self, name) for name in ("loads", "to", "control", "step", "t")}

    @property
    def analysis(self) -> tuple[str, ...]:  # type: ignore[override]
        """See `AnalysisQuantity`."""
        return EQUILIBRIUM_PATH, repr(self.path)


@dataclass(frozen=True, eq=False)
class EquilibriumValue(EquilibriumQuantity):
    """Value of a column at the end of an equilibrium path.

    Attributes
    ----------
    column
        Header of an observed column, such as a position or a stress, of a coordinate, a multiplier
        or the load factor, with or without its unit.
    to, loads, control, step, t
        End and loads of the path, see `equilibrium`.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_least(bd.quantities.EquilibriumValue("tip.y"), -0.01).label
    'tip.y at equilibrium >= -0.01'
    """

    column: str
    to: Any = 1.0

    def __post_init__(self) -> None:
        column = _require_text("EquilibriumValue", "column", self.column)
        set_fields(self, column=column, unit=None, label=f"{column} at equilibrium")


@dataclass(frozen=True, eq=False)
class EquilibriumErrors(EquilibriumQuantity):
    """Sum of ((y_i - value_i) / sigma_i)^2 at several targets of an equilibrium path.

    Use it for the path of a point under an increasing load or a prescribed position.

    Attributes
    ----------
    column
        Header of a column, see `EquilibriumValue`.
    to
        Load factors, or {column: values} of an observed position, in the order in which the path
        reaches them.
    values
        Desired values of the column at the targets.
    sigma
        Standard deviation, a positive number or one per target; the weight is 1 / sigma^2.
    loads, control, step, t
        Loads of the path, see `equilibrium`.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.EquilibriumErrors("tip.y", {"tip.x": [0.1, 0.2]}, [0.0, 0.05], 1e-3).label
    'squared errors of tip.y at 2 equilibria'
    """

    column: str
    to: Any
    values: Any
    sigma: Any = 1.0
    targets: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)

    def __post_init__(self) -> None:
        name, to = "EquilibriumErrors", self.to
        column = _require_text(name, "column", self.column)
        if isinstance(to, Mapping):
            what = "load factors, or {column: values} of one column"
            to = require_mapping(name, "to", to, what)
            if len(to) != 1:
                raise BeamdaeError(f"{name}: to must be {what}, got {short_repr(to)}.")
        (targets,) = to.values() if isinstance(to, dict) else (to,)
        targets = read_numbers(name, "to", targets)
        values = read_numbers(name, "values", self.values)
        sigma = read_numbers(name, "sigma", self.sigma)
        if len(targets) != len(values) or not len(targets):
            raise BeamdaeError(
                f"{name}: values must contain one number per target, got {len(values)} values "
                f"for {len(targets)} targets."
            )
        require_deviations(name, sigma, len(targets), "target")
        label = f"squared errors of {column} at {len(values)} equilibria"
        set_fields(self, column=column, to=to, targets=targets, values=values, sigma=sigma)
        set_fields(self, label=label)


@dataclass(frozen=True, eq=False)
class CriticalLoad(EquilibriumQuantity):
    """Load factor of a limit, branch or flutter point of an equilibrium path.

    Attributes
    ----------
    to
        Load factor beyond the critical load of all designs, or target of another kind, see
        `equilibrium`. If a path has fewer than `number` critical points up to this end, its design
        is rejected.
    number
        Number of the critical point on the path, from 1 on.
    loads, control, step, t
        Loads of the path, see `equilibrium`.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_least(bd.quantities.CriticalLoad(to=10.0), 2.0).label
    'critical load 1 >= 2'
    """

    to: Any
    number: int = 1

    def __post_init__(self) -> None:
        number = require_count("CriticalLoad", "number", self.number, most=_MAX_NUMBER)
        set_fields(self, number=number, label=f"critical load {number}")


@dataclass(frozen=True, eq=False)
class Frequency(AnalysisQuantity):
    """Natural frequency [Hz] of an undamped mode of the model.

    Attributes
    ----------
    number
        Number of the mode from 1 on, in ascending order, without free motions.
    about
        "reference" or "equilibrium", see `modes`. None is the equilibrium if weight or other loads
        of the model are not balanced in the reference, and otherwise the reference.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_least(bd.quantities.Frequency(1), 20.0).label
    'frequency 1 >= 20'
    """

    number: int = 1
    about: str | None = None
    unit = "Hz"

    def __post_init__(self) -> None:
        number = require_count("Frequency", "number", self.number, most=_MAX_NUMBER)
        about = require_choice("Frequency", "about", self.about, [None, "reference", "equilibrium"])
        analysis = (MODES, about or "")
        set_fields(self, number=number, about=about, label=f"frequency {number}", analysis=analysis)


@dataclass(frozen=True, eq=False)
class Limit:
    """Constraint of an optimization; see `at_most` and `at_least`.

    Attributes
    ----------
    quantity
        The quantity.
    sign
        1 for an upper limit, -1 for a lower limit.
    bound
        The limit.
    unit
        Unit in which the limit was written; "" for numbers.
    """

    quantity: Quantity
    sign: int
    bound: float
    unit: str = ""

    @property
    def label(self) -> str:
        """Short description for tables."""
        return f"{self.quantity.label} {'<=' if self.sign > 0 else '>='} {self.bound:g}"

    def margin(self, value: float) -> float:
        """Return the distance of a value from the limit; negative if the limit is violated."""
        return self.sign * (self.bound - value)


def at_most(quantity: Any, limit: float | str) -> Limit:
    """Return the constraint that a quantity does not exceed a limit.

    Parameters
    ----------
    quantity
        A `Quantity`, or an `Objective` of a run.
    limit
        Upper limit of the value with its sign, in the unit of the quantity, or a text such as
        "150 MPa". Stresses are positive in tension and negative in compression: an upper limit
        permits any compression. To limit the magnitude, pass `LargestOf([quantity])` as quantity,
        or add `at_least(quantity, "-150 MPa")`.

    Raises
    ------
    BeamdaeError
        If an argument is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_most(bd.quantities.SmoothMaximum("stress"), 150e6).label
    'SmoothMaximum of stress <= 1.5e+08'
    """
    return _create_limit("at_most", quantity, 1, limit)


def at_least(quantity: Any, limit: float | str) -> Limit:
    """Return the constraint that a quantity is not less than a limit.

    Parameters
    ----------
    quantity
        A `Quantity`, or an `Objective` of a run.
    limit
        Lower limit of the value with its sign, in the unit of the quantity, or a text such as
        "50 Hz".

    Raises
    ------
    BeamdaeError
        If an argument is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.at_least(bd.quantities.Frequency(2), 50.0).label
    'frequency 2 >= 50'
    """
    return _create_limit("at_least", quantity, -1, limit)


def _create_limit(caller: str, quantity: Any, sign: int, limit: Any) -> Limit:
    text = as_text(limit)
    parsed = None if text is None else parse_quantity(text)
    number, unit = (limit, "") if parsed is None else parsed
    bound = require_finite(caller, "limit", number)
    return Limit(as_quantity(f"{caller}: quantity", quantity), sign, bound, unit)


def as_quantity(part: str, value: Any) -> Quantity:
    """Return a quantity or an objective of a run as a quantity, or raise BeamdaeError."""
    if isinstance(value, Quantity):
        return value
    raise BeamdaeError(
        f"{part} must be a Quantity such as Mass() or an Objective such as EndValue('tip.y'), got "
        f"{short_repr(value)}."
    )


def _require_text(part: str, name: str, value: Any) -> str:
    text = as_text(value)
    if not text:
        raise BeamdaeError(f"{part}: {name} must be a nonempty string, got {short_repr(value)}.")
    return text
