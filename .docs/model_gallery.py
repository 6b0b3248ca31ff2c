"""Scripts of the gallery, one per model, which sphinx-gallery runs and displays."""

import ast
import logging
from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

import beamdae as bd

MODELS = Path(__file__).parents[1] / "models"
HEADER = """Gallery
=======

The gallery shows the models in ``models/``, which are installed with the package, and pages with
further examples. ``beamdae examples`` lists the models, ``beamdae run example:NAME`` runs one, and
``beamdae new my_model.py --like NAME`` copies one. Choose a topic to show only its entries.
"""
SCRIPT = '''"""
{title}
{underline}

{summary}
"""

{source}

# %%
# The mechanism as drawn:

{name}().draw()

# %%
# A run of {t_end:g} s:

solution = bd.simulate({name})
solution.animate("{name}.gif", speed={speed:.2g})

# %%
# Cost and accuracy of the run:

solution

# %%
# Some of its columns:

solution.plot()
'''
# Suppresses a message about the writer of each file.
logging.getLogger("matplotlib.animation").setLevel(logging.WARNING)
ANIMATION_DURATION = 3.0  # of every model [s]


def write_scripts(folder):
    """Write a script for each model, and the header of the gallery."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.py"):
        old.unlink()
    (folder / "GALLERY_HEADER.rst").write_text(HEADER)
    for path in sorted(MODELS.glob("*.py")):
        text, t_end = path.read_text(), bd.load_model(str(path)).t_end
        docstring = ast.parse(text).body[0]
        title = path.stem.replace("_", " ").capitalize()
        script = SCRIPT.format(
            title=title,
            underline="=" * len(title),
            summary=docstring.value.value,
            source="\n".join(text.splitlines()[docstring.end_lineno :]).strip(),
            name=path.stem,
            t_end=t_end,
            speed=t_end / ANIMATION_DURATION,
        )
        (folder / path.name).write_text(script)


def save_picture(block, variables, gallery):
    """Save the value of a block's last expression if it is a plot or an animation."""
    value = variables["example_globals"].get("___")
    if isinstance(value, bd.results.Plot):
        path = Path(next(variables["image_path_iterator"]))
        value.save(path)
    elif isinstance(value, Path):
        path = Path(next(variables["image_path_iterator"])).with_suffix(value.suffix)
        value.replace(path)
    else:
        return ""
    return figure_rst([path], gallery["src_dir"])
