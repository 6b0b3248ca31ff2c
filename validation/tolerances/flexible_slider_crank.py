"""Slider-crank of the IVP test set; the flexible rod has two bending and two axial coordinates."""

from __future__ import annotations

import casadi as ca
import numpy as np
from benchmarks.systems import create_symbols, lagrange_force

import beamdae as bd

# Eight digits as in the test set; its end values depend on them.
PI = 3.1415927
CRANK = 0.15  # length [m]
ROD = 0.30  # length [m]
SPEED = 150.0  # [rad/s]
ROD_MASS = 0.151104  # [kg]
SLIDER_MASS = 0.075552  # [kg]
CRANK_INERTIA = 0.002727  # [kg m^2]
ROD_INERTIA = 0.0045339259  # [kg m^2]
DENSITY = 7870.0  # [kg/m^3]
YOUNG = 0.2e12  # modulus [Pa]
SIDE = 0.008  # of the square section [m]
VOLUME = SIDE**2 * ROD


def _fill_matrix(shape: tuple[int, ...], entries: dict) -> np.ndarray:
    array = np.zeros(shape)
    for index, value in entries.items():
        array[index] = value
    return array


# Shape functions of the rod: sin(pi x/l) and sin(2 pi x/l) transverse, quadratic ones axial. The
# arrays below are integrals over the rod of the shapes, of x times the shapes, and of products of
# transverse and axial shapes.
MASS = DENSITY * VOLUME * _fill_matrix((4, 4), {(0, 0): 0.5, (1, 1): 0.5, (2, 2): 8.0, (3, 3): 2.0})
MASS[2, 3] = MASS[3, 2] = DENSITY * VOLUME
STIFFNESS = (YOUNG * SIDE**2 / ROD) * _fill_matrix(
    (4, 4),
    {
        (0, 0): PI**4 / 24.0 * (SIDE / ROD) ** 2,
        (1, 1): PI**4 * 2.0 / 3.0 * (SIDE / ROD) ** 2,
        (2, 2): 16.0 / 3.0,
        (2, 3): -8.0 / 3.0,
        (3, 2): -8.0 / 3.0,
        (3, 3): 7.0 / 3.0,
    },
)
DAMPING = _fill_matrix(
    (4, 4),
    {
        (0, 0): 5.0,
        (1, 1): 25.0,
        (2, 2): 0.5 * 2.308375455264791e2,
        (2, 3): -0.5 * 2.62688487992052e2,
        (3, 2): -0.5 * 2.62688487992052e2,
        (3, 3): 0.5 * 4.217421837156818e2,
    },
)
GYROSCOPIC = VOLUME * _fill_matrix(
    (4, 4), {(0, 2): -16.0 / PI**3, (0, 3): 8.0 / PI**3 - 1.0 / PI, (1, 3): 0.5 / PI}
)
GYROSCOPIC -= GYROSCOPIC.T
ALONG = VOLUME * np.array([0.0, 0.0, 2.0 / 3.0, 1.0 / 6.0])
ACROSS = VOLUME * np.array([2.0 / PI, 0.0, 0.0, 0.0])
ALONG_X = ROD * VOLUME * np.array([0.0, 0.0, 1.0 / 3.0, 1.0 / 6.0])
ACROSS_X = ROD * VOLUME * np.array([1.0 / PI, -0.5 / PI, 0.0, 0.0])


def _mass_matrix(u: ca.SX) -> ca.SX:
    """Return M of (phi1, phi2, x3, q1..q4) from the kinetic energy of crank, rod and slider."""
    q, difference = u[3:], u[0] - u[1]
    cosine, sine = ca.cos(difference), ca.sin(difference)
    along, across = ca.dot(ALONG, q), ca.dot(ACROSS, q)
    m = ca.SX.zeros(7, 7)
    m[0, 0] = CRANK_INERTIA + ROD_MASS * CRANK**2
    m[0, 1] = 0.5 * CRANK * ROD * ROD_MASS * cosine
    m[0, 1] += DENSITY * CRANK * (sine * across + cosine * along)
    m[1, 1] = ROD_INERTIA + ca.dot(q, MASS @ q) + 2.0 * DENSITY * ca.dot(ALONG_X, q)
    m[2, 2] = SLIDER_MASS
    m[0, 3:] = (DENSITY * CRANK * (cosine * ACROSS - sine * ALONG)).T
    m[1, 3:] = (DENSITY * (ACROSS_X + GYROSCOPIC.T @ q)).T
    m[3:, 3:] = MASS
    return ca.triu2symm(ca.triu(m))


@bd.model(t_end=0.1)
def flexible_slider_crank(damped=False):
    """Crank at 150 rad/s, flexible rod and slider, in the coordinates of the test set.

    B. Simeon, Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs,
    Math. Modelling of Systems 2 (1996) 1, doi:10.1080/13873959608837026; F. Mazzia, C. Magherini,
    Test Set for Initial Value Problem Solvers, problem crank, linear stiffness, start close to the
    smooth motion; https://archimede.dm.uniba.it/~testset/. Damping is that of the test set, 0.5 %.
    """
    t, u, v = create_symbols(7)
    mass = _mass_matrix(u)
    resistance = STIFFNESS @ u[3:] + (DAMPING @ v[3:] if damped else 0.0)
    length = ROD + u[6]
    return bd.ConstrainedSystem(
        t=t,
        q=u,
        v=v,
        mass=mass,
        force=lagrange_force(u, v, mass, ca.vertcat(ca.SX.zeros(3), -resistance)),
        constraints=ca.vertcat(
            CRANK * ca.sin(u[0]) + length * ca.sin(u[1]),
            u[2] - CRANK * ca.cos(u[0]) - length * ca.cos(u[1]),
            u[0] - SPEED * t,
        ),
        q0=[0.0, 0.0, 0.450016933, 0.0, 0.0, 0.103339863e-4, 0.169327969e-4],
        v0=[
            150.0,
            -74.9957670,
            -0.268938672e-5,
            0.444896105,
            0.463434311e-2,
            -0.178591076e-5,
            -0.268938672e-5,
        ],
        names=("phi1", "phi2", "x3", "q1", "q2", "q3", "q4"),
        units=("rad", "rad", "m", "m", "m", "m", "m"),
    )


# Undamped motion at t = 0.1 s from the test set.
CRANK_END = {
    "phi2 [rad]": -3.311734987910881e-1,
    "x3 [m]": 1.697373326718410e-1,
    "q1 [m]": 1.893192460247178e-4,
    "q2 [m]": 2.375751865617931e-5,
    "q3 [m]": -5.323907988763734e-6,
    "q4 [m]": -8.363283141616840e-6,
}
