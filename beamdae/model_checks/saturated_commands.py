"""Warnings about commands of controllers that are at a limit during the whole run."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator

import numpy as np

from beamdae.equations.commands import compile_commands
from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, format_percent
from beamdae.model_checks.switching_laws import is_switch
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MIN_SHARE = 0.95  # of the run; the command is at the limit at its end, too
_SAMPLES = 1001  # times at which commands are evaluated
_ROUNDING = 1e-9  # of the distance between both limits
# Changes of a measured value at which the law of a sampled controller is called, relative to the
# largest value of the run: units may differ by a factor of 1e6.
_CHANGES = np.outer([-1.0, 1.0], 10.0 ** np.arange(8)).ravel()
_MEASURED_SAMPLES = 33  # in which the largest measured values are sought


def saturated_command_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield one warning per limited command that is at one limit for over 95 % of a run.

    Values in laws have a warning only between a negative and a positive limit: others may be those
    of parts that act in one direction, or not at all, such as end stops. This also holds for the
    laws of sampled controllers.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    if not trajectory.end > trajectory.start:
        return
    commands = [
        x
        for x in compile_commands(equations)
        if x.has_limits and (x.is_output or x.low < 0.0 < x.high)
    ]
    if not (commands or equations.controllers):
        return
    at = trajectory.at(np.linspace(trajectory.start, trajectory.end, _SAMPLES))
    for command in commands:
        low, high = command.low, command.high
        values = command.evaluate(*at)[:, 0]
        rounding = _ROUNDING * (high - low)
        for limit, is_beyond in (
            (low, values <= low + rounding),
            (high, values >= high - rounding),
        ):
            median = f" (without limits, its median is {np.median(values):.3g})"
            yield from _describe_saturation(command.name, limit, is_beyond, median)
    for stream, term in enumerate(equations.controllers):
        for k, drive in enumerate(term.controller.drives):
            values = at[1].q[:, term.rows.start + k]
            name = f"{term.controller.name}: {drive.name}"
            is_held = np.abs(values - values[-1]) <= _ROUNDING * abs(values[-1])
            for warning in _describe_saturation(name, values[-1], is_held):
                if _is_limit(equations, trajectory, stream, k):
                    yield warning


def _describe_saturation(
    name: str, limit: float, is_beyond: Array, median: str = ""
) -> Iterator[str]:
    """Yield a warning if a command is at or beyond the limit for most of a run and at its end."""
    share = float(np.mean(is_beyond))
    if share > _MIN_SHARE and is_beyond[-1]:
        yield (
            f"{name} is at its limit {limit:.4g} during {format_percent(share)} of the run and at "
            f"its end, so that there is no feedback{median}; check the sign of the measured "
            "value, the unit of the target, and the limits."
        )


def _is_limit(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int
) -> bool:
    """Return True if the last value of a driven input is a limit of the law of its controller.

    The law is called with other measured values at the last sample. Its value is a limit if it is
    the smallest or largest one, others have the opposite sign, and there are values between them.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    stream, drive
        Number of the controller in the mechanism, and number of its driven input.
    """
    term = equations.controllers[stream]
    controller = term.controller
    every = controller.every
    # A sample at the end of a run has no effect.
    last = max(int(np.ceil(trajectory.end / every - _ROUNDING)) - 1, 0)
    first = min(int(np.ceil(trajectory.start / every - _ROUNDING)), last)
    if every * last < trajectory.start:
        return False
    samples = np.unique(np.linspace(first, last, _MEASURED_SAMPLES).astype(int))
    times, states = trajectory.at(every * samples)
    reads = evaluate_reads(term, equations.p, times, states)
    before = trajectory.positions_at(np.array([max(every * (last - 0.5), trajectory.start)]))
    # The newest values of the queue follow from the last sample.
    newest = len(controller.drives) * controller.delay + drive

    def evaluate(measured: Array) -> float:
        values = controller.next_values(every * last, last, measured, before[0, term.rows], stream)
        return float(values[newest])

    sizes = np.abs(reads).max(axis=0)
    changes = np.diag(np.where(sizes > 0.0, sizes, 1.0))
    others = {}
    with warnings.catch_warnings():
        # Those of the law at measured values that do not occur in the run.
        warnings.simplefilter("ignore")
        for measured in (reads[-1] + x * change for x in _CHANGES for change in changes):
            with contextlib.suppress(BeamdaeError):
                others[evaluate(measured)] = measured
        try:
            limit = evaluate(reads[-1])
        except BeamdaeError:
            return False
        low, high = min([limit, *others]), max([limit, *others])
        if limit not in (low, high) or low * high >= 0.0:
            return False
        opposite = low if limit == high else high
        return not is_switch(evaluate, reads[-1], others[opposite], (limit, opposite))
