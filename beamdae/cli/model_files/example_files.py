"""Files of the models installed with beamdae, called `example:NAME`."""

from __future__ import annotations

from pathlib import Path

from beamdae.errors import BeamdaeError, short_repr, suggest

PREFIX = "example:"


def examples_folder() -> Path:
    """Return the folder of the examples, which is next to the package in a source checkout."""
    import beamdae

    package = Path(beamdae.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "models"


def example_names() -> list[str]:
    """Return the names of all examples in alphabetical order."""
    files = examples_folder().glob("*.py")
    return sorted(file.stem for file in files if file.stem != "__init__")


def resolve_path(path: Path) -> Path:
    """Return the path of a model file; `example:NAME` becomes the file of that example.

    Raises
    ------
    BeamdaeError
        If no example has this name.
    """
    text = str(path)
    return example_file(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else path


def example_file(name: str) -> Path:
    """Return the file of an example.

    Raises
    ------
    BeamdaeError
        If no example has this name.
    """
    names = example_names()
    if name not in names:
        raise BeamdaeError(
            f"{PREFIX}{name}: there is no example {short_repr(name)}{suggest(name, names)}; "
            f"available examples: {', '.join(names)}."
        )
    return examples_folder() / f"{name}.py"
