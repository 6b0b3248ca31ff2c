"""Answers in closed form of the mechanisms: rows of q, v, lam or observed columns at given times.

Two have none and are integrated by an independent code, in the one coordinate they need.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj

from benchmarks.mechanisms import (
    ARM,
    DAMPING_RATIOS,
    GEAR_INERTIAS,
    GEAR_TURNS,
    GRAVITY,
    PLANET_MASS,
    STRIP,
)

Array = np.ndarray


def damped_motion(t: Array) -> dict[str, Array]:
    """Solution of m x'' + c x' + k x = 0 from rest: x of the two roots, and of the double one."""
    mass, stiffness, start = 2.5, 90.0, 0.3
    w = np.sqrt(stiffness / mass)
    q, v = (np.zeros((len(t), 2 * len(DAMPING_RATIOS))) for _ in range(2))
    for k, ratio in enumerate(DAMPING_RATIOS):
        root = np.sqrt(complex(ratio**2 - 1.0)) * w
        one, other = -ratio * w + root, -ratio * w - root
        if ratio == 1.0:
            x, rate = (1.0 + w * t) * np.exp(-w * t), -(w**2) * t * np.exp(-w * t)
        else:
            grown = np.exp(np.outer([one, other], t)) / (other - one)
            x = (other * grown[0] - one * grown[1]).real
            rate = (other * one * (grown[0] - grown[1])).real
        q[:, 2 * k], q[:, 2 * k + 1], v[:, 2 * k] = start * x, 0.1 * k, start * rate
    return {"q": q, "v": v}


def rubbing_motion(t: Array) -> dict[str, Array]:
    """Half waves about points that friction shifts by d = mu m g / k to and fro."""
    mass, stiffness, coefficient, start = 2.0, 800.0, 0.3, 0.2
    w, shift = np.sqrt(stiffness / mass), coefficient * mass * GRAVITY / stiffness
    half = np.floor(w * t / np.pi + 1e-9)
    amplitude = start - (2.0 * half + 1.0) * shift
    x = (-1.0) ** half * shift + amplitude * np.cos(w * t)
    rate = -w * amplitude * np.sin(w * t)
    zero = np.zeros_like(t)
    return {"q": np.stack([x, zero, zero], axis=-1), "v": np.stack([rate, zero, zero], axis=-1)}


def bouncing_motion(t: Array) -> dict[str, Array]:
    """Free flight, and contacts m d'' = m g - k d^1.5 (1 + X d') by Runge-Kutta."""
    stiffness, restitution = 1e5, 0.7
    speed = np.sqrt(2.0 * GRAVITY)

    def kept(x: float) -> float:
        # Gonthier et al. 2004, of X v.
        return x * (1.0 + restitution) - np.log((1.0 + x) / (1.0 - restitution * x))

    factor = float(brentq(kept, 0.1, 1.0 / restitution - 1e-9, xtol=1e-15)) / speed

    def depth_rate(_: float, y: Array) -> list[float]:
        push = stiffness * max(y[0], 0.0) ** 1.5 * max(1.0 + factor * y[1], 0.0)
        return [y[1], GRAVITY - push]

    def leaves(_: float, y: Array) -> float:
        return y[0]

    leaves.terminal, leaves.direction = True, -1.0  # type: ignore[attr-defined]
    found = np.zeros((len(t), 2))
    begin, height, rising = 0.0, 1.0, 0.0
    while begin < t[-1]:
        fall = (rising + np.sqrt(rising**2 + 2.0 * GRAVITY * height)) / GRAVITY
        flying = (t >= begin) & (t < begin + fall)
        since = t[flying] - begin
        found[flying, 0] = height + rising * since - 0.5 * GRAVITY * since**2
        found[flying, 1] = rising - GRAVITY * since
        begin, hit = begin + fall, GRAVITY * fall - rising
        contact = solve_ivp(
            depth_rate, (0.0, 1.0), [1e-300, hit], "DOP853", dense_output=True, events=leaves,
            rtol=1e-12, atol=1e-14,
        )  # fmt: skip
        lasting = contact.t_events[0][0]
        touching = (t >= begin) & (t < begin + lasting)
        if touching.any():
            found[touching] = -contact.sol(t[touching] - begin).T
        begin, height, rising = begin + lasting, 0.0, -float(contact.y_events[0][0][1])
    zero = np.zeros_like(t)
    y, rate = found.T
    return {"q": np.stack([zero, y], axis=-1), "v": np.stack([zero, rate], axis=-1)}


