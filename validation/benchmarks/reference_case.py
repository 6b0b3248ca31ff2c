"""Cases of analyses, with reference values and their sources."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Values = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class ReferenceCase:
    """Computed values beside those of a publication or a closed form.

    Attributes
    ----------
    source
        Publication or closed form.
    tolerance
        Largest relative error allowed.
    reference, compute
        Functions that return the reference and the computed values by name.
    """

    name: str
    source: str
    tolerance: float
    reference: Callable[[], Values]
    compute: Callable[[], Values]

    def errors(self) -> dict[str, float]:
        """Return the error of each value relative to its reference."""
        values, reference = self.compute(), self.reference()
        return {x: float(abs(values[x] / exact - 1.0)) for x, exact in reference.items()}


def beam_case(
    name: str,
    source: str,
    elements: int,
    reference: Values,
    tolerance: float,
    compute: Callable[[int, Mapping[str, Any]], Values],
    formulations: Mapping[str, Mapping[str, Any]],
) -> ReferenceCase:
    """Return a case whose values each formulation of beams computes with `elements` elements."""

    def repeat(values: Callable[[Mapping[str, Any]], Values]) -> Values:
        return {
            f"{quantity}, {label}": x
            for label, settings in formulations.items()
            for quantity, x in values(settings).items()
        }

    return ReferenceCase(
        name,
        source,
        tolerance,
        lambda: repeat(lambda settings: reference),
        lambda: repeat(lambda settings: compute(elements, settings)),
    )
