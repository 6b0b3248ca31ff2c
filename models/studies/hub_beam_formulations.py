"""Formulations of the hub beam side by side, at one and five times its torque."""

from pathlib import Path

import beamdae as bd

hub_beam = bd.load_model(Path(__file__).parents[1] / "hub_beam.py")

FORMULATIONS = [
    {"formulation": "exact"},
    {"strain": "exact", "frame": "chord"},
    {"strain": "green", "frame": "chord"},
    {"strain": "nonlinear", "frame": "tangent"},
    {"strain": "linear", "frame": "tangent"},
]


@bd.study(t_end=2.0)
def hub_beam_formulations():
    return [
        bd.Case(hub_beam, {"torque": torque, **words}, bd.Radau(1e-6))
        for torque in (10.0, 50.0)
        for words in FORMULATIONS
    ]
