"""Mass and stiffness matrices of planar finite-element models, for bodies made of them."""

import numpy as np


def straight_bar(section, length, elements, angle=0.0, start=(0.0, 0.0)):
    """Return (mass, stiffness, nodes) of Euler-Bernoulli elements with rotary inertia."""
    h = length / elements
    EA, EI, rhoA, rhoI = section.EA, section.EI, section.rhoA, section.rhoI
    axial, bend = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
    k, m = np.zeros((6, 6)), np.zeros((6, 6))
    k[axial] = EA / h * np.array([[1, -1], [-1, 1]])
    m[axial] = rhoA * h / 6.0 * np.array([[2, 1], [1, 2]])
    k[bend] = (
        EI
        / h**3
        * np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h**2, -6 * h, 4 * h**2],
            ]
        )
    )
    m[bend] = rhoA * h / 420.0 * np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    ) + rhoI / (30.0 * h) * np.array(
        [
            [36, 3 * h, -36, 3 * h],
            [3 * h, 4 * h**2, -3 * h, -(h**2)],
            [-36, -3 * h, 36, -3 * h],
            [3 * h, -(h**2), -3 * h, 4 * h**2],
        ]
    )
    c, s = np.cos(angle), np.sin(angle)
    turn = np.kron(np.eye(2), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    n = 3 * (elements + 1)
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    for e in range(elements):
        rows = np.ix_(range(3 * e, 3 * e + 6), range(3 * e, 3 * e + 6))
        mass[rows] += turn.T @ m @ turn
        stiffness[rows] += turn.T @ k @ turn
    s_nodes = np.linspace(0.0, length, elements + 1)
    nodes = np.array(start) + s_nodes[:, None] * np.array([c, s])
    return mass, stiffness, nodes
