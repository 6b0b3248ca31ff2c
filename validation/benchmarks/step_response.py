"""Linear models beside runs of the nonlinear equations they are of: the answer to a small step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lsim

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about
from benchmarks.modes import FORMULATIONS

_SPEED, _JET, _END, _STEP = 20.0, 1e-3, 0.15, 1e-3


def arm(jet: float, formulation: str) -> bd.Mechanism:
    """A bent, damped strip on a hub that turns at 20 rad/s, with a jet at its tip [N]."""
    soft = bd.Material(E=1e9, nu=0.3, rho=1000.0)
    strip = bd.Section.rectangle(soft, width=0.02, height=0.01, damping=2e-4)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01))
    axle = mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)
    curve = bd.Arc(radius=0.5, length=0.6, start=(0.1, 0.0), angle=0.3)
    settings: dict[str, Any] = {"elements": 4, "formulation": formulation}
    beam = mech.add(bd.Beam("beam", curve, strip, **settings))
    mech.add(bd.Revolute("axle", *axle))
    mech.add(bd.Weld("root", hub.at(0.1, 0.0), beam.start))
    mech.add(bd.Driver("motor", *axle, law=lambda t: _SPEED * t))
    mech.add(bd.Force("jet", beam.end, (0.0, jet), axes="body"))
    mech.observe("root", beam.section_forces(0.0))
    return mech


def responses(formulation: str) -> tuple[np.ndarray, np.ndarray]:
    """The moment at the root after the step of the jet: of a run, and of the linear model."""
    turning = bd.rotation(_SPEED)
    model = bd.linearize(arm(0.0, formulation), turning, inputs=["jet"])
    steady = linearize_about("modes", arm(0.0, formulation), turning).state
    equations = bd.equations_of_motion(arm(_JET, formulation))
    stepped = replace(equations, q0=steady.q, v0=steady.v)
    run = bd.simulate(stepped, bd.Radau(1e-10), _END, output_step=_STEP)
    names = [named.header for named in model.outputs]
    k = names.index("root.M [N m]")
    _, answers, _ = lsim(model.state_space(), np.tile([0.0, _JET], (len(run.t), 1)), run.t)
    return run.columns[names[k]] - model.output_values[k], answers[:, k]


@dataclass(frozen=True)
class StepResponse:
    """The largest moments of both, and where they differ most beside that."""

    name: str

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row a formulation."""
        for label, formulation in FORMULATIONS.items():
            known, ours = responses(formulation)
            largest, error = np.max(np.abs(known)), np.max(np.abs(known - ours))
            yield {
                "case": self.name,
                "setting": f"linear model, 4 {label}",
                "quantity": "largest moment",
                "entry": 0,
                "published": f"{largest:.12g}",
                "ours": f"{np.max(np.abs(ours)):.12g}",
                "error": f"{error:.2e}",
                "relative": f"{error / largest:.2e}",
                "ended": "",
            }


STEP_RESPONSES = (StepResponse("rotating arm, step"),)
