"""Faster import of Matplotlib by commands."""

from __future__ import annotations

from importlib import import_module


def import_matplotlib() -> None:
    """Import what Matplotlib needs for a picture, without lists of properties in its docstrings.

    These lists take a quarter of the time of the import (55 ms), and no command shows them.
    """
    from matplotlib import artist

    list_properties = artist.kwdoc
    artist.kwdoc = lambda artist: ""
    try:
        import_module("matplotlib.figure")
        import_module("matplotlib.backends.backend_agg")
    finally:
        artist.kwdoc = list_properties
