"""Where a run ended, to go on from there: in memory, or in a file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.events import DIRECTIONS
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results.outcome import PILOT_RUN_SUFFIX
from beamdae.results.storage.files import require_file_path, write_text

if TYPE_CHECKING:
    from beamdae.results.solution import Solution

_FORMAT, _VERSION = "beamdae checkpoint", 3
_CHECKSUM = "checksum"


def state_hash(t: float, q: Any, v: Any) -> str:
    """Hash of time, positions and velocities: that of no other run."""
    return hashlib.sha256(np.concatenate([[t], q, v]).tobytes()).hexdigest()


def _doubt(solution: Solution) -> str:
    """Why the end of a run is not to be trusted, or nothing."""
    status, due = solution.status, any(not one.done for one in solution.event_records)
    doubtful = status.leaves_doubt(due) or PILOT_RUN_SUFFIX in status.sentence
    return status.sentence if doubtful else ""


def _checksum(told: dict[str, Any]) -> str:
    """Of all that a file says but for the checksum itself; how it is laid out does not matter."""
    said = json.dumps({name: x for name, x in told.items() if name != _CHECKSUM})
    return hashlib.sha256(said.encode()).hexdigest()


def _listed(names: Any) -> list[str]:
    if not isinstance(names, list):
        raise TypeError
    return [str(name) for name in names]


@dataclass(frozen=True)
class Checkpoint:
    """The last state of a run.

    Attributes
    ----------
    t
        Its time [s].
    q, v
        Coordinates and velocities by the name of the coordinate.
    events
        Events that happened at that very time: they are not to happen there again.
    due
        Those that happened there and have not done what they are to do yet: "up" or "down" by name.
    inactive
        Joints and forces that events have switched off.
    found
        What joints hold that were switched on as they were, by name.
    model, parameters
        What ran: the name of the model, and its parameters as texts.
    doubt
        Why the state is not to be trusted, a sentence on how the run ended, or nothing.
    sides
        On which sides of their values the quantities of events were, see `Solution.event_signs`.
    identity
        Of its equations, see `hash_model`; none where the state is an equilibrium, from which any
        model may begin that has the coordinates.
    """

    t: float
    q: dict[str, float]
    v: dict[str, float]
    events: tuple[str, ...] = ()
    due: dict[str, str] = field(default_factory=dict)
    inactive: tuple[str, ...] = ()
    found: dict[str, FrozenGap] = field(default_factory=dict)
    model: str = ""
    parameters: dict[str, str] = field(default_factory=dict)
    identity: str = ""
    event_signs: dict[str, int] = field(default_factory=dict)
    doubt: str = ""

    @classmethod
    def of(cls, solution: Solution) -> Checkpoint:
        """Where a run ended, whatever ended it."""
        end, names = solution.trajectory.end, solution.equations.q_names
        last = solution.trajectory.intervals[-1]
        q, v = (x[-1].tolist() for x in last.state[:2])
        active = last.configuration
        at_end = [one for one in solution.event_records if one.t == end]
        return cls(
            end,
            dict(zip(names, q, strict=True)),
            dict(zip(names, v, strict=True)),
            tuple(one.name for one in at_end if one.done),
            {one.name: one.direction for one in at_end if not one.done},
            () if active is None else tuple(sorted(active.inactive)),
            {} if active is None else dict(active.frozen_gaps),
            str(solution.model.get("name", "")),
            {k: str(x) for k, x in solution.model.get("parameters", {}).items()},
            hash_model(solution.equations),
            dict(solution.event_signs),
            _doubt(solution),
        )

    @property
    def state(self) -> str:
        """See `state_hash`."""
        return state_hash(self.t, list(self.q.values()), list(self.v.values()))

    @classmethod
    def read(cls, path: str | Path) -> Checkpoint:
        """One that `write` wrote.

        Raises
        ------
        BeamdaeError
            If it cannot be read, or is no checkpoint of this version.
        """
        try:
            told = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as problem:
            why = problem.strerror or problem
            raise BeamdaeError(f"{path}: it cannot be read, {why}.") from None
        except (ValueError, RecursionError):
            told = None
        if not isinstance(told, dict) or told.get("format") != _FORMAT:
            raise BeamdaeError(f"{path}: it is no checkpoint, or not all of one.")
        if told.get("version") != _VERSION:
            raise BeamdaeError(
                f"{path}: it is a checkpoint of version {short_repr(told.get('version'))}, and this "
                f"beamdae takes those of version {_VERSION}; run the model again from its start."
            )
        if told.get(_CHECKSUM) != _checksum(told):
            raise BeamdaeError(f"{path}: the checkpoint is damaged, its checksum is another.")
        try:
            t, states = float(told["t"]), told["states"]
            q, v = ({str(k): float(x[i]) for k, x in states.items()} for i in range(2))
            parameters = {str(k): str(x) for k, x in told["parameters"].items()}
            events, inactive = (tuple(_listed(told[x])) for x in ("events", "inactive"))
            due = {str(k): str(x) for k, x in told["due"].items()}
            found = {
                str(k): FrozenGap(tuple(map(float, x["found"])), str(x["event"]), float(x["since"]))
                for k, x in told["found"].items()
            }
            event_signs = {str(k): int(x) for k, x in told["sides"].items()}
            model, identity, doubt = (str(told[x]) for x in ("model", "identity", "doubt"))
        except (KeyError, TypeError, ValueError, AttributeError, IndexError):
            raise BeamdaeError(f"{path}: the checkpoint is damaged.") from None
        if not np.isfinite([t, *q.values(), *v.values()]).all():
            raise BeamdaeError(f"{path}: the checkpoint holds numbers that are not finite.")
        known = (events, due, inactive, found, model, parameters, identity, event_signs, doubt)
        return cls(t, q, v, *known)

    def write(self, path: str | Path) -> Path:
        """Write it as JSON; the file appears whole or not at all.

        Raises
        ------
        BeamdaeError
            If it cannot be written.
        """
        file = require_file_path("checkpoint", path)
        told = asdict(self)
        told["sides"] = told.pop("event_signs")
        q, v = told.pop("q"), told.pop("v")
        states = {name: [q[name], v[name]] for name in q}
        whole = {"format": _FORMAT, "version": _VERSION, **told, "states": states}
        whole[_CHECKSUM] = _checksum(whole)
        return write_text(file, json.dumps(whole, indent=2) + "\n")

    def starting(self, equations: EquationsOfMotion) -> EquationsOfMotion:
        """The equations, to start from here.

        Raises
        ------
        BeamdaeError
            If it is of a model with other coordinates, naming the first one that differs, or of one
            whose events switch parts where none do here.
        """
        own, others = list(self.q), list(equations.q_names)
        for k in range(max(len(own), len(others))):
            has, wants = (x[k] if k < len(x) else None for x in (own, others))
            if has != wants:
                raise BeamdaeError(
                    f"start: it is of another model, coordinate {k + 1} is "
                    f"{short_repr(has)} there and {short_repr(wants)} here."
                )
        events = tuple(
            replace(
                term,
                begins_there=term.name in self.events,
                due=DIRECTIONS.get(self.due.get(term.name, ""), 0),
                side=self.event_signs.get(term.name, 0),
            )
            for term in equations.events
        )
        q, v = (np.array([x[name] for name in others]) for x in (self.q, self.v))
        known = equations.configurations
        switched = sorted({*self.inactive, *self.found})
        if known is not None:
            known = replace(
                known, initially_inactive=frozenset(self.inactive), frozen_gaps=self.found
            )
        elif switched:
            raise BeamdaeError(
                f"start: events had switched {', '.join(switched)}, and in this model none do; "
                "give it the same events."
            )
        return replace(equations, q0=q, v0=v, events=events, configurations=known)

    def difference(self, equations: EquationsOfMotion, parameters: dict[str, Any]) -> str:
        """What is other than in the run it is of, a phrase, or nothing."""
        changed = [
            f"{name} was {self.parameters[name]}"
            for name, value in parameters.items()
            if name in self.parameters and self.parameters[name] != str(value)
        ]
        if changed:
            return f"other parameters, {', '.join(changed)}"
        same = not self.identity or hash_model(equations) == self.identity
        return "" if same else "other numbers or formulas"
