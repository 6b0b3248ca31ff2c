"""Mass that slides down a flexible arc until it reaches the end."""

import beamdae as bd


@bd.model(t_end=2.0)
def sliding_mass(
    elements=8, mass=0.15, height=0.003, radius=1.0, damping=1e-4, formulation="floating frame"
):
    """Release a particle of `mass` [kg] at rest on a clamped strip of aluminum.

    The strip of 25 mm x `height` [m] leaves its clamp 1.1 rad below the horizontal and ends level
    after an arc of `radius` [m]. The run stops when the mass reaches the free end. `damping` [s] is
    the Kelvin-Voigt retardation time of the strip.
    """
    alloy = bd.Material.of("aluminum")
    strip = bd.Section.rectangle(alloy, width=0.025, height=height, damping=damping)
    arc = bd.Arc(radius=radius, length=1.1 * radius, start=(0.0, 0.0), angle=-1.1)

    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rail = mech.add(bd.Beam("rail", arc, strip, elements, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), rail.start))
    bead = mech.add(bd.PointMass("bead", mass, at=tuple(arc.point(0.1 * radius))))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, rail))

    mech.observe("bead", bead.point)
    mech.observe("s", slide.s)
    mech.observe("rail", slide.reaction)
    mech.observe("tip", rail.end)
    mech.observe("clamp", rail.section_forces(0.0))
    mech.when("s", crosses=rail.length, direction="up", do="stop", name="end of the rail")
    return mech
