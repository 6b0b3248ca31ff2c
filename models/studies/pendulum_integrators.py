"""Integrators on the pendulum: damped and undamped, 4 and 8 elements, 2 s."""

from pathlib import Path

import beamdae as bd

pendulum = bd.load_model(Path(__file__).parents[1] / "pendulum.py")

INTEGRATORS = [
    *(bd.Ida(rtol=rtol) for rtol in (1e-3, 1e-4, 1e-5, 1e-6)),
    *(bd.Ida(rtol=rtol, formulation="ggl") for rtol in (1e-4, 1e-5)),
    *(bd.Radau(rtol=rtol) for rtol in (1e-2, 1e-3, 1e-4, 1e-5)),
    *(bd.GeneralizedAlpha(step=step) for step in (2e-3, 1e-3, 5e-4, 2.5e-4)),
    *(bd.GeneralizedAlpha(step=step, rho_inf=0.5) for step in (1e-3, 5e-4)),
    *(bd.GeneralizedAlpha(step=1e-3, rtol=rtol) for rtol in (1e-3, 1e-4)),
]


@bd.study(
    t_end=2.0,
    columns=["tip.x [m]", "tip.y [m]", "frame.angle [rad]"],
    references=(bd.Radau(rtol=1e-7), bd.GeneralizedAlpha(step=5e-5, newton_tolerance=1e-9)),
    time_limit=20.0,
)
def pendulum_integrators():
    return [
        bd.Case(pendulum, parameters, integrator)
        for parameters in bd.grid(damping=[1e-4, 0.0], elements=[4, 8])
        for integrator in INTEGRATORS
    ]
