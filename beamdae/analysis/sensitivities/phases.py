"""Models of the phases of a run, between two events, and their neighbors by parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    derivative_call,
    forms_of,
    with_structure,
)
from beamdae.equations.equations_of_motion import (
    Configuration,
    Configurations,
    EquationsOfMotion,
    ImpactEquations,
)
from beamdae.equations.structure import has_same_patterns
from beamdae.errors import BeamdaeError
from beamdae.parts.events import select_impacts

Array = np.ndarray


@dataclass(frozen=True)
class Phase:
    """Equations of the active parts at neighboring values of one parameter.

    Attributes
    ----------
    whole
        Equations of all parts.
    active
        Equations of the active parts.
    configurations
        Active parts of the neighboring models; None if the active parts never change.
    """

    whole: Difference
    active: Difference
    configurations: tuple[Configuration | None, ...]

    @classmethod
    def first(cls, whole: Difference, configuration: Configuration | None) -> Phase:
        """Return the phase at the start of a run with this configuration."""
        if configuration is None:
            return cls(whole, whole, (None,) * len(whole.equations))
        configurations = tuple(_configurations(e).initial_configuration(e) for e in whole.equations)
        return cls(whole, _activate(whole, configuration, configurations), configurations)

    def after_event(
        self,
        number: int,
        configuration: Configuration,
        time: Array,
        dt: float,
        q: Array,
        dq: Array,
    ) -> Phase:
        """Return the phase after an event.

        Joints may keep the gaps that they have at the event, and laws may begin there. Therefore,
        the event of each neighboring model is at its own time and positions.

        Parameters
        ----------
        number
            Index of the event.
        configuration
            Configuration of the run after the event.
        time, q
            (t, branch) and positions at the event.
        dt, dq
            Total derivatives of the time of the event [s] and of the positions.
        """
        configurations = tuple(
            _configurations(e).configuration_after(
                e, now, e.events[number], time + np.array([step * dt, 0.0]), q + step * dq
            )
            for e, now, step in zip(
                self.whole.equations, self._active_configurations, self.whole.steps, strict=True
            )
        )
        active = _activate(self.whole, configuration, configurations)
        return Phase(self.whole, active, configurations)

    @property
    def _active_configurations(self) -> list[Configuration]:
        return [x for x in self.configurations if x is not None]

    def impacts(self, number: int) -> list[ImpactEquations]:
        """Return the equations of the impacts of an event of the neighboring models."""
        pairs = zip(self.whole.equations, self._active_configurations, strict=True)
        return [impact_equations(e, now, number) for e, now in pairs]


def impact_equations(
    equations: EquationsOfMotion, configuration: Configuration, number: int
) -> ImpactEquations:
    """Return the equations of the impacts of an event; `configuration` is that before it."""
    event = equations.events[number]
    impacts = select_impacts(event.do)
    return _configurations(equations).impact_equations(
        equations, configuration, event.name, impacts
    )


def _configurations(equations: EquationsOfMotion) -> Configurations:
    assert equations.configurations is not None
    return equations.configurations


def _activate(
    whole: Difference, configuration: Configuration, neighbors: Sequence[Configuration]
) -> Difference:
    return _difference(whole, configuration.equations, [x.equations for x in neighbors])


def _difference(
    whole: Difference, base: EquationsOfMotion, neighbors: Sequence[EquationsOfMotion]
) -> Difference:
    """Return the difference of equations of which some parts are active.

    If forces vanish at the value of the parameter, the numbers at this value are interpolated; see
    `difference_model`.
    """
    first = neighbors[0]
    if not all(has_same_patterns(e.structure, first.structure) for e in neighbors):
        raise BeamdaeError(
            f"{derivative_call()}: {whole.name} changes the structure of the equations after an "
            "event; "
            "use differences of runs for this parameter."
        )
    if not has_same_patterns(base.structure, first.structure) or forms_of(base) != forms_of(first):
        base = with_structure(base, neighbors, whole.steps)
    return replace(whole, base=base, equations=tuple(neighbors))
