"""Curved-beam pendulum with a tip mass (Pan & Liu 2012, Figs. 3-5, Table 1)."""

import beamdae as bd


@bd.model(t_end=5.0)
def pendulum(
    elements=8,
    strain="nonlinear",
    tip_mass=0.060,
    damping=1e-4,
    mass_damping=0.0,
    stiffness_damping=0.0,
    air_drag=0.0,
    angle=-0.60,
    radius=0.85,
    quadrature="reduced",
    formulation="floating frame",
):
    """Release the pendulum at rest, with its root tangent at `angle` [rad] to the horizontal.

    `damping` [s] is the Kelvin-Voigt retardation time of the strip, `mass_damping` [1/s] and
    `stiffness_damping` [s] are Rayleigh's coefficients, `air_drag` [kg/m^2] is the drag force per
    length and squared normal velocity. `tip_mass` [kg] is the mass at the tip; a negative `angle`
    points below the horizontal, and a negative `radius` [m] curves the strip downward. The gauges
    are on the lower surface, which gives the strains the sign of Fig. 5a. `strain` applies to the
    floating frame only, not to `formulation="exact"`.
    """
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=0.0025, damping=damping)
    arc = bd.Arc(radius=radius, length=0.80, start=(0.0, 0.0), angle=angle)

    beam = mech.add(
        bd.Beam(
            "beam",
            arc,
            strip,
            elements=elements,
            strain=strain if formulation == "floating frame" else None,
            quadrature=quadrature,
            frame="tangent",
            formulation=formulation,
        )
    )
    mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    if mass_damping or stiffness_damping:
        mech.add(bd.RayleighDamping("rayleigh", beam, mass_damping, stiffness_damping))
    if air_drag:
        mech.add(bd.AirDrag("air", beam, air_drag))

    mech.observe("tip", beam.end)
    mech.observe("frame", beam.floating_frame)
    mech.observe("gauge 1", beam.strain(s=0.50, offset=-0.00125))
    mech.observe("gauge 2", beam.strain(s=0.25, offset=-0.00125))
    mech.observe("hinge", hinge.reaction)
    return mech
