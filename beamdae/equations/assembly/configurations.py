"""Equations of mechanisms whose joints and forces are switched on and off by events."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.assembly.coordinate_map import CoordinateMap
from beamdae.equations.equations_of_motion import (
    Configuration,
    EquationsOfMotion,
    EventTerm,
    ImpactEquations,
)
from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.events import Impact, select_impacts, select_switches
from beamdae.parts.joints.event_constraints import (
    ClosedGap,
    FrozenConstraint,
    FrozenGap,
    FrozenGaps,
    evaluate_frozen_gap,
)
from beamdae.parts.joints.joint import Joint, KinematicConstraint
from beamdae.parts.laws import Law, shift_law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part

Array = np.ndarray

# Fields taken from the equations of all parts, so that scales do not change during a run.
_SHARED_FIELDS = ("q0", "v0", "length", "parts", "controllers")


@dataclass(eq=False)
class Configurations:
    """Configurations of a mechanism, assembled when they are first needed.

    `whole` denotes the equations of all parts; times are arrays (t, branch).

    Attributes
    ----------
    mechanism
        Mechanism with all parts.
    coordinates
        Coordinate map of all parts.
    assemble
        Function that assembles the equations of a mechanism.
    initially_inactive
        Names of the parts that are inactive at the start of a run.
    switched_parts
        Names of the parts that are inactive at times.
    frozen_gaps
        Gaps of joints that events before the start activated with `as_is=True`, by name of the
        joint.
    """

    mechanism: Mechanism
    coordinates: CoordinateMap
    assemble: Callable[[Mechanism], EquationsOfMotion]
    initially_inactive: frozenset[str]
    switched_parts: frozenset[str]
    frozen_gaps: FrozenGaps = field(default_factory=dict)
    _assembled: dict[frozenset[str], EquationsOfMotion] = field(default_factory=dict, init=False)

    def starting_with(self, inactive: frozenset[str], frozen_gaps: FrozenGaps) -> Configurations:
        """Return a copy with these parts inactive and these gaps frozen at the start of a run."""
        return replace(self, initially_inactive=inactive, frozen_gaps=frozen_gaps)

    def initial_configuration(self, whole: EquationsOfMotion) -> Configuration:
        """Return the configuration at the start of a run."""
        return self.configuration_without(whole, self.initially_inactive, self.frozen_gaps)

    def configuration_without(
        self, whole: EquationsOfMotion, inactive: frozenset[str], frozen_gaps: FrozenGaps
    ) -> Configuration:
        """Return the configuration with these parts inactive and these gaps frozen.

        Raises
        ------
        BeamdaeError
            If a name is not that of a part without coordinates, or a frozen gap does not fit its
            joint or the events of the mechanism.
        """
        for name in sorted({*inactive, *frozen_gaps}):
            part = self.mechanism.parts.get(name)
            if part is None or len(part.coordinates):
                raise BeamdaeError(
                    f"{short_repr(name)}: an earlier run switched this part, but the model has no "
                    "joint or force of this name; use the model of the earlier run."
                )
        # Not cached with frozen gaps, because the same offsets do not recur.
        active = None if frozen_gaps else self._assembled.get(inactive)
        if active is None:
            active = self.assemble(self._active_mechanism(inactive, frozen_gaps))
        if not frozen_gaps:
            self._assembled[inactive] = active
        time_scales = [x.time_scale for x in (whole, active) if x.time_scale is not None]
        equations = replace(
            active,
            breakpoints=tuple(sorted({*whole.breakpoints, *active.breakpoints})),
            time_scale=min(time_scales, default=None),
            laws=(*whole.laws, *(active.laws if frozen_gaps else ())),
            **_shared_fields(whole),
        )
        index = {name: k for k, name in enumerate(whole.lam_names)}
        rows = np.array([index[name] for name in equations.lam_names], int)
        return Configuration(equations, rows, inactive, dict(frozen_gaps))

    def configuration_after(
        self,
        whole: EquationsOfMotion,
        now: Configuration,
        event: EventTerm,
        time: Array,
        q: Array,
    ) -> Configuration:
        """Return the configuration after the actions of an event at `time` and positions `q`."""
        inactive, frozen_gaps = now.inactive, dict(now.frozen_gaps)
        for switch in select_switches(event.do):
            inactive = inactive.difference(switch.on).union(switch.off)
            for name in (*switch.on, *switch.off):
                frozen_gaps.pop(name, None)
            follows_event = dict(switch.laws)
            for name in switch.as_is:
                gap = FrozenGap(())
                if name in follows_event:
                    gap = FrozenGap((), event.name, float(time[0]))
                joint, law = self.mechanism.part(name), self._event_law(name, gap)
                assert isinstance(joint, KinematicConstraint)
                pieces = [point.piece for point in joint.points.values()]
                rows = [q[self.coordinates.slice_of(x.owner)] for x in pieces]
                local = [x.operator @ y for x, y in zip(pieces, rows, strict=True)]
                # A law that begins here is evaluated on its first branch.
                law_time = time if law is None else time[[0, 0]]
                offsets = evaluate_frozen_gap(joint, law, law_time, np.concatenate(local))
                frozen_gaps[name] = replace(gap, offsets=offsets)
        if inactive == now.inactive and frozen_gaps == now.frozen_gaps:
            return replace(now)
        return self.configuration_without(whole, inactive, frozen_gaps)

    def impact_equations(
        self, whole: EquationsOfMotion, now: Configuration, event: str, impacts: Iterable[Impact]
    ) -> ImpactEquations:
        """Return the equations of all active parts and of the impacts of an event."""
        mechanism = self._active_mechanism(now.inactive, now.frozen_gaps)
        restitution: dict[str, float] = {}
        gaps: list[str] = []
        for impact in impacts:
            part: Part
            if isinstance(impact.on, Joint):
                part = impact.on
            else:
                part = ClosedGap(_unused_name(event, mechanism), impact.on.current)
            if part.name in mechanism.parts:
                # An active joint has no relative velocity to reverse.
                continue
            mechanism.parts[part.name] = part
            names = [f"{part.name}.{x.name}" for s in part.constraints() for x in s.multipliers]
            restitution |= dict.fromkeys(names, impact.restitution)
            gaps += names if isinstance(part, ClosedGap) else []
        equations = replace(self.assemble(mechanism), **_shared_fields(whole))
        return ImpactEquations(equations, restitution, frozenset(gaps))

    def _event_law(self, name: str, gap: FrozenGap) -> Law | None:
        """Return the law that an event set for joint `name`; None if no event did."""
        if not gap.event:
            return None
        for event in self.mechanism.events:
            laws = dict(law for switch in select_switches(event.do) for law in switch.laws)
            if event.name == gap.event and name in laws:
                return shift_law(laws[name], gap.since)
        raise BeamdaeError(
            f"{name}: the law of this driver was set by event {gap.event} at t = "
            f"{gap.since:g} s, but no event with this name sets a law for it in this model; use "
            "the model of the earlier run."
        )

    def _active_mechanism(self, inactive: frozenset[str], frozen_gaps: FrozenGaps) -> Mechanism:
        """Return the mechanism without the inactive parts and with these gaps frozen."""
        parts: dict[str, Part] = {}
        for name, part in self.mechanism.parts.items():
            if name in inactive:
                continue
            if name not in frozen_gaps:
                parts[name] = part
                continue
            gap = frozen_gaps[name]
            if not isinstance(part, KinematicConstraint) or part._n_gap_rows != len(gap.offsets):
                raise BeamdaeError(
                    f"{name}: an earlier event froze this joint with offsets "
                    f"{short_repr(gap.offsets)}, which do not fit the part of this name; use "
                    "the model of the earlier run."
                )
            parts[name] = FrozenConstraint(part, gap.offsets, self._event_law(name, gap))
        mechanism = copy(self.mechanism)
        mechanism.parts = parts
        mechanism.observables, mechanism.events, mechanism.inactive = {}, [], set()
        mechanism.removed = self.mechanism.removed | inactive
        return mechanism


def _shared_fields(whole: EquationsOfMotion) -> dict:
    return {name: getattr(whole, name) for name in _SHARED_FIELDS}


def _unused_name(event: str, mechanism: Mechanism) -> str:
    """Return the name of an event, with a number if a part has this name."""
    name, count = event, 1
    while name in mechanism.parts:
        count += 1
        name = f"{event} {count}"
    return name


def build_configurations(
    mechanism: Mechanism,
    coordinates: CoordinateMap,
    assemble: Callable[[Mechanism], EquationsOfMotion],
) -> Configurations | None:
    """Return the configurations of a mechanism whose active parts or constraints can change.

    Returns None if no part is inactive at the start and no event switches parts or causes an
    impact.

    Raises
    ------
    BeamdaeError
        If a switched or inactive part is unknown or has coordinates.
    """
    switches = [x for event in mechanism.events for x in select_switches(event.do)]
    names = {name for switch in switches for name in (*switch.on, *switch.off)}
    for name in sorted(names | mechanism.inactive):
        if len(mechanism.part(name).coordinates):
            raise BeamdaeError(
                f"{name}: a part with coordinates cannot be switched or inactive; "
                "switch joints and forces instead."
            )
    has_impacts = any(select_impacts(event.do) for event in mechanism.events)
    if not (names or mechanism.inactive or has_impacts):
        return None
    inactive = frozenset(mechanism.inactive)
    return Configurations(mechanism, coordinates, assemble, inactive, inactive | names)
