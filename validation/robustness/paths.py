"""Random frames: their equilibrium paths obey the laws of `tests/properties/random_frames.py`.

Frames without an equilibrium under small loads, of which the program says so, are not judged.
"""

from properties.random_frames import check_path, draw_frame

SEED_COUNT = 300


def list_names() -> list[str]:
    """Return all seeds."""
    return [str(seed) for seed in range(SEED_COUNT)]


def try_name(name: str) -> list[str | None]:
    """Return the departure from each law; None for a frame that cannot be judged."""
    departures = list(check_path(draw_frame(int(name))))
    return [f"{law}: {what}" if what else "" for law, what in departures] or [None]
