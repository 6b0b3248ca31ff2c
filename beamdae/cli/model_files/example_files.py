"""Where the models that come with beamdae are, by name."""

from __future__ import annotations

from pathlib import Path

from beamdae.errors import BeamdaeError, short_repr, suggest

PREFIX = "example:"


def folder() -> Path:
    """Where the examples are: in the package, or beside it in a clone."""
    import beamdae

    package = Path(beamdae.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "models"


def names() -> list[str]:
    """Of all examples."""
    return sorted(file.stem for file in folder().glob("*.py") if file.stem != "__init__")


def as_file(path: Path) -> Path:
    """The path of a model file, which may be `example:NAME`.

    Raises
    ------
    BeamdaeError
        If there is no example of the name.
    """
    text = str(path)
    return example(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else path


def example(name: str) -> Path:
    """The file of an example.

    Raises
    ------
    BeamdaeError
        If there is none of the name.
    """
    known = names()
    if name not in known:
        raise BeamdaeError(
            f"{PREFIX}{name}: there is no example {short_repr(name)}{suggest(name, known)}, "
            f"the examples are {', '.join(known)}."
        )
    return folder() / f"{name}.py"