def gear_motion(t: Array) -> dict[str, Array]:
    """All of it swings with the inertia seen from the arm, sum of J_i (turn_i / turn of arm)^2."""
    stiffness, speed = 1.3, 1.5
    inertia = PLANET_MASS * ARM**2 + sum(j * GEAR_TURNS[x] ** 2 for x, j in GEAR_INERTIAS.items())
    w = np.sqrt(stiffness / inertia)
    angle, rate, zero = speed / w * np.sin(w * t), speed * np.cos(w * t), np.zeros_like(t)
    place, way = ARM * np.exp(1j * angle), 1j * ARM * rate * np.exp(1j * angle)
    turns = {x: (angle * turn, rate * turn) for x, turn in GEAR_TURNS.items()}
    at_rest = [(zero, zero, turns[x][0]) for x in ("arm", "sun")]
    moving = [(zero, zero, turns[x][1]) for x in ("arm", "sun")]
    q = [*at_rest, (place.real, place.imag, turns["planet"][0])]
    v = [*moving, (way.real, way.imag, turns["planet"][1])]
    return {name: np.stack(sum(rows, ()), axis=-1) for name, rows in (("q", q), ("v", v))}


def slider_motion(t: Array) -> dict[str, Array]:
    """Radius r = r0 cosh(w t); the guide pushes by 2 m w r', the motor turns against its moment."""
    rate, distance, mass = 2.0, 0.3, 0.4
    r, out = distance * np.cosh(rate * t), distance * rate * np.sinh(rate * t)
    turn, zero = rate * t, np.zeros_like(t)
    place = r * np.exp(1j * turn)
    way = (out + 1j * rate * r) * np.exp(1j * turn)
    spin = np.full_like(t, rate)
    push = 2.0 * mass * rate * out
    return {
        "q": np.stack([zero, zero, turn, place.real, place.imag, turn], axis=-1),
        "v": np.stack([zero, zero, spin, way.real, way.imag, spin], axis=-1),
        "guide.F [N]": push,
        "motor.M [N m]": push * r,
    }


def ring_motion(t: Array) -> dict[str, Array]:
    """A pendulum of length R - r = 1 m with gravity over 1 + I / (m r^2)."""
    radius, mass, inertia, start = 0.25, 1.3, 0.4, 0.8
    k = np.sin(0.5 * start)
    w = np.sqrt(GRAVITY / (1.0 + inertia / (mass * radius**2)))
    sn, cn, dn, _ = ellipj(w * t, k**2)
    angle = 2.0 * np.arcsin(k * cn / dn)
    rate = -2.0 * k * w * (1.0 - k**2) * sn / dn**2 / np.cos(0.5 * angle)
    c, s = np.cos(angle), np.sin(angle)
    return {
        "q": np.stack([s, -c, (start - angle) / radius], axis=-1),
        "v": np.stack([c * rate, s * rate, -rate / radius], axis=-1),
    }


def moving_load_motion(t: Array) -> dict[str, Array]:
    """Krylov's series of a constant force at constant speed, of a beam without shear."""
    length, load, speed = 4.0, 5.0, 3.0
    found = np.zeros_like(t)
    for n in range(1, 60, 2):
        own = (n * np.pi / length) ** 2 * np.sqrt(STRIP.EI / STRIP.rhoA)
        driven = n * np.pi * speed / length
        wave = (np.sin(driven * t) - driven / own * np.sin(own * t)) / (own**2 - driven**2)
        found -= 2.0 * load / (STRIP.rhoA * length) * np.sin(0.5 * n * np.pi) * wave
    return {"middle.y [m]": found}


def follower_rest(t: Array) -> dict[str, Array]:
    """E I psi'' = P cos(psi) from the tip, psi the turn back from it, of a beam without shear."""
    ratio, length = 1.5, 1.0
    back = solve_ivp(
        lambda s, y: [y[1], ratio * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
        (0.0, length),
        np.zeros(4),
        rtol=1e-10,
        atol=1e-12,
    )
    psi, _, along, across = back.y[:, -1]
    # Seen from the clamp, whose section is turned by psi from that of the tip.
    x = along * np.cos(psi) + across * np.sin(psi)
    y = along * np.sin(psi) - across * np.cos(psi)
    columns = ("tip.x [m]", "tip.y [m]", "tip.angle [rad]")
    return {name: np.full_like(t, value) for name, value in zip(columns, (x, y, psi), strict=True)}
