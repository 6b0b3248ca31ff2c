"""Models of the page in the browser: `animate` runs one and returns an HTML player."""

import beamdae as bd

METHODS = {"GeneralizedAlpha": bd.GeneralizedAlpha(2e-3)}
MODELS = {"four_bar": 1.0, "pendulum": 1.0}  # end times [s]


def animate(name, method="GeneralizedAlpha", elements=2):
    """Run an example; return the animation, as HTML, and a line about the run."""
    model = bd.load_model(f"example:{name}")(elements=elements, formulation="exact")
    run = bd.simulate(model, METHODS[method], t_end=MODELS[name])
    return run.animate()._repr_html_(), f"{run.statistics.steps} steps; {run.status.sentence}"
