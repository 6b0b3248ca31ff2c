"""Mechanisms whose motion is known: joints, springs, friction, contact, gears, rolling, loads."""

from __future__ import annotations

import numpy as np

from benchmarks import mechanism_motions as known
from benchmarks import mechanisms as made
from benchmarks.cases import PublishedCase

_HALF_WAVE = np.pi * np.sqrt(2.0 / 800.0)

MECHANISM_CASES = (
    PublishedCase(
        "spring and damper",
        "closed form: under-, critically and overdamped",
        made.damped_masses,
        tuple(0.1 * k for k in range(1, 21)),
        # The faster root of the overdamped mass.
        29.0,
        known.damped_motion,
    ),
    PublishedCase(
        "Coulomb friction",
        "closed form: half waves, whose amplitudes fall by 2 mu m g / k each",
        made.rubbing_mass,
        tuple(0.5 * _HALF_WAVE * k for k in range(1, 12)),
        20.0,
        known.rubbing_motion,
        # Below 1e-3 m/s friction is less.
        floor=2e-5,
    ),
    PublishedCase(
        "bouncing ball",
        "free flight in closed form; contacts of Hunt and Crossley, J. Appl. Mech. 42 (1975), by "
        "Runge-Kutta, with the restitution of Gonthier et al., Multibody Syst. Dyn. 11 (2004)",
        made.bouncing_ball,
        tuple(0.125 * k for k in range(1, 17)),
        # Half a wave in a contact.
        np.pi / 0.025,
        known.bouncing_motion,
    ),
    PublishedCase(
        "planetary gear",
        "closed form: it swings with the inertia of its wheels as seen from the arm",
        made.planetary_gear,
        tuple(0.25 * k for k in range(1, 17)),
        6.0,
        known.gear_motion,
    ),
    PublishedCase(
        "slider on a driven rod",
        "closed form: r = r0 cosh(w t), pushed by 2 m w r', which the motor turns against",
        made.slider_on_rod,
        tuple(0.15 * k for k in range(1, 7)),
        2.0 * np.sqrt(2.0),
        known.slider_motion,
    ),
    PublishedCase(
        "disk in a ring",
        "closed form: rolling without slip it is a pendulum with gravity over 1 + I / (m r^2)",
        made.disk_in_ring,
        tuple(0.25 * k for k in range(1, 17)),
        4.0,
        known.ring_motion,
    ),
    PublishedCase(
        "moving load",
        "closed form: A. N. Krylov's series of a force that moves over a simply supported beam",
        made.moving_load,
        tuple(np.linspace(0.0, 4.0 / 3.0, 21)[1:].tolist()),
        1.0,
        known.moving_load_motion,
        # Shear and rotary inertia, and the shortening of the beam.
        floor=4e-4,
    ),
    PublishedCase(
        "follower load",
        "the elastica under a force that turns with its tip, by Runge-Kutta from there",
        made.follower_cantilever,
        (4.0,),
        1.0,
        known.follower_rest,
        floor=1e-4,
    ),
)
