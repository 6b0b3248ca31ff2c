"""Models of studies that several tests share."""

from pathlib import Path

import mechanisms

import beamdae as bd


@bd.model(t_end=0.1)
def swing(mass=2.0, note=None, marker=""):
    """Return a body on a hinge; `note` has no effect, and building it creates the file `marker`."""
    if marker:
        Path(marker).touch()
    return mechanisms.swing(mass)
