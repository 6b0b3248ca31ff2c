"""Study of one model over values of its parameters, and validation of values and outputs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    require_entries,
    require_iterable,
    require_mapping,
    set_fields,
    short_repr,
)
from beamdae.integrators import Integrator
from beamdae.model_functions import Model
from beamdae.read_only import read_only_data
from beamdae.results.solution import Solution
from beamdae.studies.case import (
    FINGERPRINT_LENGTH,
    MAX_CASES,
    Case,
    DigestCache,
    cached_digest,
    format_parameter,
    grid,
)
from beamdae.studies.definition import Study
from beamdae.studies.run_values import MEASURED_ERROR_COLUMN, WALL_TIME_COLUMN
from beamdae.studies.store.fingerprints import FingerprintError, digest
from beamdae.studies.sweeps.parameter_grid import GridAxis, ParameterGrid
from beamdae.studies.tasks import Task

Output = Callable[[Solution], Any]
# Function of a model whose defaults are the parameters of the case.
Measure = Callable[[Model], Any]

# Columns of every table of responses.
STATUS = "status"
REASON = "reason"
TRAJECTORY = "trajectory"
WARNINGS = "warnings"
_MAX_ANIMATED_CASES = 25  # 5 x 5 for two parameters; a recorded motion takes 0.2 MB
_FRAMES = 60  # of a recorded motion
RESERVED_COLUMNS = (STATUS, REASON, MEASURED_ERROR_COLUMN, WALL_TIME_COLUMN, TRAJECTORY, WARNINGS)


@read_only_data
@dataclass(frozen=True)
class ParameterStudy(Study):
    """Runs of one model over values of its parameters, without references.

    Attributes
    ----------
    columns
        Observed columns in the table. Defaults to all observed columns.
    outputs
        Functions of a `Solution`, or of the model if `is_measured` is true, by column name.
    is_measured
        True if the outputs are functions of the model, which is not run.
    settings
        Parameter values of each case as displayed: numbers, booleans and strings; other values,
        and values with a name, are displayed as strings.

    Raises
    ------
    BeamdaeError
        If `outputs` is not a dict of functions by name, a name is blank or already a column of the
        table, or another setting is invalid; see `Study`.
    """

    references: tuple[Integrator, ...] | None = ()
    outputs: Mapping[str, Output | Measure] = field(default_factory=dict)
    is_measured: bool = False
    settings: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        columns = {*RESERVED_COLUMNS, *self.parameters, *map(self.header, self.parameters)}
        set_fields(self, outputs=_require_outputs(self.name, self.outputs, columns))
        super().__post_init__()

    @property
    def parameters(self) -> list[str]:
        """Names of the swept parameters."""
        return list(dict.fromkeys(name for setting in self.settings for name in setting))

    @cached_property
    def axes(self) -> dict[str, GridAxis]:
        """Values of the parameters with more than one value, by name."""
        axes = (GridAxis.of(name, self.settings) for name in self.parameters)
        return {axis.name: axis for axis in axes if len(axis.values) > 1}

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the parameters with more than one value."""
        return tuple(self.axes)

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of the swept parameters by name; "" if unknown, "-" without dimension."""
        described = self.cases[0].model.parameter_info
        return {name: described[name].unit for name in self.parameters if name in described}

    def header(self, name: str) -> str:
        """Return the header of a parameter in tables, with its unit, such as "speed [rad/s]"."""
        prefix = "parameter " if name in RESERVED_COLUMNS else ""
        return prefix + self.cases[0].model.header(name)

    @cached_property
    def grid(self) -> ParameterGrid:
        """Arrangement of the cases by the values of the varied parameters."""
        return ParameterGrid.of(self.settings, tuple(self.axes.values()))

    @cached_property
    def _animated_cases(self) -> set[int]:
        """Cases whose motion is recorded, by their `id`."""
        return {id(self.cases[row]) for row in self.grid.sample(_MAX_ANIMATED_CASES)}

    @cached_property
    def _setting_by_case(self) -> dict[int, Mapping[str, Any]]:
        return {id(case): x for case, x in zip(self.cases, self.settings, strict=True)}

    def tag(self, case: Case) -> str:
        """Return a label with the values of the varied parameters.

        If no parameter varies, the label contains the values of all parameters.
        """
        setting = self._setting_by_case[id(case)]
        values = [f"{x}={format_setting(setting[x])}" for x in self.varied or setting]
        return ", ".join(values) or self.name

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """Return the task of a case, including outputs and animation; see `Study.task`.

        The motion is recorded for at most 25 cases that span the parameters.
        """
        digests = {} if digests is None else digests
        task = super().task(case, reference, digests)
        if id(case) in self._animated_cases and not self.is_measured:
            task = replace(task, frames=_FRAMES)
        if not self.outputs:
            return task
        content = [task.key, cached_digest(digests, self.outputs, self._digest_outputs)]
        key = digest([*content, "measured"] if self.is_measured else content)[:FINGERPRINT_LENGTH]
        return replace(task, key=key, outputs=self.outputs, is_measured=self.is_measured)

    def _digest_outputs(self) -> str:
        try:
            return digest(dict(self.outputs))
        except FingerprintError as problem:
            raise BeamdaeError(
                f"{self.name}: outputs must be functions that another process can "
                f"reproduce, but {problem.location} has the type {problem.kind}; create it "
                "inside the function."
            ) from None


@dataclass(frozen=True)
class ParameterValue:
    """Value of a parameter, and its form in tables and labels."""

    value: Any
    label: Any


def expand_values(part: str, model: Model, over: Any) -> list[dict[str, ParameterValue]]:
    """Return the parameters of each case.

    `over` contains values by parameter, or is a list of combinations. A parameter that a
    combination omits has the default of the model.

    Raises
    ------
    BeamdaeError
        If `over` has the wrong form, or a parameter is unknown, has no values, or has a value of
        the wrong type.
    """
    allowed = "a dict of values by parameter, or a list of parameter combinations"
    if isinstance(over, Mapping):
        by_name = require_mapping(part, "over", over, allowed)
        if not by_name:
            raise BeamdaeError(f"{part}: over must be {allowed}, got {{}}.")
        return grid(**{x: _require_values(part, model, x, y) for x, y in by_name.items()})
    entries = _require_list(part, "over", over, allowed)
    if not entries or not all(isinstance(combination, Mapping) for combination in entries):
        raise BeamdaeError(f"{part}: over must be {allowed}, got {short_repr(over)}.")
    listed = [require_mapping(part, "over", combination, allowed) for combination in entries]
    names = list(dict.fromkeys(name for combination in listed for name in combination))
    return [
        {x: _check_value(model, x, combination.get(x, model.parameters.get(x))) for x in names}
        for combination in listed
    ]


def _require_values(part: str, model: Model, name: Any, values: Any) -> list[ParameterValue]:
    if name not in model.parameters:
        model.complete({name: None})  # raises the error that names the model's parameters
    allowed = "a list of values, or a dict of values by name"
    if isinstance(values, Mapping):
        by_label = require_entries(part, name, values, allowed)
        checked = [_check_value(model, name, x, str(label)) for label, x in by_label.items()]
    else:
        checked = [_check_value(model, name, x) for x in _require_list(part, name, values, allowed)]
    if not checked:
        raise BeamdaeError(f"{part}: {name} must have at least one value, got none.")
    return checked


def _require_list(part: str, name: str, values: Any, allowed: str) -> list[Any]:
    unordered = isinstance(values, (str, bytes, set, frozenset))
    entries = require_iterable(part, name, None if unordered else values, allowed, MAX_CASES + 1)
    if len(entries) > MAX_CASES:
        raise BeamdaeError(f"{part}: {name} has more than {MAX_CASES} values; use fewer values.")
    return entries


def _check_value(model: Model, name: str, value: Any, label: str | None = None) -> ParameterValue:
    checked = model.complete({name: value})[name]
    if label is not None:
        return ParameterValue(checked, label)
    plain = isinstance(checked, (bool, int, float, str))
    return ParameterValue(checked, checked if plain else format_parameter(checked))


def _require_outputs(part: str, value: Any, columns: Collection[str]) -> dict[str, Any]:
    allowed = "a dict of functions of a solution by name"
    outputs = require_entries(part, "outputs", value, allowed)
    for name, function in outputs.items():
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise BeamdaeError(
                f"{part}: names of outputs must be printable, non-blank strings, "
                f"got {short_repr(name)}."
            )
        if name in columns:
            raise BeamdaeError(
                f"{part}: the table already has a column {name!r}; rename the output."
            )
        if not callable(function):
            raise BeamdaeError(f"{part}: outputs must be {allowed}, got {short_repr(function)}.")
    return outputs


def format_setting(value: Any) -> str:
    """Format a displayed parameter value; floats have six significant digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
