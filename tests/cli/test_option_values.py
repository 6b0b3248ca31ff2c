"""Values of command-line options that are converted without pydantic."""

from pathlib import Path

import pytest
import typer
from typer.core import TyperCommand
from typer.testing import CliRunner

from beamdae.cli import option_values
from beamdae.cli.app import create_app


def test_values_have_the_types_of_the_options(monkeypatch):
    """The conversion agrees with Typer's, which converts everything if nothing is plain."""
    app = typer.Typer()
    received = []

    @app.command()
    def command(
        path: Path,
        name: str = "auto",
        rtol: float | None = None,
        jobs: int | None = None,
        settings: list[str] | None = None,
    ) -> None:
        received.append((path, name, rtol, jobs, settings))

    def run():
        received.clear()
        for line in lines:
            assert CliRunner().invoke(app, line).exit_code == 0
        return list(received)

    lines = [
        ["model.py"],
        ["model.py", "--name", "ida", "--rtol", "1e-6", "--jobs", "2"],
        ["model.py", "--rtol", " 2 ", "--jobs", "3.0", "--settings", "a=1", "--settings", "b"],
    ]
    expected = run()
    get_params = TyperCommand.get_params

    def get_plain_params(self, ctx):
        parameters = get_params(self, ctx)
        for parameter in parameters:
            option_values.convert_plain_values(parameter)
        return parameters

    monkeypatch.setattr(TyperCommand, "get_params", get_plain_params)
    assert run() == expected
    assert received[0] == (Path("model.py"), "auto", None, None, None)
    assert received[2][2:] == (2.0, 3, ["a=1", "b"])


@pytest.mark.parametrize("option", [["--rtol", "fast"], ["--rtol", ""], ["--max-order"]])
def test_values_that_are_not_plain_are_rejected_by_typer(option):
    result = CliRunner().invoke(create_app("run"), ["run", "example:hub_beam", *option])
    assert result.exit_code == 2
    assert option[0] in result.stderr


def test_an_application_has_only_the_chosen_commands():
    result = CliRunner().invoke(create_app("run"), ["--help"])
    assert "run" in result.stdout
    assert "sweep" not in result.stdout
    assert "sweep" in CliRunner().invoke(create_app(), ["--help"]).stdout
