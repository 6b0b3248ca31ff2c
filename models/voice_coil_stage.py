"""Flexure stage with a voice coil and a PID position controller, continuous or sampled."""

import numpy as np

import beamdae as bd

EVERY = 1e-3  # sampling interval [s]
LIMIT = 15.0  # force of the coil [N]


@bd.model(t_end=0.06)
def voice_coil_stage(
    step=0.3e-3,
    control="continuous",
    kp=25e3,
    ki=1.5e6,
    kd=220.0,
    length=0.04,
    thickness=0.3e-3,
    resolution=20e-9,
    elements=2,
    formulation="exact",
):
    """Move the platform by `step` [m] in the horizontal plane; the coil pushes up to 15 N.

    Two leaf springs of steel, 20 mm wide, of `length` [m] and `thickness` [m] guide a platform
    of 0.5 kg. The `control` is "continuous" (PID with the measured position and velocity),
    "sampled" (at 1 kHz with differences of the position, rounded to `resolution` [m]) or "none",
    with the force of the coil as an input. The gains are `kp` [N/m], `ki` [N/(m s)] and
    `kd` [N s/m].
    """
    steel = bd.Material.of("steel")
    leaf = bd.Section.rectangle(steel, width=0.02, height=thickness, damping=1e-4)

    mech = bd.Mechanism()
    center = (0.0, length + 0.01)
    platform = mech.add(bd.RigidBody.plate("platform", center, 0.08, 0.02, mass=0.5))
    for name, x in (("left leaf", -0.03), ("right leaf", 0.03)):
        curve = bd.Line((x, 0.0), (x, length))
        beam = mech.add(bd.Beam(name, curve, leaf, elements=elements, formulation=formulation))
        mech.add(bd.Weld(f"{name} clamp", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Weld(f"{name} screw", beam.end, platform.at(x, length)))

    middle = platform.at(*center)
    position = mech.sensor("position", middle, "x")
    velocity = mech.sensor("velocity", middle, "x_dot")
    target = mech.input("target", default=step, unit="m")
    if control == "continuous":
        gains, limits = {"kp": kp, "ki": ki, "kd": kd}, (-LIMIT, LIMIT)
        error = target - position
        # The integral of the error is about 0.1 mm times 10 ms.
        force = bd.pid(mech, "servo", error, **gains, rate=-velocity, limits=limits, scale=1e-6)
    else:
        force = mech.input("force", unit="N")
    coil = mech.add(bd.Force("coil", platform.at(-0.04, center[1]), (force, 0.0)))

    def law(sample):
        target, position = sample.reads
        measured = resolution * np.round(position / resolution)
        integral, last = sample.state
        error, rate = target - measured, (measured - last) / EVERY
        force = kp * error + ki * integral - kd * rate
        if abs(force) < LIMIT:
            integral += EVERY * error
        sample.state[:] = integral, measured
        return np.clip(force, -LIMIT, LIMIT)

    if control == "sampled":
        reads, start = [target, position], [0.0, 0.0]
        mech.add(bd.Controller("servo", EVERY, reads, [force], law, state=start))

    mech.observe("platform", middle)
    mech.observe("coil", coil.force)
    mech.observe("root", beam.stress(0.0, "top"))
    return mech
