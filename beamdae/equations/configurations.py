"""Mechanisms some of whose joints and forces are inactive: equations of the others alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.owners import Owners, owners_of
from beamdae.errors import BeamdaeError
from beamdae.parts.as_found import AsFound, found_by
from beamdae.parts.events import Impact, Switch, impacts_of, switches_of
from beamdae.parts.gaps import ClosedGap
from beamdae.parts.joints import Joint, JointByFormula
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part

Array = np.ndarray
# What joints that were switched on as they were hold, by name.
Found = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Configuration:
    """Equations of the active parts of a mechanism, from one event to the next.

    Attributes
    ----------
    equations
        On the same coordinates as those of all parts.
    held
        Which of the multipliers of all parts are theirs.
    inactive
        Names of the other parts.
    found
        What joints hold that were switched on as they were.
    """

    equations: EquationsOfMotion
    held: Array
    inactive: frozenset[str]
    found: Found = field(default_factory=dict)

    def own(self, lam: Array) -> Array:
        """Of rows of all multipliers those that there are."""
        return lam[:, self.held]

    def among_all(self, lam: Array, m: int) -> Array:
        """Rows of all `m` multipliers: those of inactive parts are zero."""
        found = np.zeros((len(lam), m))
        found[:, self.held] = lam
        return found


@dataclass(frozen=True)
class Struck:
    """Equations in which what an impact throws back is held, too.

    Attributes
    ----------
    restitution
        By multiplier of what is thrown back.
    gaps
        Those of them that open freely.
    """

    equations: EquationsOfMotion
    restitution: Mapping[str, float]
    gaps: frozenset[str]


@dataclass(eq=False)
class Configurations:
    """The configurations of a mechanism, built when they are first asked for.

    Attributes
    ----------
    first
        Parts that are inactive at the start of a run.
    found
        What joints hold there that were switched on as they were.
    """

    mechanism: Mechanism
    build: Callable[[Mechanism], EquationsOfMotion]
    first: frozenset[str]
    found: Found = field(default_factory=dict)
    _known: dict[frozenset[str], EquationsOfMotion] = field(default_factory=dict, init=False)

    def begin(self, whole: EquationsOfMotion) -> Configuration:
        """The one at the start of a run; `whole` are the equations of all parts."""
        return self.of(whole, self.first, self.found)

    def of(self, whole: EquationsOfMotion, inactive: frozenset[str], found: Found) -> Configuration:
        """The one without these parts, some joints of which hold what was `found`."""
        if found:
            # What was found once is not found again.
            built = self.build(self._without(inactive, found))
        elif inactive in self._known:
            built = self._known[inactive]
        else:
            built = self._known[inactive] = self.build(self._without(inactive, found))
        # What a run goes by must not change on the way.
        shared = {
            name: getattr(whole, name)
            for name in ("q0", "v0", "length", "parts", "breakpoints", "time_scale", "laws")
        }
        equations = replace(built, **shared)
        rows = {name: k for k, name in enumerate(whole.lam_names)}
        held = np.array([rows[name] for name in equations.lam_names], int)
        return Configuration(equations, held, inactive, dict(found))

    def after(
        self,
        whole: EquationsOfMotion,
        now: Configuration,
        do: Iterable[Switch],
        time: Array,
        q: Array,
    ) -> Configuration:
        """The one after some parts were switched at time = (t, branch)."""
        inactive, found = now.inactive, dict(now.found)
        for switch in do:
            inactive = inactive.difference(switch.on).union(switch.off)
            for name in (*switch.on, *switch.off):
                found.pop(name, None)
            for name in switch.as_is:
                joint = self.mechanism.part(name)
                assert isinstance(joint, JointByFormula)
                found[name] = found_by(joint, time, _locally(joint, self._owners, q))
        if inactive == now.inactive and found == now.found:
            return replace(now)
        return self.of(whole, inactive, found)

    def struck(
        self, whole: EquationsOfMotion, now: Configuration, event: str, impacts: Iterable[Impact]
    ) -> Struck:
        """What the impacts of an event throw back, with all that is active."""
        rest = self._without(now.inactive, now.found)
        restitution: dict[str, float] = {}
        gaps: list[str] = []
        for one in impacts:
            part: Part = (
                one.on if isinstance(one.on, Joint) else ClosedGap(_unused(event, rest), one.on)
            )
            if part.name in rest.parts:
                # It is held, and nothing of it moves.
                continue
            rest.parts[part.name] = part
            names = [f"{part.name}.{x.name}" for s in part.constraints() for x in s.multipliers]
            restitution |= dict.fromkeys(names, one.restitution)
            gaps += names if isinstance(part, ClosedGap) else []
        shared = {name: getattr(whole, name) for name in ("q0", "v0", "length", "parts")}
        return Struck(replace(self.build(rest), **shared), restitution, frozenset(gaps))

    @property
    def _owners(self) -> Owners:
        return owners_of(self.mechanism)

    def _without(self, inactive: frozenset[str], found: Found) -> Mechanism:
        rest = copy(self.mechanism)
        rest.parts = {
            name: AsFound(part, found[name]) if name in found else part  # type: ignore[arg-type]
            for name, part in self.mechanism.parts.items()
            if name not in inactive
        }
        rest.observables, rest.events, rest.inactive = {}, [], set()
        return rest


def _unused(event: str, mechanism: Mechanism) -> str:
    """A name for the gap of an event that no part has."""
    name, count = event, 1
    while name in mechanism.parts:
        count += 1
        name = f"{event} {count}"
    return name


def _locally(part: JointByFormula, owners: Owners, q: Array) -> Array:
    """The local coordinates of the points of a joint."""
    pieces = part._pieces
    return np.concatenate([x.operator @ q[owners.slice(x.owner)] for x in pieces])


def configurations_of(
    mechanism: Mechanism, build: Callable[[Mechanism], EquationsOfMotion]
) -> Configurations | None:
    """The configurations of a mechanism whose parts are switched; None where none are.

    Raises
    ------
    BeamdaeError
        If a part that is switched is unknown, or brings coordinates along.
    """
    switches = [x for event in mechanism.events for x in switches_of(event.do)]
    names = {name for switch in switches for name in (*switch.on, *switch.off)}
    for name in sorted(names | mechanism.inactive):
        if len(mechanism.part(name).coordinates):
            raise BeamdaeError(
                f"{name}: it brings coordinates along, only joints and forces can be switched."
            )
    acting = any(impacts_of(event.do) for event in mechanism.events)
    if not (names or mechanism.inactive or acting):
        return None
    return Configurations(mechanism, build, frozenset(mechanism.inactive))
