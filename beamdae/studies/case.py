"""A case of a study: a model, its parameters, an integrator."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from itertools import product
from typing import Any

from beamdae.errors import BeamdaeError, require_iterable, short_repr
from beamdae.integrators import GeneralizedAlpha, Ida, Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.solution import Solution
from beamdae.results.storage.files import versions
from beamdae.simulation import simulate
from beamdae.studies.store.file_hashes import digest_file, digest_package
from beamdae.studies.store.fingerprints import FingerprintError, digest, digest_transferable

# Longer texts are no labels, and two of them may look alike.
_MAX_LABEL_LENGTH = 60
_MAX_COMBINATIONS = 1_000_000
_REPRODUCIBLE_VALUES = (
    "what another process can tell again (numbers, texts, arrays, functions; lists, dicts, sets "
    "and objects of these)"
)
# Hashes found before, with what they are of: by identity, which lasts as long as the object.
DigestCache = dict[int, tuple[Any, str]]


@dataclass(frozen=True)
class Case:
    """One run of a study.

    Parameters
    ----------
    model
        A model function.
    parameters
        Values in place of its defaults.
    integrator
        Ida(...), GeneralizedAlpha(...), Radau(...) or any other `Integrator`.
    """

    model: Model
    parameters: Mapping[str, Any] = field(default_factory=dict)
    integrator: Integrator = field(default_factory=Ida)

    def __post_init__(self) -> None:
        if not isinstance(self.model, Model):
            raise BeamdaeError(
                f"Case: model must be a model function, see @bd.model, got {short_repr(self.model)}."
            )
        named = isinstance(self.parameters, Mapping) and all(
            isinstance(name, str) for name in self.parameters
        )
        if not named:
            raise BeamdaeError(
                f"Case of {self.model.name}: parameters must be a dict of values by name, "
                f"got {short_repr(self.parameters)}."
            )
        require_integrator(f"Case of {self.model.name}", self.integrator)

    @property
    def changed(self) -> dict[str, Any]:
        """Settings of the integrator that differ from their defaults."""
        chosen = {f.name: (getattr(self.integrator, f.name), f.default) for f in self._settings}
        return {name: value for name, (value, default) in chosen.items() if value != default}

    @property
    def _settings(self) -> list[Any]:
        # A limit of time changes nothing of the numbers.
        return [f for f in fields(self.integrator) if f.name != "time_limit"]  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """The integrator's label with whatever else differs from its defaults."""
        label = self.integrator.label
        more = [f"{k}={v}" for k, v in self.changed.items() if f"{k}=" not in label]
        return ", ".join([label.removesuffix(")"), *more]) + ")" if more else label

    @property
    def series(self) -> str:
        """The label with the name of step or tolerance alone: runs that make one curve."""
        refined = self.integrator.accuracy.name
        kept = [f"{k}={v}" for k, v in self.changed.items() if k != refined]
        return f"{self.integrator.method}({', '.join([refined, *kept])})"

    @property
    def group(self) -> str:
        """Model and parameters: cases that differ in their integrator alone share a reference."""
        values = ", ".join(f"{k}={format_parameter(v)}" for k, v in self.parameters.items())
        return f"{self.model.name}({values})" if values else self.model.name

    def configured(self) -> Model:
        """The model with the parameters of the case as its defaults."""
        return replace(self.model, parameters=self.model.complete(dict(self.parameters)))

    def solve(
        self, t_end: float | None = None, output_step: float | None = None, progress: Any = None
    ) -> Solution:
        """Run it; see `simulate`."""
        return simulate(self.configured(), self.integrator, t_end, output_step, progress)

    def mechanism_fingerprint(self, digests: DigestCache | None = None) -> str:
        """Hash of what the equations of motion depend on.

        Of the model (its code with all values it refers to, and the files it names), parameters,
        versions, and the sources of beamdae. Hashes in `digests` are taken as they are.

        Raises
        ------
        BeamdaeError
            If the model refers to something, or a parameter is something, that no other process
            can tell again: a lock, a generator, an open file.
        """
        digests = {} if digests is None else digests
        return cached_digest(digests, self, lambda: self._mechanism(digests))

    def _mechanism(self, digests: DigestCache) -> str:
        parameters = self.model.complete(dict(self.parameters))
        found = {
            name: _digest_parameter(self.model, name, x, digests) for name, x in parameters.items()
        }
        of_model = cached_digest(digests, self.model.build, lambda: _digest_model(self.model))
        return _case_digest(
            [of_model, sorted(found.items()), _digest_data_files(self.model), _environment_digest()]
        )

    def fingerprint(
        self, t_end: float, output_step: float, digests: DigestCache | None = None
    ) -> str:
        """Hash of all the result depends on, but files it reads while it runs: see `mechanism_fingerprint`."""
        digests = {} if digests is None else digests
        kind = type(self.integrator)
        code = cached_digest(digests, kind, lambda: _digest_integrator(kind))
        settings = asdict(self.integrator)  # type: ignore[call-overload]
        return _case_digest([self.mechanism_fingerprint(digests), code, settings, t_end, output_step])


