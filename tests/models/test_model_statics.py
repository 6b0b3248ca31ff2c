"""`beamdae static` finds the equilibrium of every model or says why there is none."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from numpy.testing import assert_allclose
from test_models import FOLDER, MODELS

import beamdae as bd

# Messages of models without a unique equilibrium.
SENTENCES = {
    # The torque starts at zero.
    "hub_beam": "hub.angle: this coordinate can move without stiffness",
    # The bead and its position on the rail slide off.
    "sliding_mass": ": no equilibrium was found under the loads at t = 0 s",
    # Only friction and speed balance the driving weight.
    "governor": "rotor.angle: no equilibrium was found under the loads at t = 0 s",
    "quick_return": "friction depends on the sliding velocity and is zero at rest",
}
ENDS = {"sliding_mass": 1, "governor": 2}
# Without its weight, the strip is in equilibrium at any angle: rounding decides whether the first
# row is stable, and whether load steps can begin there.
INDIFFERENT = {"inverted_pendulum": "(last converged load factor: 0)"}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_static_command_finds_equilibrium_or_says_why_not(name, tmp_path):
    result = invoke(
        *["static", str(FOLDER / f"{name}.py"), "--out", str(tmp_path)], env={"COLUMNS": "200"}
    )
    output = " ".join((result.stdout + result.stderr).split())
    if name in INDIFFERENT and result.exit_code == 1:
        assert INDIFFERENT[name] in output
        return
    assert result.exit_code == ENDS.get(name, 0), result.output
    if name in SENTENCES:
        assert SENTENCES[name] in output
    else:
        assert "warning" not in output
    if result.exit_code == 2:
        return
    record = json.loads(Path(tmp_path / f"{name}_static.json").read_text())
    if name not in INDIFFERENT:
        assert record["stable"] == (name not in {"hub_beam", "sliding_mass"})
    if result.exit_code == 0:
        assert record["load factor"] == 1.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("name", sorted(set(MODELS) - set(ENDS) - set(INDIFFERENT)))
def test_relaxation_and_load_steps_give_the_same_equilibrium(name):
    """Load steps against relaxation under the full load."""
    path = bd.equilibrium(MODELS[name])
    start = bd.equations_of_motion(MODELS[name](), start="equilibrium")
    scale = start.position_scales
    assert_allclose(path.q[-1] / scale, start.q0 / scale, atol=1e-9)
    assert np.all(path.unstable == 0)


def test_limit_load_of_the_shallow_arch():
    path = bd.equilibrium(MODELS["shallow_arch"], to={"crown.y": 0.0})
    (limit,) = path.critical
    assert limit.factor * MODELS["shallow_arch"].parameters["load"] == pytest.approx(38.1, abs=0.05)
