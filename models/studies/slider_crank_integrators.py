"""Integrators on the slider-crank: both frames, damped and undamped, 4 and 8 elements, 2 s."""

from pathlib import Path

import beamdae as bd

slider_crank = bd.load_model(Path(__file__).parents[1] / "slider_crank.py")

INTEGRATORS = [
    *(bd.Ida(rtol=rtol) for rtol in (1e-3, 1e-4, 1e-5)),
    *(bd.Radau(rtol=rtol) for rtol in (1e-3, 1e-4, 1e-5)),
    *(bd.GeneralizedAlpha(step=step) for step in (2e-3, 1e-3, 5e-4)),
]


@bd.study(
    t_end=2.0,
    columns=["slider.x [m]", "rod frame.angle [rad]"],
    references=(bd.Radau(rtol=1e-7), bd.GeneralizedAlpha(step=1e-4, newton_tolerance=1e-9)),
    time_limit=20.0,
)
def slider_crank_integrators():
    return [
        bd.Case(slider_crank, parameters, integrator)
        for parameters in bd.grid(frame=["tangent", "chord"], damping=[1e-5, 0.0], elements=[4, 8])
        for integrator in INTEGRATORS
    ]
