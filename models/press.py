"""Crank press that punches sheet metal; its force is a measured table of the travel."""

import numpy as np

import beamdae as bd

# Force on the punch [kN] over its travel in the sheet [mm]: elastic rise, yielding and fracture.
TRAVEL = (0.0, 0.2, 0.5, 1.0, 1.6, 2.2, 2.6, 2.9, 3.1, 3.3, 3.6, 4.5)
FORCE = (0.0, 22.0, 61.0, 98.0, 118.0, 124.0, 121.0, 108.0, 71.0, 26.0, 8.0, 0.0)


@bd.model(t_end=1.2)
def press(speed=12.0, inertia=20.0, ram_mass=40.0, slip=20.0, sheet=1.0, kind="pchip"):
    """Punch a sheet in each stroke, with a flywheel of `inertia` [kg m^2] at `speed` [rad/s].

    The moment of the motor is `slip` [N m s/rad] times the difference from its idle speed. The ram
    has a mass of `ram_mass` [kg]. `sheet` [-] is a factor of the measured force. The interpolation
    of the table is `kind`.
    """
    radius, rod = 0.05, 0.30
    lowest = -radius - rod

    mech = bd.Mechanism(gravity=(0.0, -9.81))
    angles = np.linspace(0.0, 2.0 * np.pi, 25)
    rim = tuple(zip(0.12 * np.cos(angles), 0.12 * np.sin(angles), strict=True))
    wheel = mech.add(bd.RigidBody("wheel", 60.0, inertia, angular_velocity=speed, shape=rim))
    ram = mech.add(bd.PointMass("ram", ram_mass, at=(0.0, radius - rod)))
    mech.add(bd.Revolute("shaft", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(*ram.at), ram.point, direction=(0.0, 1.0)))
    mech.add(bd.Distance("rod", wheel.at(0.0, radius), ram.point))

    measured = bd.table(
        1e-3 * np.array(TRAVEL), sheet * 1e3 * np.array(FORCE), kind, name="punching force"
    )

    def punching(ram, t):
        travel = lowest + 6e-3 - ram.position[1]
        descends = 0.5 * (1.0 - np.tanh(ram.velocity[1] / 0.01))
        return (0.0, descends * measured(travel))

    def drive(wheel, t):
        return (0.0, 0.0, slip * (speed - wheel.rate))

    punch = mech.add(bd.ForceLaw("punch", ram.point, punching))
    motor = mech.add(bd.ForceLaw("motor", wheel.at(0.0, 0.0), drive))

    mech.observe("wheel", wheel.at(0.0, 0.0))
    mech.observe("ram", ram.point)
    mech.observe("punch", punch.force)
    mech.observe("punching", punch.power)
    mech.observe("motor", motor.moment)
    mech.observe("drive", motor.power)
    return mech
