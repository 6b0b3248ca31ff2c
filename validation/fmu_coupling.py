"""Co-simulate the FMU of a mechanism with a controller, and measure the error of their coupling.

    python validation/fmu_coupling.py

An elastic arm is turned to a target angle by a PID controller outside the FMU. Both exchange angle,
rate and torque every communication step (Jacobi scheme). The reference is one run of the mechanism
with the same controller as formulas and a first-order state.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import beamdae as bd

GAINS = {"target": 0.5, "KP": 60.0, "KI": 40.0, "KD": 12.0}
T_END = 1.0
STEPS = (4e-3, 2e-3, 1e-3, 5e-4)
REFERENCE_STEP = 1.25e-4


def _arm(torque: Any = None) -> bd.Mechanism:
    """Elastic arm on a hinge; the torque is an input, or the law of the controller."""
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.03, height=0.01)
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.05))
    beam = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.5, 0.0)), strip, elements=2))
    hinge = hub.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), hinge))
    mech.add(bd.Weld("clamp", hinge, beam.start))
    if torque is None:
        torque = mech.input("torque", default=0.0, unit="N m")
    else:
        angle = mech.sensor("angle", hinge, "angle")
        rate = mech.sensor("rate", hinge, "angle_dot")
        error = GAINS["target"] - angle
        integral = mech.state("integral", rate=error, unit="rad s")
        torque = GAINS["KP"] * error + GAINS["KI"] * integral - GAINS["KD"] * rate
    mech.add(bd.Moment("motor", hinge, torque))
    mech.observe("hub", hinge)
    mech.observe("tip", beam.end)
    return mech


class _Instance:
    def __init__(self, path: Path) -> None:
        from fmpy import extract, read_model_description
        from fmpy.fmi2 import FMU2Slave

        about = read_model_description(str(path))
        self._numbers = {x.name: x.valueReference for x in about.modelVariables}
        self._fmu = FMU2Slave(
            guid=about.guid,
            unzipDirectory=extract(str(path)),
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self._fmu.instantiate()
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def set(self, **values: float) -> None:
        self._fmu.setReal([self._numbers[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self._fmu.getReal([self._numbers[name] for name in names]))

    def step(self, t: float, step: float) -> None:
        self._fmu.doStep(currentCommunicationPoint=t, communicationStepSize=step)


def couple(arm: Path, step: float, t_end: float = T_END) -> np.ndarray:
    """Return the angles of the hub [rad] at all communication points after the start."""
    plant, angles, integral = _Instance(arm), [], 0.0
    for k in range(round(t_end / step)):
        angle, rate = plant.get("hub.angle", "hub.angle_dot")
        error = GAINS["target"] - angle
        plant.set(torque=GAINS["KP"] * error + GAINS["KI"] * integral - GAINS["KD"] * rate)
        plant.step(k * step, step)
        integral += step * error
        angles.append(plant.get("hub.angle")[0])
    return np.array(angles)


def reference_angles(step: float, t_end: float = T_END) -> np.ndarray:
    """Return the angles of the hub [rad] of a run with the controller as formulas."""
    method = bd.GeneralizedAlpha(REFERENCE_STEP)
    run = bd.simulate(_arm("formulas"), method, t_end=t_end, output_step=step)
    return run["hub.angle"].to_numpy()[1:]


def export_arm(folder: Path) -> Path:
    """Return the path of the FMU of the arm."""
    settings = {"communication_step": max(STEPS), "t_end": T_END, "outputs": ["hub"]}
    fmu = bd.export_fmu(_arm(), folder / "arm.fmu", bd.Radau(1e-5), **settings)
    return fmu.path


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        arm = export_arm(Path(name))
        print("communication step [s]  largest error of the angle / range")
        for step in STEPS:
            exact = reference_angles(step)
            angles = couple(arm, step)
            print(f"{step:22g}  {np.max(np.abs(angles - exact)) / np.ptp(exact):.2e}")


if __name__ == "__main__":
    main()
