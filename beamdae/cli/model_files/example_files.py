"""Where the models that come with beamdae are, by name."""

from __future__ import annotations

from pathlib import Path

from beamdae.errors import BeamdaeError, short_repr, suggest

PREFIX = "example:"


def examples_folder() -> Path:
    """Where the examples are: in the package, or beside it in a clone."""
    import beamdae

    package = Path(beamdae.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "models"


def example_names() -> list[str]:
    """Of all examples."""
    return sorted(file.stem for file in examples_folder().glob("*.py") if file.stem != "__init__")


def resolve_path(path: Path) -> Path:
    """The path of a model file, which may be `example_file:NAME`.

    Raises
    ------
    BeamdaeError
        If there is no example of the name.
    """
    text = str(path)
    return example_file(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else path


def example_file(name: str) -> Path:
    """The file of an example.

    Raises
    ------
    BeamdaeError
        If there is none of the name.
    """
    known = example_names()
    if name not in known:
        raise BeamdaeError(
            f"{PREFIX}{name}: there is no example {short_repr(name)}{suggest(name, known)}, "
            f"the examples are {', '.join(known)}."
        )
    return examples_folder() / f"{name}.py"
