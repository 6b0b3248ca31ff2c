"""Numbers p of a model, with the places of inputs and activities among them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from beamdae.equations.equations_of_motion import InputTerm
from beamdae.errors import BeamdaeError
from beamdae.parts.laws import Law
from beamdae.parts.signals import Activity, Input
from beamdae.symbolic.kernel_groups import Statement
from beamdae.symbolic.signals import SignalNumbers

Array = np.ndarray


def select_input_laws(inputs: Mapping[str, Input]) -> dict[str, Law]:
    """Return the laws of the inputs that are not numbers, by name of the input."""
    return {name: x.law for name, x in inputs.items() if x.law is not None}


class NumberStore:
    """Collects the numbers p of a model.

    Attributes
    ----------
    switched_parts
        Names of the parts that are inactive at times.
    activities
        Indices of the numbers that are 0 while a part is inactive and otherwise 1, by part.
    """

    def __init__(
        self, initial_numbers: Array | None = None, switched_parts: Collection[str] = ()
    ) -> None:
        self.switched_parts = switched_parts
        self.activities: dict[str, tuple[int, ...]] = {}
        self._arrays: list[Array] = [] if initial_numbers is None else [initial_numbers]
        self._end = sum(map(len, self._arrays))
        self._inputs: dict[str, list[int]] = {}

    def all(self, inputs: Mapping[str, Input]) -> Array:
        """Return all numbers stored so far, with the values of `inputs`."""
        p = np.concatenate([np.zeros(0), *self._arrays])
        for name, indices in self._inputs.items():
            if name not in inputs:
                raise BeamdaeError(
                    f"{name}: the input is not part of this mechanism; add it with mech.input."
                )
            p[indices] = inputs[name].data[0]
        return p

    def store(self, values: Array) -> slice:
        """Append `values` column by column; return their slice of p."""
        begin = self._end
        self._arrays.append(np.asarray(values, float).ravel(order="F"))
        self._end += len(self._arrays[-1])
        return slice(begin, self._end)

    def store_copies(self, values: Array, statements: Sequence[Statement]) -> slice:
        """Append the data of the copies of statements, one column per copy; return their slice."""
        data = self.store(values)
        column = 0
        for statement in statements:
            for _ in range(statement.data.shape[1]):
                self.record_signals(statement.signals, data.start + column * len(values))
                column += 1
        return data

    def record_signals(self, signals: Sequence[SignalNumbers], begin: int) -> None:
        """Record the indices in p of the numbers of inputs and of activities.

        The data begin at index `begin`.
        """
        for signal, rows in signals:
            if isinstance(signal, Input) and rows.stop > rows.start:
                self._inputs.setdefault(signal.name, []).append(begin + rows.start)
            if isinstance(signal, Activity):
                self.record_activity(signal.name, begin + rows.start)

    def record_activity(self, part: str, index: int) -> None:
        """Record the index in p of a number that is 0 while `part` is inactive."""
        self.activities[part] = (*self.activities.get(part, ()), index)

    def input_terms(self, inputs: Mapping[str, Input]) -> tuple[InputTerm, ...]:
        """Return the inputs with the indices of their numbers in p."""
        return tuple(
            InputTerm(name, x.unit, x.reference, tuple(self._inputs.get(name, ())), x.law)
            for name, x in inputs.items()
        )
