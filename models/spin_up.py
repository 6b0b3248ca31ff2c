"""Spin-up of a flexible beam: the classical test of dynamic stiffening."""

import beamdae as bd


@bd.model(t_end=20.0)
def spin_up(
    elements=4,
    strain="nonlinear",
    speed=6.0,
    damping=0.0,
    quadrature="reduced",
    formulation="floating frame",
):
    """Rotate the root of a straight beam of 10 m, run up to `speed` [rad/s] in 15 s.

    J. C. Simo, L. Vu-Quoc, J. Appl. Mech. 53 (1986) 849 and 855, after Kane, Ryan & Banerjee,
    J. Guidance 10 (1987) 139: EA = 2.8e7 N, GA = 1e7 N, EI = 1.4e4 N m^2, rho A = 1.2 kg/m,
    rho I = 6e-4 kg m. Without quadratic strains the centrifugal force does not stiffen the beam in
    bending, and the deflection grows without bound. `damping` [s] is the Kelvin-Voigt retardation
    time of the beam. `strain` applies to the floating frame only,
    not to `formulation="exact"`.
    """
    rubber = bd.Material(E=2.8e7, nu=0.4, rho=1.2)
    section = bd.Section(rubber, 1.0, second_moment=5e-4, shear_coefficient=1.0, damping=damping)

    mech = bd.Mechanism()
    beam = mech.add(
        bd.Beam(
            "beam",
            bd.Line((0.0, 0.0), (10.0, 0.0)),
            section,
            elements=elements,
            strain=strain if formulation == "floating frame" else None,
            quadrature=quadrature,
            frame="tangent",
            formulation=formulation,
        )
    )
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", axle, beam.start))
    motor = mech.add(bd.Driver("motor", axle, beam.start, law=bd.run_up(speed, 15.0)))

    mech.observe("tip", beam.end)
    mech.observe("deformation", beam.deformation(beam.length, axes="frame"))
    mech.observe("frame", beam.floating_frame)
    mech.observe("motor", motor.reaction)
    return mech
