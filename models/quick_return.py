"""Quick-return mechanism of a shaper: crank, block in a slotted lever, link and ram."""

import numpy as np

import beamdae as bd


@bd.model(t_end=3.0)
def quick_return(
    speed=2.0 * np.pi,
    crank_radius=0.12,
    cutting_force=800.0,
    coefficient=0.1,
    friction_speed=0.02,
):
    """Run the crank up to `speed` [rad/s] in 0.5 s; the ram cuts to the right and returns faster.

    The lever swings about the origin; the crank of `crank_radius` [m] rotates about a bearing 0.3 m
    above the origin. The ram of 25 kg slides in a guide of 0.4 m with the friction `coefficient`
    [-], regularized at `friction_speed` [m/s], and `cutting_force` [N] resists its motion to the
    right.
    """
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ground, center, pin = mech.ground, (0.0, 0.3), (0.0, 0.3 + crank_radius)
    crank = mech.add(bd.RigidBody.disk("crank", center, radius=0.15, mass=12.0))
    block = mech.add(bd.RigidBody.plate("block", pin, width=0.04, height=0.06, mass=0.8))
    lever = mech.add(bd.RigidBody.rod("lever", (0.0, 0.0), (0.0, 0.6), mass=6.0))
    link = mech.add(bd.RigidBody.rod("link", (0.0, 0.6), (0.25, 0.65), mass=1.5))
    ram = mech.add(bd.RigidBody.plate("ram", (0.45, 0.65), width=0.4, height=0.08, mass=25.0))

    mech.add(bd.Revolute("crank bearing", ground.at(*center), crank.at(*center)))
    law = bd.run_up(speed, 0.5)
    motor = mech.add(bd.Driver("motor", ground.at(*center), crank.at(*center), law))
    mech.add(bd.Revolute("crank pin", crank.at(*pin), block.at(*pin)))
    slot = mech.add(bd.Prismatic("slot", lever.at(0.0, 0.0), block.at(*pin), (0.0, 1.0)))
    mech.add(bd.Revolute("lever bearing", ground.at(0.0, 0.0), lever.at(0.0, 0.0)))
    mech.add(bd.Revolute("lever pin", lever.at(0.0, 0.6), link.at(0.0, 0.6)))
    mech.add(bd.Revolute("ram pin", link.at(0.25, 0.65), ram.at(0.25, 0.65)))
    guide = mech.add(bd.Prismatic("guide", ground.at(0.0, 0.65), ram.at(0.45, 0.65)))
    rubbing = mech.add(
        bd.Friction("rubbing", guide, coefficient, friction_speed, radius=0.2, smoothing=1.0)
    )

    def cutting(tool, t):
        return -0.5 * cutting_force * (1.0 + np.tanh(tool.velocity[0] / 0.02)), 0.0

    mech.add(bd.ForceLaw("cutting", (ram.at(0.65, 0.61),), cutting))

    mech.observe("ram", ram.at(0.45, 0.65))
    mech.observe("lever", lever.at(0.0, 0.6))
    mech.observe("slot", slot.reaction)
    mech.observe("rubbing", rubbing.reaction)
    mech.observe("motor", motor.drive)
    return mech
