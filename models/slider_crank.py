"""Slider-crank with a curved connecting rod (Pan & Liu 2012, eq. 28, Figs. 8-10)."""

import numpy as np

import beamdae as bd


@bd.model(t_end=4.5)
def slider_crank(
    elements=8,
    bodies=1,
    strain="nonlinear",
    frame="tangent",
    crank="rigid",
    speed=np.pi,
    density=2766.7,
    damping=0.0,
    quadrature="reduced",
    formulation="floating frame",
):
    """Run the crank up to `speed` [rad/s] in 0.5 s; parabolic rod, slider of 0.5 kg.

    The rod has the `density` [kg/m^3] and the Kelvin-Voigt retardation time `damping` [s].
    `frame` is the floating frame of the rod: "tangent" (start section) or "chord". The `crank` is
    "rigid", or "flexible" with the rod's section and half its elements. The rod consists of
    `bodies` beams of `elements` elements each; "mid-point" is the deformation of the middle one in
    its frame. `strain` applies to the floating frame only, not to `formulation="exact"`.
    """
    alloy = bd.Material(E=68.952e9, nu=0.3, rho=density)
    square = bd.Section.rectangle(alloy, width=0.02, height=0.02, damping=damping)

    mech = bd.Mechanism()
    if crank == "rigid":
        mass = alloy.rho * square.area * 1.0
        arm = mech.add(bd.RigidBody("crank", mass, inertia=mass / 12.0, center=(0.5, 0.0)))
        shaft, pin = arm.at(0.0, 0.0), arm.at(1.0, 0.0)
    elif crank == "flexible":
        line = bd.Line((0.0, 0.0), (1.0, 0.0))
        arm = mech.add(
            bd.Beam(
                "crank",
                line,
                square,
                max(elements // 2, 1),
                strain=strain if formulation == "floating frame" else None,
                quadrature=quadrature,
                frame="tangent",
                formulation=formulation,
            )
        )
        shaft, pin = arm.start, arm.end
    else:
        raise bd.BeamdaeError(f"slider_crank: crank must be 'rigid' or 'flexible', got {crank!r}.")
    axis = bd.Parabola(span=4.0, rise=1.0, start=(1.0, 0.0))
    rods = bd.welded_beams(
        mech,
        "rod",
        axis,
        square,
        bodies,
        elements=elements,
        strain=strain if formulation == "floating frame" else None,
        frame=frame,
        quadrature=quadrature,
        formulation=formulation,
    )
    middle = rods[bodies // 2]

    mech.add(bd.PointMass("slider", 0.5, on=rods[-1].end))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), shaft))
    motor = mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), shaft, law=bd.run_up(speed, 0.5)))
    mech.add(bd.Revolute("crank pin", pin, rods[0].start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(5.0, 0.0), rods[-1].end, direction=(1.0, 0.0)))

    mech.observe("slider", rods[-1].end)
    mech.observe("rod frame", rods[0].floating_frame)
    mech.observe("mid-point", middle.deformation(0.5 * middle.length, axes="local"))
    mech.observe("motor", motor.reaction)
    return mech