def _case_digest(content: Any) -> str:
    return digest(content)[:20]


def cached_digest(digests: DigestCache, value: Any, find: Any) -> str:
    """What `find` gives, unless it is known of this very object."""
    if id(value) not in digests:
        digests[id(value)] = (value, find())
    return digests[id(value)][1]


def _digest_parameter(model: Model, name: str, value: Any, digests: DigestCache) -> str:
    def find() -> str:
        try:
            return digest_transferable(value)
        except FingerprintError as problem:
            raise BeamdaeError(
                f"{model.name}: {name} must be {_REPRODUCIBLE_VALUES}, got {short_repr(value)} "
                f"({problem.place} is a {problem.kind})."
            ) from None

    # Defaults live as long as the model does.
    return cached_digest(digests, value, find) if value is model.parameters[name] else find()


def _digest_model(model: Model) -> str:
    try:
        return digest([model.name, model.build])
    except FingerprintError as problem:
        raise _irreproducible_error(model.name, problem, "; make it inside the function") from None


def _digest_integrator(kind: type[Integrator]) -> str:
    try:
        return digest(kind)
    except FingerprintError as problem:
        raise _irreproducible_error(kind.__name__, problem) from None


def _irreproducible_error(part: str, problem: FingerprintError, remedy: str = "") -> BeamdaeError:
    return BeamdaeError(
        f"{part}: {problem.place} must be {_REPRODUCIBLE_VALUES}, got a {problem.kind}{remedy}."
    )


def _digest_data_files(model: Model) -> list[str | None]:
    return [digest_file(str(path)) for path in model.files()]


@cache
def _environment_digest() -> str:
    return digest([versions(), sys.version_info[:2], digest_package()])


def format_parameter(value: Any) -> str:
    """A parameter in labels: its text, or where that is long or no text, type and hash."""
    try:
        text = str(value)
    except Exception:  # Numbers of thousands of digits, and what objects do.
        text = ""
    plain = value is None or isinstance(value, (bool, int, float, str))
    # What NumPy leaves out, and addresses, are the same or another by chance.
    vague = not plain and ("..." in text or " at 0x" in text)
    if (
        text.isprintable()
        and len(text) <= _MAX_LABEL_LENGTH
        and (text or value == "")
        and not vague
    ):
        return text
    try:
        found = digest(value)[:6]
    except FingerprintError:
        return type(value).__name__
    return f"{type(value).__name__} #{found}"


def default_integrators() -> tuple[Integrator, ...]:
    """The integrators a model is compared with unless others are named."""
    return (
        Ida(rtol=1e-4),
        Ida(rtol=1e-6),
        Radau(rtol=1e-4),
        GeneralizedAlpha(step=1e-3),
        GeneralizedAlpha(step=5e-4),
    )


def grid(**lists: Iterable[Any]) -> list[dict[str, Any]]:
    """All combinations of parameter values, the last name varying fastest.

    Examples
    --------
    >>> grid(elements=[4, 8], strain=["linear"])
    [{'elements': 4, 'strain': 'linear'}, {'elements': 8, 'strain': 'linear'}]
    """
    combinations, found = 1, {}
    for name, values in lists.items():
        if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
            raise BeamdaeError(f"grid: {name} must be a list of values, got {short_repr(values)}.")
        # Of a generator it is not known whether it ends.
        found[name] = require_iterable(
            "grid", name, values, "a list of values", _MAX_COMBINATIONS + 1
        )
        combinations *= len(found[name])
    if combinations > _MAX_COMBINATIONS:
        raise BeamdaeError(
            f"grid: {', '.join(lists)} must have at most {_MAX_COMBINATIONS} combinations, "
            f"got {combinations} or more."
        )
    return [dict(zip(found, values, strict=True)) for values in product(*found.values())]
