"""A case of a study: a model, its parameters and an integrator."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import product
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    as_text,
    require_iterable,
    require_mapping,
    set_fields,
    short_repr,
)
from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.interrupts import PartialResult
from beamdae.model_functions import Model
from beamdae.parts.mechanism import require_start
from beamdae.parts.rotation import Rotation
from beamdae.read_only import ReadOnlyDict, copy_containers
from beamdae.results.solution import Solution
from beamdae.results.storage.files import versions
from beamdae.simulation import simulate
from beamdae.studies.file_reads import digest_file, digest_package
from beamdae.studies.fingerprints import FingerprintError, digest

FINGERPRINT_LENGTH = 20  # hexadecimal digits: 80 bits
_LABEL_HASH_LENGTH = 6
_MAX_LABEL_LENGTH = 60  # characters of a parameter value in a label
MAX_CASES = 1_000_000  # cases of a study, or values of a parameter
_REPRODUCIBLE_VALUES = (
    "a value that other processes can reproduce (numbers, strings, arrays, functions; lists, "
    "dicts, sets and objects of these)"
)
# Digests by the id() of a value. Storing the value keeps it alive, so that its id is not reused.
DigestCache = dict[int, tuple[Any, str]]


@dataclass(frozen=True)
class Case:
    """One run of a study.

    Parameters
    ----------
    model
        Model function, decorated with `bd.model`.
    parameters
        Parameter values by name; they replace the defaults of the model. Defaults to no changes.
    integrator
        Any `Integrator`, such as GeneralizedAlpha(...) or Radau(...). Defaults to `Auto()`.
    start
        Initial state, in the forms accepted by `Mechanism`: "equilibrium", a `rotation`, or values
        by coordinate. Defaults to the start of the model.

    Raises
    ------
    BeamdaeError
        If an argument has the wrong type or the integrator is not valid. Names and types of
        parameters are not checked here, but when the case is run or becomes part of a study.
    """

    model: Model
    parameters: Mapping[str, Any] = field(default_factory=dict)
    integrator: Integrator = field(default_factory=Auto)
    start: str | Rotation | Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.model, Model):
            raise BeamdaeError(
                "Case: model must be a function decorated with @bd.model, "
                f"got {short_repr(self.model)}."
            )
        parameters = require_mapping(
            f"Case of {self.model.name}", "parameters", self.parameters, "a dict of values by name"
        )
        require_integrator(f"Case of {self.model.name}", self.integrator)
        set_fields(self, parameters=ReadOnlyDict(copy_containers(parameters)))
        if self.start is not None:
            start = require_start(f"Case of {self.model.name}", self.start)
            set_fields(self, start=ReadOnlyDict(start) if isinstance(start, dict) else start)

    @property
    def changed(self) -> dict[str, Any]:
        """Integrator settings that differ from their defaults, by name, except the time limit.

        Settings without a default are included.
        """
        settings = {f.name: (getattr(self.integrator, f.name), f.default) for f in self._settings}
        return {name: value for name, (value, default) in settings.items() if value != default}

    @property
    def _settings(self) -> list[Any]:
        # The time limit does not affect the results.
        return [f for f in fields(self.integrator) if f.name != "time_limit"]  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """Label of the integrator, including all settings in `changed`."""
        label = self.integrator.label
        others = [f"{k}={v}" for k, v in self.changed.items() if f"{k}=" not in label]
        return ", ".join([label.removesuffix(")"), *others]) + ")" if others else label

    @property
    def series(self) -> str:
        """Label without the value of step or rtol, such as `Ida(rtol)`.

        In work-precision plots, the cases of a group that have the same series form one curve.
        """
        accuracy = self.integrator.accuracy.name
        others = [f"{k}={v}" for k, v in self.changed.items() if k != accuracy]
        return f"{self.integrator.method}({', '.join([accuracy, *others])})"

    @property
    def group(self) -> str:
        """Name of the model with the parameters of the case, such as `beam(elements=4)`.

        If the case has a start, the name ends with it: `beam(elements=4) from equilibrium`.
        """
        values = ", ".join(f"{k}={format_parameter(v)}" for k, v in self.parameters.items())
        name = f"{self.model.name}({values})" if values else self.model.name
        if self.start is None:
            return name
        start = dict(self.start) if isinstance(self.start, Mapping) else self.start
        return f"{name} from {format_parameter(start)}"

    def configured(self) -> Model:
        """Return the model with the parameters of the case as its defaults."""
        return replace(self.model, parameters=self.model.complete(dict(self.parameters)))

    def solve(
        self,
        t_end: float | None = None,
        output_step: float | None = None,
        progress: Any = None,
        *,
        partial: PartialResult = "raise",
    ) -> Solution:
        """Run the case and return its solution; see `simulate` for parameters and errors."""
        model = self.configured()
        return simulate(
            model,
            self.integrator,
            t_end,
            output_step,
            progress,
            start=self.start,
            partial=partial,
        )

    def mechanism_fingerprint(self, digests: DigestCache | None = None) -> str:
        """Return a hash of what the equations depend on, except undeclared files.

        The hash covers the model (its code, the values that the code refers to, and the files it
        declares), the parameters, the start, the versions of Python and packages, and the source
        code of beamdae without `cli` and `report`. Pass the same dict as `digests` to several calls
        to hash a shared model only once.

        Raises
        ------
        BeamdaeError
            If a parameter is unknown or has the wrong type, a declared file is missing, or a
            parameter or a value that the model refers to cannot be reproduced in another process,
            such as a lock, a generator or an open file.
        """
        digests = {} if digests is None else digests
        return cached_digest(digests, self, lambda: self._digest_mechanism(digests))

    def _digest_mechanism(self, digests: DigestCache) -> str:
        parameters = {
            name: _digest_parameter(self.model, name, value, digests)
            for name, value in self.model.complete(dict(self.parameters)).items()
        }
        build = self.model.build
        model = cached_digest(digests, build, lambda: _digest_code(self.model.name, build))
        data = [digest_file(str(path)) for path in self.model.files()]
        start = sorted(self.start.items()) if isinstance(self.start, Mapping) else self.start
        content = [model, sorted(parameters.items()), start, data, _digest_environment()]
        # The digest of one text takes a tenth of the time of a digest of nested lists.
        return digest(repr(content))[:FINGERPRINT_LENGTH]

    def fingerprint(
        self, t_end: float, output_step: float, digests: DigestCache | None = None
    ) -> str:
        """Return a hash of everything the result depends on, except undeclared files.

        Undeclared files that the model reads are known only after the run; the record of the run
        contains their hashes. `t_end` and `output_step` are the end time and the time between rows
        [s]. See `mechanism_fingerprint` for `digests` and errors; an integrator whose class or
        settings cannot be reproduced is also an error.
        """
        digests = {} if digests is None else digests
        kind = type(self.integrator)
        code = cached_digest(digests, kind, lambda: _digest_code(kind.__name__, kind))

        def digest_settings() -> str:
            names = [x.name for x in fields(self.integrator)]  # type: ignore[arg-type]
            parts = [(x, f"{kind.__name__}: {x}", getattr(self.integrator, x)) for x in names]
            return repr(sorted((name, _digest_value(part, x)) for name, part, x in parts))

        # All cases of a sweep have the same integrator.
        settings = cached_digest(digests, self.integrator, digest_settings)
        mechanism = self.mechanism_fingerprint(digests)
        content = f"[{mechanism!r}, {code!r}, {settings}, {t_end!r}, {output_step!r}]"
        return digest(content)[:FINGERPRINT_LENGTH]


def cached_digest(digests: DigestCache, value: Any, compute: Callable[[], str]) -> str:
    """Return the cached digest of `value`, or compute and cache the digest if missing."""
    if id(value) not in digests:
        digests[id(value)] = (value, compute())
    return digests[id(value)][1]


def _digest_parameter(model: Model, name: str, value: Any, digests: DigestCache) -> str:
    def compute() -> str:
        return _digest_value(f"{model.name}: {name}", value)

    # Only defaults are shared by many cases.
    is_default = value is model.parameters[name]
    return cached_digest(digests, value, compute) if is_default else compute()


def _digest_value(part: str, value: Any) -> str:
    """Return the digest of a parameter or a setting, which other processes can reproduce."""
    try:
        return digest(value)
    except FingerprintError as problem:
        raise BeamdaeError(
            f"{part} must be {_REPRODUCIBLE_VALUES}, got {short_repr(value)} "
            f"({problem.location} has the type {problem.kind})."
        ) from None


def _digest_code(name: str, code: Any) -> str:
    """Return the digest of a function or class and of the values to which it refers."""
    try:
        return digest([name, code])
    except FingerprintError as problem:
        raise BeamdaeError(
            f"{name}: {problem.location} must be {_REPRODUCIBLE_VALUES}, got an object "
            f"of type {problem.kind}; create this object inside the function."
        ) from None


@cache
def _digest_environment() -> str:
    return digest([versions(), sys.version_info[:2], digest_package()])


def format_parameter(value: Any) -> str:
    """Format a parameter value for labels: as text or, if unsuitable, as its type and a hash.

    Text is unsuitable if it is long, unprintable, abbreviated or contains a memory address. A value
    without a hash becomes its type only.
    """
    try:
        text = str(value)
    except Exception:  # huge integers, or an error in __str__
        text = ""
    is_scalar = value is None or isinstance(value, (bool, int, float, str))
    # NumPy abbreviates long arrays, and addresses differ between processes.
    is_ambiguous = not is_scalar and ("..." in text or " at 0x" in text)
    is_short = text.isprintable() and len(text) <= _MAX_LABEL_LENGTH
    if is_short and (text or as_text(value) == "") and not is_ambiguous:
        return text
    try:
        return f"{type(value).__name__} #{digest(value)[:_LABEL_HASH_LENGTH]}"
    except FingerprintError:
        return type(value).__name__


def default_integrators() -> tuple[Integrator, ...]:
    """Return the integrators that `beamdae compare` uses for a model without a study."""
    return (
        Ida(rtol=1e-4),
        Ida(rtol=1e-6),
        Radau(rtol=1e-4),
        GeneralizedAlpha(step=1e-3),
        GeneralizedAlpha(step=5e-4),
    )


def list_entries(part: str, name: str, value: Any, what: str) -> list[Any]:
    """Return the entries of an ordered iterable, which are at most a million.

    `what` describes the expected value in messages.
    """
    is_unordered = isinstance(value, (str, bytes, set, frozenset))
    entries = require_iterable(part, name, None if is_unordered else value, what, MAX_CASES + 1)
    if len(entries) > MAX_CASES:
        raise BeamdaeError(f"{part}: {name} has more than {MAX_CASES} entries; use fewer.")
    return entries


def grid(**lists: Iterable[Any]) -> list[dict[str, Any]]:
    """Return all combinations of parameter values; the last name varies fastest.

    Parameters
    ----------
    **lists
        Values by parameter name.

    Returns
    -------
    list of dict
        Combinations, each with one value per name.

    Raises
    ------
    BeamdaeError
        If an argument is not iterable, is a string or a dict, or there are more than a million
        combinations.

    Examples
    --------
    >>> grid(elements=[4, 8], strain=["linear"])
    [{'elements': 4, 'strain': 'linear'}, {'elements': 8, 'strain': 'linear'}]
    """
    combinations = 1
    values_by_name = {}
    for name, values in lists.items():
        if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
            raise BeamdaeError(f"grid: {name} must be a list of values, got {short_repr(values)}.")
        # The limit stops infinite generators.
        values_by_name[name] = require_iterable(
            "grid", name, values, "a list of values", MAX_CASES + 1
        )
        combinations *= len(values_by_name[name])
    if combinations > MAX_CASES:
        raise BeamdaeError(
            f"grid: there must be at most {MAX_CASES} combinations of "
            f"{', '.join(lists)}, got {combinations} or more; use fewer values."
        )
    return [
        dict(zip(values_by_name, values, strict=True))
        for values in product(*values_by_name.values())
    ]
