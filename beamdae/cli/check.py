"""`beamdae check`: what a model is, without a run."""

from __future__ import annotations

from typing import Any

from beamdae.cli.options import ModelFile, ModelName, Settings
from beamdae.cli.run import configured
from beamdae.cli.saying import console


def check_command(path: ModelFile, settings: Settings = None, model_name: ModelName = None) -> None:
    """Build a model and find its consistent start, without integrating."""
    model = configured(path, model_name, settings)
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report import terminal

    mechanism = model()
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    facts = _start_facts(mechanism, model.t_end)
    for name, part in parts.items():
        facts |= {f"{name}, {what}": value for what, value in part.facts.items()}
    screen = console()
    screen.print(model.name, style="bold")
    if parts:
        screen.print(terminal.parts({name: type(part).__name__ for name, part in parts.items()}))
    screen.print(terminal.facts("", facts))


def _start_facts(mechanism: Any, t_end: float) -> dict[str, Any]:
    """Size of the equations of motion and what their consistent start is."""
    import numpy as np

    from beamdae.integrators.route import plan
    from beamdae.simulation import as_equations

    equations = as_equations(mechanism)
    state = plan(equations, np.array([0.0, t_end])).state
    moved = float(np.max(np.abs(state.q - equations.q0)))
    return {
        "coordinates": equations.n,
        "constraints": equations.m,
        "degrees of freedom": equations.n - equations.m,
        "characteristic length": f"{equations.length:.4g} m",
        "breakpoints": ", ".join(f"{b:g} s" for b in equations.breakpoints) or "none",
        "consistent start": f"found, coordinates moved by up to {moved:.3g} (m or rad)",
        "largest start reaction": float(np.max(np.abs(state.lam), initial=0.0)),
    }
