"""Mechanisms some of whose joints and forces are inactive: equations of the others alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError
from beamdae.parts.events import Switch
from beamdae.parts.mechanism import Mechanism

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Configuration:
    """Equations of the active parts of a mechanism.

    Attributes
    ----------
    equations
        On the same coordinates as those of all parts.
    held
        Which of the multipliers of all parts are theirs.
    inactive
        Names of the other parts.
    """

    equations: EquationsOfMotion
    held: Array
    inactive: frozenset[str]

    def own(self, lam: Array) -> Array:
        """Of rows of all multipliers those that there are."""
        return lam[:, self.held]

    def among_all(self, lam: Array, m: int) -> Array:
        """Rows of all `m` multipliers: those of inactive parts are zero."""
        found = np.zeros((len(lam), m))
        found[:, self.held] = lam
        return found


@dataclass(eq=False)
class Configurations:
    """The configurations of a mechanism, built when they are first asked for.

    Attributes
    ----------
    first
        Parts that are inactive at the start of a run.
    """

    mechanism: Mechanism
    build: Callable[[Mechanism], EquationsOfMotion]
    first: frozenset[str]
    _known: dict[frozenset[str], EquationsOfMotion] = field(default_factory=dict, init=False)

    def of(self, whole: EquationsOfMotion, inactive: frozenset[str]) -> Configuration:
        """The one without these parts; `whole` are the equations of all."""
        if inactive not in self._known:
            rest = copy(self.mechanism)
            rest.parts = {k: x for k, x in rest.parts.items() if k not in inactive}
            rest.observables, rest.events, rest.inactive = {}, [], set()
            self._known[inactive] = self.build(rest)
        # What a run goes by must not change on the way.
        shared = {
            name: getattr(whole, name)
            for name in ("q0", "v0", "length", "parts", "breakpoints", "time_scale", "laws")
        }
        equations = replace(self._known[inactive], **shared)
        rows = {name: k for k, name in enumerate(whole.lam_names)}
        held = np.array([rows[name] for name in equations.lam_names], int)
        return Configuration(equations, held, inactive)

    def after(self, inactive: frozenset[str], switches: Iterable[Switch]) -> frozenset[str]:
        """Which parts are inactive after some were switched."""
        for switch in switches:
            inactive = inactive.difference(switch.on).union(switch.off)
        return inactive


def configurations_of(
    mechanism: Mechanism, build: Callable[[Mechanism], EquationsOfMotion]
) -> Configurations | None:
    """The configurations of a mechanism whose parts are switched; None where none are.

    Raises
    ------
    BeamdaeError
        If a part that is switched is unknown, or brings coordinates along.
    """
    switches = [x for event in mechanism.events if isinstance(event.do, tuple) for x in event.do]
    names = {name for switch in switches for name in (*switch.on, *switch.off)}
    for name in sorted(names | mechanism.inactive):
        if len(mechanism.part(name).coordinates):
            raise BeamdaeError(
                f"{name}: it brings coordinates along, only joints and forces can be switched."
            )
    if not names and not mechanism.inactive:
        return None
    return Configurations(mechanism, build, frozenset(mechanism.inactive))
