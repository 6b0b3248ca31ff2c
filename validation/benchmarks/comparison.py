"""A computed value beside its reference."""

from __future__ import annotations

from typing import NamedTuple


class Comparison(NamedTuple):
    """Name, reference and computed value of a quantity."""

    quantity: str
    reference: float
    computed: float

    @property
    def relative_error(self) -> float:
        """Error relative to the reference."""
        return float(abs(self.computed / self.reference - 1.0))
