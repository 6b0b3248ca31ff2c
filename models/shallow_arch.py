"""Shallow arch that snaps through: limit point, unstable equilibria beyond it, dynamic jump."""

import numpy as np

import beamdae as bd


@bd.model(t_end=0.2)
def shallow_arch(
    elements=8, span=0.5, rise=0.008, height=0.002, load=35.0, damping=2e-4, formulation="exact"
):
    """Load the crown of a clamped circular arch of steel, 20 mm x `height` [m], by `load` [N].

    The arch carries loads up to 38.1 N if they increase slowly. Applied suddenly, as in a
    simulation, 35 N snap it through. The arch has a `span` [m] and a `rise` [m]; with a rise of
    12 mm, an asymmetric path branches off beyond the limit point. `damping` [s] is the Kelvin-Voigt
    retardation time of the strip.
    """
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=height, damping=damping)
    radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
    half = np.arcsin(0.5 * span / radius)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.5 * span, 0.0), angle=np.pi - half)

    mech = bd.Mechanism()
    arch = mech.add(bd.Beam("arch", curve, strip, elements=elements, formulation=formulation))
    ground = mech.ground
    right = mech.add(bd.Weld("right", ground.at(*arch.start.point), arch.start))
    mech.add(bd.Weld("left", ground.at(*arch.end.point), arch.end))
    crown = arch.at(0.5 * arch.length)
    mech.add(bd.Force("press", crown, (0.0, -load)))

    mech.observe("crown", crown)
    mech.observe("quarter", arch.at(0.25 * arch.length))
    mech.observe("right", right.reaction)
    return mech
