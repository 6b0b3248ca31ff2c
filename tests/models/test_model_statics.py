"""Every model answers `beamdae static`: by where it rests, or by one sentence why it does not."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_models import FOLDER, MODELS
from typer.testing import CliRunner

import beamdae as bd
from beamdae.cli.app import app

# What those that do not rest somewhere alone say.
SENTENCES = {
    # Its torque begins at zero.
    "hub_beam": "hub.angle: it is free to move without stiffness",
    # It slides off, bead and place on the rail alike.
    "sliding_mass": ": no equilibrium was found, this coordinate moves without end",
    # Nothing but rubbing and its speed hold the weight that drives it.
    "governor": "rotor.angle: no equilibrium was found, this coordinate moves without end",
    "quick_return": "friction depends on the sliding velocity and is zero at rest",
}
ENDS = {"sliding_mass": 1, "governor": 2}


@pytest.mark.slow(reason="a path and a picture of every model")
@pytest.mark.parametrize("name", MODELS)
def test_a_model_rests_or_says_why_not(name, tmp_path):
    found = CliRunner().invoke(
        app, ["static", str(FOLDER / f"{name}.py"), "--out", str(tmp_path)], env={"COLUMNS": "200"}
    )
    assert found.exit_code == ENDS.get(name, 0), found.output
    told = " ".join((found.stdout + found.stderr).split())
    if name in SENTENCES:
        assert SENTENCES[name] in told
    else:
        assert "warning" not in told
    if found.exit_code == 2:
        return
    beside = json.loads(Path(tmp_path / f"{name}_static.json").read_text())
    assert beside["stable"] == (name not in {"hub_beam", "sliding_mass"})
    if found.exit_code == 0:
        assert beside["load factor"] == 1.0


@pytest.mark.slow(reason="equilibria of every model by two methods")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("name", sorted(set(MODELS) - set(ENDS)))
def test_the_start_in_equilibrium_is_the_end_of_the_path(name):
    """By load steps, and by relaxation under all of the load at once."""
    path = bd.equilibrium(MODELS[name])
    start = bd.equations_of_motion(MODELS[name](), start="equilibrium")
    scale = start.position_scales
    assert_allclose(path.q[-1] / scale, start.q0 / scale, atol=1e-9)
    assert np.all(path.unstable == 0)


def test_the_arch_has_the_limit_load_it_tells():
    path = bd.equilibrium(MODELS["shallow_arch"], to={"crown.y": 0.0})
    (limit,) = path.critical
    assert limit.factor * MODELS["shallow_arch"].parameters["load"] == pytest.approx(38.1, abs=0.05)
