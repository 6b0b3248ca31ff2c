"""Mechanisms some of whose joints and forces are inactive: equations of the others alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.errors import BeamdaeError
from beamdae.parts.events import Impact, select_impacts, select_switches
from beamdae.parts.joints.event_constraints import (
    ClosedGap,
    FrozenConstraint,
    FrozenGap,
    evaluate_frozen_gap,
)
from beamdae.parts.joints.joint import Joint, JointByFormula
from beamdae.parts.laws import Law, shift_law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part

Array = np.ndarray
# What joints that were switched on as they were hold, by name.
FrozenGaps = Mapping[str, FrozenGap]


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
    multiplier_rows: Array
    inactive: frozenset[str]
    frozen_gaps: FrozenGaps = field(default_factory=dict)

    def select_multipliers(self, lam: Array) -> Array:
        """Of rows of all multipliers those that there are."""
        return lam[:, self.multiplier_rows]

    def expand_multipliers(self, lam: Array, m: int) -> Array:
        """Rows of all `m` multipliers: those of inactive parts are zero."""
        found = np.zeros((len(lam), m))
        found[:, self.multiplier_rows] = lam
        return found


@dataclass(frozen=True)
class ImpactEquations:
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
    initially_inactive: frozenset[str]
    frozen_gaps: FrozenGaps = field(default_factory=dict)
    _known: dict[frozenset[str], EquationsOfMotion] = field(default_factory=dict, init=False)

    def initial_configuration(self, whole: EquationsOfMotion) -> Configuration:
        """The one at the start of a run; `whole` are the equations of all parts."""
        return self.configuration_without(whole, self.initially_inactive, self.frozen_gaps)

    def configuration_without(
        self, whole: EquationsOfMotion, inactive: frozenset[str], found: FrozenGaps
    ) -> Configuration:
        """The one without these parts, some joints of which hold what was `found`."""
        if found:
            # What was found once is not found again.
            built = self.build(self._without(inactive, found))
        elif inactive in self._known:
            built = self._known[inactive]
        else:
            built = self._known[inactive] = self.build(self._without(inactive, found))
        # What a run goes by must not change on the way.
        shared = {name: getattr(whole, name) for name in ("q0", "v0", "length", "parts")}
        scales = [x.time_scale for x in (whole, built) if x.time_scale is not None]
        equations = replace(
            built,
            breakpoints=tuple(sorted({*whole.breakpoints, *built.breakpoints})),
            time_scale=min(scales, default=None),
            laws=(*whole.laws, *(built.laws if found else ())),
            **shared,
        )
        rows = {name: k for k, name in enumerate(whole.lam_names)}
        held = np.array([rows[name] for name in equations.lam_names], int)
        return Configuration(equations, held, inactive, dict(found))

    def configuration_after(
        self,
        whole: EquationsOfMotion,
        now: Configuration,
        event: EventTerm,
        time: Array,
        q: Array,
    ) -> Configuration:
        """The one after an event has switched parts at time = (t, branch)."""
        inactive, found = now.inactive, dict(now.frozen_gaps)
        for switch in select_switches(event.do):
            inactive = inactive.difference(switch.on).union(switch.off)
            for name in (*switch.on, *switch.off):
                found.pop(name, None)
            changed = dict(switch.laws)
            for name in switch.as_is:
                held = (
                    FrozenGap((), event.name, float(time[0])) if name in changed else FrozenGap(())
                )
                found[name] = self._finding(name, held, time, q)
        if inactive == now.inactive and found == now.frozen_gaps:
            return replace(now)
        return self.configuration_without(whole, inactive, found)

    def impact_equations(
        self, whole: EquationsOfMotion, now: Configuration, event: str, impacts: Iterable[Impact]
    ) -> ImpactEquations:
        """What the impacts of an event throw back, with all that is active."""
        rest = self._without(now.inactive, now.frozen_gaps)
        restitution: dict[str, float] = {}
        gaps: list[str] = []
        for one in impacts:
            part: Part = (
                one.on
                if isinstance(one.on, Joint)
                else ClosedGap(_unused_name(event, rest), one.on)
            )
            if part.name in rest.parts:
                # It is held, and nothing of it moves.
                continue
            rest.parts[part.name] = part
            names = [f"{part.name}.{x.name}" for s in part.constraints() for x in s.multipliers]
            restitution |= dict.fromkeys(names, one.restitution)
            gaps += names if isinstance(part, ClosedGap) else []
        shared = {name: getattr(whole, name) for name in ("q0", "v0", "length", "parts")}
        return ImpactEquations(replace(self.build(rest), **shared), restitution, frozenset(gaps))

    def _finding(self, name: str, held: FrozenGap, time: Array, q: Array) -> FrozenGap:
        """With what a joint finds at time = (t, branch)."""
        joint, law = self.mechanism.part(name), self._law(name, held)
        assert isinstance(joint, JointByFormula)
        owners, pieces = map_coordinates(self.mechanism), joint._pieces
        local = np.concatenate([x.operator @ q[owners.slice(x.owner)] for x in pieces])
        # A law that begins here is on its own first piece.
        at = time if law is None else time[[0, 0]]
        return replace(held, found=evaluate_frozen_gap(joint, law, at, local))

    def _law(self, name: str, held: FrozenGap) -> Law | None:
        """The law that an event has a joint follow; None if it is its own."""
        if not held.event:
            return None
        for event in self.mechanism.events:
            laws = dict(law for switch in select_switches(event.do) for law in switch.laws)
            if event.name == held.event and name in laws:
                return shift_law(laws[name], held.since)
        raise BeamdaeError(
            f"{name}: it follows the law that event {held.event} gave it at t = {held.since:g} s, "
            "and there is no such event in this model."
        )

    def _held(self, part: Part, held: FrozenGap) -> FrozenConstraint:
        if not isinstance(part, JointByFormula) or len(part.multipliers) != len(held.found):
            raise BeamdaeError(
                f"{part.name}: an event before the start had it hold what it found, "
                f"{len(held.found)} numbers, which it cannot in this model."
            )
        return FrozenConstraint(part, held.found, self._law(part.name, held))

    def _without(self, inactive: frozenset[str], found: FrozenGaps) -> Mechanism:
        rest = copy(self.mechanism)
        rest.parts = {
            name: self._held(part, found[name]) if name in found else part
            for name, part in self.mechanism.parts.items()
            if name not in inactive
        }
        rest.observables, rest.events, rest.inactive = {}, [], set()
        return rest


def _unused_name(event: str, mechanism: Mechanism) -> str:
    """A name for the gap of an event that no part has."""
    name, count = event, 1
    while name in mechanism.parts:
        count += 1
        name = f"{event} {count}"
    return name


def build_configurations(
    mechanism: Mechanism, build: Callable[[Mechanism], EquationsOfMotion]
) -> Configurations | None:
    """The configurations of a mechanism whose parts are switched; None where none are.

    Raises
    ------
    BeamdaeError
        If a part that is switched is unknown, or brings coordinates along.
    """
    switches = [x for event in mechanism.events for x in select_switches(event.do)]
    names = {name for switch in switches for name in (*switch.on, *switch.off)}
    for name in sorted(names | mechanism.inactive):
        if len(mechanism.part(name).coordinates):
            raise BeamdaeError(
                f"{name}: it brings coordinates along, only joints and forces can be switched."
            )
    acting = any(select_impacts(event.do) for event in mechanism.events)
    if not (names or mechanism.inactive or acting):
        return None
    return Configurations(mechanism, build, frozenset(mechanism.inactive))
