"""Step responses of linearized models against runs of the nonlinear equations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lsim

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about
from benchmarks.modes import FORMULATIONS
from benchmarks.summary_rows import make_row

_ANGULAR_VELOCITY = 20.0  # of the hub [rad/s]
_JET = 1e-3  # step of the tip force [N]
_T_END = 0.15  # [s]
_OUTPUT_STEP = 1e-3  # [s]


def rotating_arm_with_jet(jet: float, formulation: str) -> bd.Mechanism:
    """Return a curved, damped strip on a hub at 20 rad/s, with the force `jet` [N] at its tip."""
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
    mech.add(bd.Driver("motor", *axle, law=lambda t: _ANGULAR_VELOCITY * t))
    mech.add(bd.Force("jet", beam.end, (0.0, jet), axes="body"))
    mech.observe("root", beam.section_forces(0.0))
    return mech


def compute_responses(formulation: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the root moments [N m] of the nonlinear run and of the linear model after the step."""
    rotation = bd.rotation(_ANGULAR_VELOCITY)
    model = bd.linearize(rotating_arm_with_jet(0.0, formulation), rotation, inputs=["jet"])
    steady = linearize_about("modes", rotating_arm_with_jet(0.0, formulation), rotation).state
    equations = bd.equations_of_motion(rotating_arm_with_jet(_JET, formulation))
    equations_with_step = replace(equations, q0=steady.q, v0=steady.v)
    run = bd.simulate(equations_with_step, bd.Radau(1e-10), _T_END, output_step=_OUTPUT_STEP)
    names = [output.header for output in model.outputs]
    k = names.index("root.M [N m]")
    _, outputs, _ = lsim(model.state_space(), np.tile([0.0, _JET], (len(run.t), 1)), run.t)
    return run.columns[names[k]] - model.output_values[k], outputs[:, k]


@dataclass(frozen=True)
class StepResponse:
    """Compare the largest root moments of the linear and the nonlinear response."""

    name: str

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield one row per formulation."""
        for label, formulation in FORMULATIONS.items():
            reference, computed = compute_responses(formulation)
            values = (np.max(np.abs(x)) for x in (reference, computed))
            error = np.max(np.abs(reference - computed))
            setting = f"linear model, 4 {label}"
            yield make_row(self.name, setting, "largest moment", *values, error=error, entry=0)


STEP_RESPONSES = (StepResponse("rotating arm, step"),)
