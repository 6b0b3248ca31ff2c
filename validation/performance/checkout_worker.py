"""Runs of the beamdae and the models that PYTHONPATH names: see `workers.checkout`."""

from __future__ import annotations

import json
import sys
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from timing import integrated

import beamdae as bd


@cache
def _equations(model: str, parameters: str) -> tuple[bd.EquationsOfMotion, float]:
    function = getattr(import_module(model), model)
    return bd.equations_of_motion(function(**json.loads(parameters))), function.t_end


def run(
    model: str, parameters: dict[str, Any], integrator: str, settings: dict[str, Any]
) -> dict[str, Any]:
    """Processor time of the integration of a model of the folder of models [s]."""
    equations, t_end = _equations(model, json.dumps(parameters))
    chosen = getattr(bd, integrator)(**settings)
    taken, solution = integrated(equations, chosen, np.linspace(0.0, t_end, 201))
    return {"integrate": taken, "steps": solution.statistics.steps}


def main() -> None:
    for line in sys.stdin:
        print(json.dumps(run(**json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
