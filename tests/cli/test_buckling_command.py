"""`beamdae buckling`: table, picture and usage errors."""

import json
from pathlib import Path

import pandas as pd
import pytest
from command_line import invoke
from model_texts import STRUT


@pytest.fixture
def buckling(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("column.py").write_text(STRUT, encoding="utf-8")
    return lambda *arguments: invoke("buckling", "column.py", *arguments)


@pytest.mark.slow
def test_a_table_and_a_picture_are_written(buckling):
    result = buckling("-n", "2", "--set", "height=0.001")
    assert result.exit_code == 0, result.output
    assert "2.467" in result.stdout
    assert "error" in result.stdout
    assert "loads  press" in result.stdout
    table = pd.read_csv("results/column_buckling.csv")
    assert table["load factor [-]"].tolist() == pytest.approx([2.467, 22.207], rel=1e-3)
    assert Path("results/column_buckling.png").stat().st_size > 1000


@pytest.mark.slow
def test_json_contains_the_factors(buckling):
    result = buckling("-n", "1", "--json")
    document = json.loads(result.stdout)
    assert document["loads"] == ["press"]
    assert document["modes"][0]["load factor [-]"] == pytest.approx(2.467, rel=1e-3)
