"""`beamdae periodic`: forced and self-excited motions, and usage errors."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from model_texts import VAN_DER_POL


@pytest.fixture
def periodic(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(VAN_DER_POL, encoding="utf-8")
    return lambda *arguments: invoke("periodic", "model.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_a_self_excited_motion_is_written(periodic):
    result = periodic()
    assert result.exit_code == 0, result.output
    period = float(re.search(r"period +(\S+) s", result.stdout)[1])
    assert period == pytest.approx(6.6632869, rel=1e-7), result.stdout
    table = pd.read_csv("results/oscillator_periodic.csv")
    assert table["t [s]"].iloc[-1] == pytest.approx(6.6632869, rel=1e-7)
    assert Path("results/oscillator_periodic.png").stat().st_size > 1000


@pytest.mark.slow(reason="a quarter of a second")
def test_json_of_a_forced_motion(periodic):
    # With growth = 0, the oscillator is linear and undamped.
    options = ["--set", "force=1.0", "--set", "growth=0.0", "--period", "4", "--rtol", "1e-6"]
    document = json.loads(periodic(*options, "--json").stdout)
    assert document["status"] == "ok"
    assert document["stable"]
    half = document["observed"]["mass.x [m]"]["half range"]
    assert half == pytest.approx(1.0 / ((0.5 * np.pi) ** 2 - 1.0), rel=1e-3)
    assert np.hypot(*document["multipliers"][0]) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow(reason="a quarter of a second")
def test_a_failed_search_exits_with_1(periodic):
    # With negative growth, all motions decay.
    result = periodic("--set", "growth=-1.0", "--period-guess", "6")
    assert result.exit_code == 1
    assert "failed: " in result.stderr
