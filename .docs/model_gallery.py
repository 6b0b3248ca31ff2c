"""The gallery: of each model a script that sphinx-gallery runs and shows."""

import ast
import logging
from itertools import islice
from pathlib import Path

from PIL import Image, ImageOps, ImageSequence
from sphinx_gallery.scrapers import figure_rst

import beamdae as bd

MODELS = Path(__file__).parents[1] / "models"
HEADER = """Gallery
=======

The models of ``models/``, which travel with the package: ``beamdae examples`` lists them,
``beamdae run example:NAME`` runs one, ``beamdae new my_model.py --like NAME`` copies it.
"""
SCRIPT = '''"""
{title}
{underline}

{summary}
"""

{source}

# %%
# As it is stated, before anything is run:

{name}().draw()

# %%
# A run of {t_end:g} s:

solution = bd.simulate({name})
solution.animate("{name}.gif", speed={speed:.2g})

# %%
# What it cost, and how far it is to be trusted:

solution

# %%
# Some of its columns:

solution.plot()

# sphinx_gallery_thumbnail_number = 2
'''
# It says of every file which writer it takes.
logging.getLogger("matplotlib.animation").setLevel(logging.WARNING)
# Every motion takes so long to look at [s].
SHOWN = 3.0
# Of a thumbnail [px], on screens of two pixels a point.
SIZE, COLORS = (320, 224), 16


def write_scripts(folder):
    """A script of each model, and what is above them all."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.py"):
        old.unlink()
    (folder / "GALLERY_HEADER.rst").write_text(HEADER)
    for path in sorted(MODELS.glob("*.py")):
        text, t_end = path.read_text(), bd.load_model(str(path)).t_end
        docstring = ast.parse(text).body[0]
        title = path.stem.replace("_", " ").capitalize()
        made = SCRIPT.format(
            title=title,
            underline="=" * len(title),
            summary=docstring.value.value,
            source="\n".join(text.splitlines()[docstring.end_lineno :]).strip(),
            name=path.stem,
            t_end=t_end,
            speed=t_end / SHOWN,
        )
        (folder / path.name).write_text(made)


def shrink_thumbnails(app):
    """Have moving thumbnails of the size they are shown at, with every second picture."""
    for path in Path(app.srcdir, "gallery", "images", "thumb").glob("*.gif"):
        with Image.open(path) as moving:
            lasts = 2 * moving.info["duration"]
            frames = [
                ImageOps.contain(frame.convert("RGB"), SIZE).quantize(COLORS)
                for frame in islice(ImageSequence.Iterator(moving), 0, None, 2)
            ]
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=lasts, loop=0)


def pictures(block, variables, gallery):
    """What a block ends with, as a picture if it is one."""
    shown = variables["example_globals"].get("___")
    if isinstance(shown, bd.Plot):
        path = Path(next(variables["image_path_iterator"]))
        shown.save(path)
    elif isinstance(shown, Path):
        path = Path(next(variables["image_path_iterator"])).with_suffix(shown.suffix)
        shown.replace(path)
    else:
        return ""
    return figure_rst([path], gallery["src_dir"])
