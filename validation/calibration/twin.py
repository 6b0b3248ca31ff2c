"""Twin of the pendulum experiment of Pan & Liu (2012): synthetic records of two strain gauges."""

import numpy as np

import beamdae as bd

# True values, and values from which the fits start.
TRUE = {"E": 68.95e9, "tip_mass": 0.060, "damping": 1.0e-3, "air_drag": 0.08, "angle": -0.60}
FIRST = {"E": 66.0e9, "tip_mass": 0.063, "damping": 1.5e-3, "air_drag": 0.05, "angle": -0.62}
BOUNDS = {
    "E": (40e9, 120e9),
    "tip_mass": (0.03, 0.12),
    "damping": (1e-4, 1e-2),
    "air_drag": (0.01, 1.0),
    "angle": (-0.8, -0.4),
}
LOG = ["damping", "air_drag"]
# Gauge 1 has an unknown amplifier; both gauges have the same delay.
SCALE, OFFSET, SHIFT = 1.07, 4e-6, 0.012
NOISE = 1e-6  # standard deviation of strains: a microstrain, as of usual amplifiers
SENSORS = {"scale": ["gauge 1"], "offset": ["gauge 1"], "shift": {"*": (-0.05, 0.05)}}
TIMES = np.linspace(0.1, 2.0, 191)
METHOD = bd.GeneralizedAlpha(step=2.5e-3)


@bd.model(t_end=2.0)
def pendulum(
    E=68.95e9,
    thickness=0.0025,
    tip_mass=0.060,
    damping=1e-3,
    air_drag=0.05,
    angle=-0.60,
    elements=4,
):
    """Release the curved strip of Table 1 with a tip mass from rest at `angle` [rad]."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=E, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=thickness, damping=damping)
    arc = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=angle)
    beam = mech.add(bd.Beam("beam", arc, strip, elements, strain="exact"))
    mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.AirDrag("air", beam, air_drag))
    mech.observe("gauge 1", beam.strain(s=0.50, offset=-0.5 * thickness))
    mech.observe("gauge 2", beam.strain(s=0.25, offset=-0.5 * thickness))
    return mech


def exact_record(times=TIMES, method=METHOD, **parameters):
    """Return the records of both gauges without noise."""
    run = bd.simulate(pendulum(**{**TRUE, **parameters}), method, t_end=float(times[-1]) + 0.1)
    strain = run.at_times(times - SHIFT)
    return {
        "t [s]": times,
        "gauge 1": SCALE * strain["gauge 1"].to_numpy() + OFFSET,
        "gauge 2": strain["gauge 2"].to_numpy(),
    }


def noisy_record(record, seed):
    """Return a record with noise of the standard deviation `NOISE`."""
    generator = np.random.default_rng(seed)
    return {
        name: x if name == "t [s]" else x + generator.normal(scale=NOISE, size=len(x))
        for name, x in record.items()
    }


def fit(data, **options):
    """Fit the five parameters of the model and three properties of the gauges."""
    options = {"parameters": FIRST, "bounds": BOUNDS, "log": LOG, **SENSORS, **options}
    return bd.fit(pendulum, data, list(TRUE), METHOD, sigma=NOISE, **options)
