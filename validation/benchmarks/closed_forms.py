"""Answers in closed form: rows of q, v and lam at given times."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def cycloid_motion(t: Array) -> dict[str, Array]:
    radius, gravity, start = 0.5, 9.81, -0.95
    # Of the slope's sine, s / 4r, and its rates.
    omega = np.sqrt(gravity / (4.0 * radius))
    sine = start * np.cos(omega * t)
    rate = -omega * start * np.sin(omega * t)
    bend = -(omega**2) * sine
    cosine = np.sqrt(1.0 - sine**2)
    x = 2.0 * radius * (np.arcsin(sine) + sine * cosine)
    rates = 4.0 * radius * np.stack([cosine * rate, sine * rate, rate], axis=-1)
    pull_x = 4.0 * radius * (cosine * bend - sine / cosine * rate**2)
    pull_y = 4.0 * radius * (sine * bend + rate**2)
    return {
        "q": np.stack([x, 2.0 * radius * sine**2, 4.0 * radius * sine], axis=-1),
        "v": rates,
        "lam": -np.stack([pull_x, pull_y + gravity], axis=-1),
    }


def rotating_rod_motion(t: Array) -> dict[str, Array]:
    radius, omega = 0.1, 2.0
    r, rate = radius * np.cosh(omega * t), omega * radius * np.sinh(omega * t)
    along = np.stack([np.cos(omega * t), np.sin(omega * t)], axis=-1)
    across = np.stack([-np.sin(omega * t), np.cos(omega * t)], axis=-1)
    return {
        "q": r[:, None] * along,
        "v": rate[:, None] * along + (omega * r)[:, None] * across,
        "lam": -2.0 * omega * rate[:, None],
    }


def knife_edge_motion(t: Array) -> dict[str, Array]:
    pull, spin = 5.0, 2.0
    turn, size = spin * t, pull / (2.0 * spin**2)
    along = pull / spin * np.sin(turn)
    x, y = size * np.sin(turn) ** 2, size * (turn - 0.5 * np.sin(2.0 * turn))
    return {
        "q": np.stack([x, y, turn], axis=-1),
        "v": np.stack([along * np.cos(turn), along * np.sin(turn), 0.0 * t + spin], axis=-1),
        "lam": 2.0 * pull * np.sin(turn)[:, None],
    }


def parallelogram_motion(t: Array) -> dict[str, Array]:
    crank, coupler, rate, start = 0.5, 1.0, 2.0, 0.3
    angle = start + rate * t
    pin = crank * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    fast = crank * rate * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    turned, turning = (angle - start)[:, None], np.full((len(t), 1), rate)
    span = np.array([coupler, 0.0])
    middle, right, still = pin + 0.5 * span, 0.5 * pin + span, np.zeros((len(t), 1))
    bars = (middle, still, 0.5 * pin, turned, right, turned)
    rates = (fast, still, 0.5 * fast, turning, 0.5 * fast, turning)
    return {"q": np.hstack(bars), "v": np.hstack(rates)}
