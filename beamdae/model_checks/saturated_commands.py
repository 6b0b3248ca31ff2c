"""Warnings about commands of controllers that are at a limit during the whole run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.commands import compile_commands
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent
from beamdae.results.trajectory import Trajectory

_MIN_SHARE = 0.95  # of the run; the command is at the limit at its end, too
_SAMPLES = 1001  # times at which commands are evaluated
_ROUNDING = 1e-9  # of the distance between both limits


def saturated_command_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield one warning per limited command that is at one limit for over 95 % of a run.

    Limits in the laws of sampled controllers are not known.
    """
    commands = [x for x in compile_commands(equations) if x.has_limits]
    if not commands or not trajectory.end > trajectory.start:
        return
    at = trajectory.at(np.linspace(trajectory.start, trajectory.end, _SAMPLES))
    for command in commands:
        values, low, high = command.evaluate(*at), command.low, command.high
        rounding = _ROUNDING * (high - low)
        for limit, is_beyond in (
            (low, values <= low + rounding),
            (high, values >= high - rounding),
        ):
            share = float(np.mean(is_beyond))
            if share > _MIN_SHARE and is_beyond[-1]:
                yield (
                    f"{command.name} is at its limit {limit:.4g} during {format_percent(share)} of "
                    f"the run, so there is no feedback (its median without limits is "
                    f"{np.median(values):.3g}); check the sign of the measured value, the unit of "
                    "the target, and the limits."
                )
