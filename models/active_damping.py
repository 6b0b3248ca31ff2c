"""Cantilever whose vibrations are damped by a piezo patch with feedback of a strain gauge."""

import beamdae as bd


@bd.model(t_end=0.8)
def active_damping(
    gain=0.2, frequency=68.0, ratio=0.25, strike=2.0, elements=5, formulation="exact"
):
    """Strike the end of an aluminum strip by `strike` [N] for 5 ms and damp its vibrations.

    The strip, 30 mm x 2 mm and 0.3 m long, carries 30 g at its end. The moment of a piezo patch,
    which reaches 60 mm from the clamp, follows the strain in its middle by positive position
    feedback: a filter of second order with the `frequency` [rad/s] and damping `ratio` [-] (Fanson
    & Caughey, AIAA Journal 28, 1990, 717-724). `gain` [-] is the moment of the patch relative to
    the bending moment under it; at zero, only the material damps the first mode of 61 rad/s.
    """
    length, patch, width, height = 0.3, 0.06, 0.03, 0.002
    aluminum = bd.Material.of("aluminum")
    section = bd.Section.rectangle(aluminum, width=width, height=height, damping=2e-5)

    mech = bd.Mechanism()
    curve = bd.Line((0.0, 0.0), (length, 0.0))
    strip = bd.Beam("strip", curve, section, elements=elements, formulation=formulation)
    mech.add(strip)
    end = mech.add(bd.RigidBody.plate("end mass", (length, 0.0), 0.02, 0.02, mass=0.03))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Weld("screw", strip.end, end.at(length, 0.0)))

    strain = mech.sensor("strain", strip.strain(0.5 * patch, "top"))
    square = frequency**2
    # The strain has an amplitude of 1.5e-4.
    filtered = bd.transfer_function(
        mech, "filter", strain, [square], [1.0, 2.0 * ratio * frequency, square], scale=1e-4
    )
    # Under the bending moment M, the strain of the upper surface is -M height / (2 EI). The second
    # moment of the patch acts on the clamp.
    bending = -section.EI / (0.5 * height) * filtered
    piezo = mech.add(bd.Moment("patch", strip.at(patch), gain * bending))
    pulse = bd.piecewise((5e-3, -strike), 0.0)
    mech.add(bd.Force("strike", end.at(length, 0.0), (0.0, pulse)))

    mech.observe("end", end.at(length, 0.0))
    mech.observe("patch", piezo.moment)
    return mech
