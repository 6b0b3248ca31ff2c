"""Worker that runs models of the checkout in PYTHONPATH; see `measurement.start_checkout`."""

import json
import sys
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from measurement import time_integration

import beamdae as bd


@cache
def _assemble(model: str, parameters: str) -> tuple[bd.results.EquationsOfMotion, float]:
    function = getattr(import_module(model), model)
    return bd.equations_of_motion(function(**json.loads(parameters))), function.t_end


def time_run(
    model: str, parameters: dict[str, Any], integrator: str, settings: dict[str, Any]
) -> dict[str, Any]:
    """Return the processor time of the integration of a model [s], and its steps."""
    equations, t_end = _assemble(model, json.dumps(parameters))
    method = getattr(bd, integrator)(**settings)
    seconds, solution = time_integration(equations, method, np.linspace(0.0, t_end, 201))
    return {"integrate": seconds, "steps": solution.statistics.steps}


def main() -> None:
    for line in sys.stdin:
        print(json.dumps(time_run(**json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
