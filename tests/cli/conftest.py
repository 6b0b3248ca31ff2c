"""Fixtures of tests of commands."""

from pathlib import Path

import pytest


@pytest.fixture
def here(tmp_path, monkeypatch, request):
    """Working folder that contains MODEL of the test module as model.py."""
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(request.module.MODEL, encoding="utf-8")
    return tmp_path
