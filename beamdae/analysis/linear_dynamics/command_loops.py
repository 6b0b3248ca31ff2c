"""Loops of continuous controllers, opened at the command of a `pid`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.analysis.linear_dynamics.linear_model import (
    LinearModel,
    ModelInput,
    StateReduction,
    differentiate_part_laws,
)
from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.commands import compile_commands, differentiate_laws
from beamdae.errors import BeamdaeError
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.signals import State as SignalState
from beamdae.symbolic.statements import Variable

Array = np.ndarray


def inject_at_command(lin: Linearization, name: str) -> LinearModel:
    """Return the linear model from a disturbance, added to the output of a `pid`, to this output.

    All loops are closed. The first output of the model is the command before the disturbance.

    Parameters
    ----------
    lin
        Linearized mechanism.
    name
        Name of the controller, one of `Mechanism.outputs`.

    Raises
    ------
    BeamdaeError
        If the command is at or beyond its limits, no law contains it, or one contains it in a way
        that cannot be differentiated.
    """
    mechanism = lin.equations.mechanism
    assert mechanism is not None
    commands = compile_commands(lin.equations)
    command = next((x for x in commands if x.is_output and x.name.startswith(f"{name}: ")), None)
    if command is None:
        raise BeamdaeError(
            f"margins: the command of {name} does not depend on the motion, so there is no loop; "
            "use sensors in its error."
        )
    if command.has_limits:
        value, limit, distance = command.excess(lin.time, *lin.state[:2])
        if distance >= 0.0:
            raise BeamdaeError(
                f"margins: the command of {name} {value:.4g} is at or beyond its limit "
                f"{limit:.4g}, where the loop is open; linearize about a state with a command "
                "between its limits."
            )
    force = _differentiate_residual(lin, mechanism, name)
    full = lin.full_equations
    first = len(full.p)
    shifted = slice(first + command.observable.data.start, first + command.observable.data.stop)
    observable = replace(command.observable, data=shifted)
    numbers = np.concatenate([full.p, command.numbers])
    extended = replace(lin, full_equations=replace(full, p=numbers))
    disturbance = ModelInput(Variable(name, "-"), force, {})
    return StateReduction(extended, [disturbance]).linear_model([observable])


def _differentiate_residual(lin: Linearization, mechanism: Mechanism, name: str) -> Array:
    """Return the derivative of the residual with respect to a disturbance of the command, (n,)."""
    force, is_used = np.zeros(lin.equations.n), False
    for part, slopes in differentiate_laws(mechanism, name, lin.time, lin.state):
        is_used = True
        if isinstance(part, SignalState):
            # The row of the state is x' - rate.
            force[map_coordinates(mechanism).slice_of(part)] -= slopes[0]
        elif len(part.inputs) == len(slopes):
            inputs = differentiate_part_laws(mechanism, part, lin)
            force += sum(slope * x.force for slope, x in zip(slopes, inputs, strict=True))
        else:
            raise BeamdaeError(
                f"margins: the loop cannot be opened at {name} because {part.name} is not a force, "
                "a moment or a state; open it at an input instead."
            )
    if not is_used:
        raise BeamdaeError(
            f"margins: no law of a part contains the output of {name}; pass it to a force, a "
            "moment or a state as it is, or in a formula."
        )
    return force
