"""Checkpoints: the last state of a run, from which another run can resume."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError, require_finite, short_repr
from beamdae.input_files import CHECKPOINT, register_input
from beamdae.parts.events import DIRECTIONS
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.read_only import read_only_data
from beamdae.results.outcome import PILOT_RUN_SUFFIX
from beamdae.results.run_data import RunData
from beamdae.results.storage.documents import FileKind, Format

# Files of runs, whose last states are checkpoints.
SAVED_RUN, SAVED_RUN_VERSION = FileKind("saved run", "simulate and save the run again"), 5


@read_only_data
@dataclass(frozen=True)
class Checkpoint:
    """Last state of a run, from which another run can resume.

    Attributes
    ----------
    t
        Time of the state [s].
    q, v
        Coordinates [m or rad] and velocities [m/s or rad/s] by coordinate name.
    events
        Names of the events that were executed at this time and do not occur again at the start of
        the resumed run.
    due
        Events that occurred at this time but were not executed: direction "up" or "down" by event
        name.
    inactive
        Names of the inactive joints and forces.
    frozen_gaps
        Gaps that joints keep because of an event, by joint name; see `FrozenGap`.
    model, parameters
        Name of the model function, and its parameters as strings; empty for other models.
    identity
        Hash of the equations, see `hash_model`. The hash of a checkpoint from an equilibrium path
        is empty, so that any model with the same coordinates can start from it.
    event_signs
        `Solution.event_signs` at this time.
    doubt
        Reason why the state may be wrong. Empty if the state is reliable.
    """

    t: float
    q: dict[str, float]
    v: dict[str, float]
    events: tuple[str, ...] = ()
    due: dict[str, str] = field(default_factory=dict)
    inactive: tuple[str, ...] = ()
    frozen_gaps: dict[str, FrozenGap] = field(default_factory=dict)
    model: str = ""
    parameters: dict[str, str] = field(default_factory=dict)
    identity: str = ""
    event_signs: dict[str, int] = field(default_factory=dict)
    doubt: str = ""

    @classmethod
    def of(cls, run: RunData) -> Checkpoint:
        """Return the checkpoint at the last state of a run, even if the run failed."""
        last, names = run.trajectory.intervals[-1], run.equations.q_names
        end = run.trajectory.end
        q, v = (x[-1].tolist() for x in last.state[:2])
        configuration = last.configuration
        records = [record for record in run.event_records if record.t == end]
        has_pending_event = any(not record.done for record in run.event_records)
        may_be_wrong = (
            run.status.is_unreliable(has_pending_event) or PILOT_RUN_SUFFIX in run.status.sentence
        )
        return cls(
            t=end,
            q=dict(zip(names, q, strict=True)),
            v=dict(zip(names, v, strict=True)),
            events=tuple(record.name for record in records if record.done),
            due={record.name: record.direction for record in records if not record.done},
            inactive=() if configuration is None else tuple(sorted(configuration.inactive)),
            frozen_gaps={} if configuration is None else dict(configuration.frozen_gaps),
            model=str(run.model.get("name", "")),
            parameters={k: str(x) for k, x in run.model.get("parameters", {}).items()},
            identity=hash_model(run.equations),
            event_signs=dict(run.event_signs),
            doubt=run.status.sentence if may_be_wrong else "",
        )

    @classmethod
    def read(cls, path: str | Path) -> Checkpoint:
        """Read the last state of a saved run.

        Raises
        ------
        BeamdaeError
            If the file cannot be read, or is not a saved run of the current version.
        """
        path = Path(path)
        # Decoding does not make data read-only.
        checkpoint = replace(_FORMAT.read_archive(path).checkpoint)
        for values in ({"t": checkpoint.t}, checkpoint.q, checkpoint.v):
            for name, value in values.items():
                require_finite(str(path), name, value)
        if list(checkpoint.q) != list(checkpoint.v):
            raise _FORMAT.kind.error(path, "q and v must have the same names")
        register_input(path, CHECKPOINT)
        return checkpoint

    def start_equations(
        self, equations: EquationsOfMotion, part: str = "start"
    ) -> EquationsOfMotion:
        """Return the equations that start from this state, with its active parts and events.

        Messages begin with `part`.

        Raises
        ------
        BeamdaeError
            If the equations have other coordinates, or parts are inactive or gaps frozen and the
            equations define no event that switches parts.
        """
        names, required = list(self.q), list(equations.q_names)
        for k in range(max(len(names), len(required))):
            name, other = (x[k] if k < len(x) else None for x in (names, required))
            if name != other:
                raise BeamdaeError(
                    f"{part}: coordinate {k + 1} is {short_repr(name)} in the start and "
                    f"{short_repr(other)} in the model; use the model and parameters of that run."
                )
        events = tuple(
            replace(
                term,
                occurred_at_start=term.name in self.events,
                due=DIRECTIONS.get(self.due.get(term.name, ""), 0),
                side=self.event_signs.get(term.name, 0),
            )
            for term in equations.events
        )
        q, v = (np.array([x[name] for name in required]) for x in (self.q, self.v))
        configurations = equations.configurations
        switched_parts = sorted({*self.inactive, *self.frozen_gaps})
        if configurations is not None:
            configurations = configurations.starting_with(
                frozenset(self.inactive), self.frozen_gaps
            )
        elif switched_parts:
            raise BeamdaeError(
                f"{part}: events of the earlier run switched "
                f"{', '.join(switched_parts)}, but no event of this model switches "
                "parts; define the same events."
            )
        return replace(equations, q0=q, v0=v, events=events, configurations=configurations)

    def describe_changes(self, equations: EquationsOfMotion, parameters: dict[str, Any]) -> str:
        """Describe the differences between a model and the model of the run.

        Returns an empty string if there are no differences.
        """
        changes = [
            f"{name} was {self.parameters[name]}"
            for name, value in parameters.items()
            if name in self.parameters and self.parameters[name] != str(value)
        ]
        if changes:
            return f"other parameters ({', '.join(changes)})"
        is_same = not self.identity or hash_model(equations) == self.identity
        return "" if is_same else "other numbers or formulas"


@dataclass(frozen=True)
class _LastState:
    """Last state of a saved run, whose other content is not read."""

    checkpoint: Checkpoint


_FORMAT = Format(SAVED_RUN, SAVED_RUN_VERSION, _LastState)
