"""Curved beam on a rotating rigid hub (Pan & Liu 2012, eqs. 25-27, Figs. 6 and 7, Table 2)."""

import numpy as np

import beamdae as bd


@bd.model(t_end=2.0)
def hub_beam(
    elements=8,
    bodies=1,
    frame="tangent",
    subtended=60.0,
    shape="circular",
    strain="nonlinear",
    elements_shape="curved",
    nodes=4,
    continuity="cartesian",
    quadrature="reduced",
    damping=0.0,
    density=2766.7,
    length=5.0 * np.pi / 3.0,
    torque=10.0,
    frequency=1.0,
    formulation="floating frame",
):
    """Apply `torque` [N m] times sin(2 pi `frequency` [Hz] t) to the hub, without gravity.

    `subtended` [deg] is the angle of the arc, `length` [m] its length; a "parabolic" `shape` has
    the same chord and rise. The material has the `density` [kg/m^3] and the Kelvin-Voigt
    retardation time `damping` [s]. The beam consists of `bodies` beams of `elements` elements each,
    welded together. Each has a floating frame on its start section (`frame` "tangent", the paper's)
    or from end to end ("chord"). `strain` and `continuity` apply to the floating frame only, not to
    `formulation="exact"`.
    """
    angle = np.radians(subtended)
    radius = length / angle
    root = (0.05, 0.0)
    if shape == "circular":
        axis = bd.Arc(radius=radius, length=length, start=root)
    elif shape == "parabolic":
        # y = 4 d x (x - l) / l^2, rotated so that the root tangent is along the hub's radius.
        chord, rise = 2.0 * radius * np.sin(angle / 2.0), radius * (1.0 - np.cos(angle / 2.0))
        axis = bd.Parabola(span=chord, rise=-rise, start=root, angle=np.arctan(4.0 * rise / chord))
    else:
        raise bd.BeamdaeError(f"hub_beam: shape must be 'circular' or 'parabolic', got {shape!r}.")
    alloy = bd.Material(E=68.952e9, nu=0.3, rho=density)
    section = bd.Section(alloy, area=8e-5, second_moment=1.06667e-8, damping=damping)

    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.3))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Moment("torque", on=hub.at(0.0, 0.0), law=bd.sine(torque, frequency)))
    floating = formulation == "floating frame"
    beams = bd.welded_beams(
        mech,
        "beam",
        axis,
        section,
        bodies,
        elements=elements,
        frame=frame,
        elements_shape=elements_shape,
        nodes=nodes,
        quadrature=quadrature,
        formulation=formulation,
        **({"strain": strain, "continuity": continuity} if floating else {}),
    )
    mech.add(bd.Weld("root", hub.at(*root), beams[0].start))

    mech.observe("tip", beams[-1].end)
    mech.observe("deformation", bd.relative_displacement(of=beams[-1].end, on=hub.at(*root)))
    mech.observe("hub", hub.at(0.0, 0.0))
    mech.observe("root force", beams[0].section_forces(0.0))
    return mech
