"""Shell completion of commands and options."""

from pathlib import Path

import pytest
from terminals import process


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_completion_is_installed_for_the_named_shell(here):
    command = process(
        "--install-completion",
        "bash",
        environment={"HOME": str(here), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
    )
    _, errors = command.communicate(timeout=60)
    assert command.returncode == 0, errors
    assert "_BEAMDAE_COMPLETE" in Path(".bash_completions/beamdae.sh").read_text()
