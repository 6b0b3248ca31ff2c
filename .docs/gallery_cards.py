"""Cards of the gallery: picture, title, one line of text and tags of each model and example."""

import ast
import html
import re
from itertools import islice
from pathlib import Path

from PIL import Image, ImageChops, ImageOps, ImageSequence

MODELS = Path(__file__).parents[1] / "models"
SIZE = (360, 220)  # of thumbnails [px], for screens with two pixels per point
COLORS = 24
CAPTION_HEIGHT = 24  # of the time above the frames of an animation [px]
# Lines of pictures that are scaled down by more than this are thickened before.
THICKEN_FROM = 1.3

# Tags of the models; their titles are those of the scripts, their texts the docstrings.
MODEL_TAGS = {
    "active_damping": ("control", "vibration"),
    "four_bar": ("linkage",),
    "governor": ("rotation", "contact"),
    "hub_beam": ("rotation", "paper"),
    "inverted_pendulum": ("control",),
    "leaf_spring_vehicle": ("contact", "vehicle"),
    "pendulum": ("paper",),
    "press": ("linkage", "tables"),
    "quick_return": ("linkage",),
    "ring_mount": ("vibration",),
    "shallow_arch": ("statics",),
    "slider_crank": ("linkage", "paper"),
    "sliding_mass": ("contact",),
    "spin_up": ("rotation",),
    "voice_coil_stage": ("control", "compliant"),
}
# Other pages with examples: title, text, tags and number of the picture on the page.
EXAMPLES = {
    "tutorials/four_bar": (
        "Tutorial: four-bar",
        "From geometry to a fit of the spring, in one hour.",
        ("tutorial", "linkage", "fit"),
        1,
    ),
    "tutorials/stage": (
        "Tutorial: compliant stage",
        "Leaf springs and a PID controller that samples at 1 kHz.",
        ("tutorial", "control", "compliant"),
        0,
    ),
    "tutorials/drop_test": (
        "Tutorial: drop test",
        "Pad force and load cell from CSV files; a circuit board strikes its housing.",
        ("tutorial", "contact", "tables", "fit"),
        0,
    ),
    "tutorials/blade": (
        "Tutorial: rotating blade",
        "Campbell diagram, shaker test, run-up through a resonance, rainflow counting.",
        ("tutorial", "rotation", "vibration"),
        3,
    ),
    "tutorials/snapping_arch": (
        "Tutorial: snapping arch",
        "Limit load, imperfections, sudden loads and the snap itself.",
        ("tutorial", "statics"),
        2,
    ),
    "tutorials/gauges": (
        "Tutorial: from gauge to model",
        "Eight unknowns of a pendulum, identified from two strain gauges.",
        ("tutorial", "fit"),
        0,
    ),
    "tutorials/gripper": (
        "Tutorial: compliant gripper",
        "The thickness of a finger, optimized with a stress limit.",
        ("tutorial", "compliant", "optimization"),
        0,
    ),
    "howto/statics_and_modes": (
        "Limit load and modes",
        "The path of an arch past its limit load, and its natural modes.",
        ("statics", "vibration"),
        1,
    ),
    "howto/sweep": (
        "Sweep with limits",
        "Thickness and rise of a coupler within limits of stress and deflection.",
        ("linkage", "optimization"),
        1,
    ),
    "guide/controllers": (
        "Motor with a PID controller",
        "A flexible arm, turned by a continuous and by a sampled controller.",
        ("control",),
        0,
    ),
}


def write_cards(app, docname, source):
    """Replace the thumbnails on the page of the gallery by cards with texts and tags."""
    if docname != "gallery/index":
        return
    begin, _, _ = source[0].partition(".. raw:: html")
    links = source[0][source[0].rindex(".. toctree::") :]
    cards = "\n".join(_card(*entry) for entry in _entries())
    tags = sorted({tag for *_, tags in _entries() for tag in tags})
    buttons = "\n".join(
        f'<button type="button" data-tag="{tag}" aria-pressed="false">{tag}</button>'
        for tag in tags
    )
    block = f"""<div class="gallery-tags" role="group" aria-label="Filter by topic">
{buttons}
</div>
<p class="gallery-count" role="status"></p>
<div class="gallery-cards">
{cards}
</div>"""
    raw = ".. raw:: html\n\n" + "\n".join(f"   {line}" for line in block.splitlines())
    source[0] = f"{begin}{raw}\n\n{links}"


def save_thumbnails(app, exception):
    """Write the pictures of the cards, from those of the pages that have been built."""
    if exception or app.builder.format != "html":
        return
    folder = Path(app.outdir, "_static", "thumbnails")
    folder.mkdir(exist_ok=True)
    for page, *_ in _entries():
        picture = _find_picture(app, page)
        if picture is not None:
            save_cropped(picture, folder / _thumbnail(page), SIZE, every=2)


def _entries():
    """Yield page, title, text and tags of each entry."""
    for path in sorted(MODELS.glob("*.py")):
        docstring = ast.get_docstring(ast.parse(path.read_text("utf-8")))
        title = path.stem.replace("_", " ").capitalize()
        text = docstring.partition("\n\n")[0]
        yield f"gallery/{path.stem}", title, text, MODEL_TAGS[path.stem]
    for page, (title, text, tags, _) in EXAMPLES.items():
        yield page, title, text, tags


def _card(page, title, text, tags):
    title, text = html.escape(title), html.escape(text)
    return f"""<a class="gallery-card" href="../{page}.html" data-tags="{" ".join(tags)}">
<img src="../_static/thumbnails/{_thumbnail(page)}" alt="" loading="lazy">
<strong>{title}</strong>
<span>{text}</span>
<small>{", ".join(tags)}</small>
</a>"""


def _thumbnail(page):
    """Return the name of the file with the picture of a card."""
    is_model = page.startswith("gallery/")
    return f"{page.replace('/', '_')}.{'gif' if is_model else 'png'}"


def _find_picture(app, page):
    """Return the animation of a model, or the chosen picture of another page; None if missing."""
    if page.startswith("gallery/"):
        name = page.removeprefix("gallery/")
        picture = Path(app.srcdir, "gallery", "images", f"sphx_glr_{name}_002.gif")
        return picture if picture.exists() else None
    text = Path(app.outdir, f"{page}.html").read_text("utf-8")
    names = re.findall(r'<img [^>]*src="\.\./_images/([^"]+\.png)"', text)
    number = EXAMPLES[page][3]
    return Path(app.outdir, "_images", names[number]) if number < len(names) else None


def save_cropped(picture, path, size, every=1, bottom=0):
    """Cut off margins and captions, thicken lines and scale a picture or animation.

    Of an animation, every `every`-th frame is kept, and `bottom` pixels below the drawing and the
    time above it are removed.
    """
    with Image.open(picture) as image:
        is_animation = getattr(image, "n_frames", 1) > 1
        duration = every * image.info.get("duration", 50)
        sequence = islice(ImageSequence.Iterator(image), 0, None, every)
        frames = [frame.convert("RGB") for frame in sequence]
    if is_animation:
        width, height = frames[0].size
        frames = [frame.crop((0, CAPTION_HEIGHT, width, height - bottom)) for frame in frames]
    white = Image.new("RGB", frames[0].size, "white")
    boxes = [b for frame in frames if (b := ImageChops.difference(frame, white).getbbox())]
    lefts, uppers, rights, lowers = zip(*boxes, strict=True)
    box = (min(lefts), min(uppers), max(rights), max(lowers))
    shrinks = max((box[2] - box[0]) / size[0], (box[3] - box[1]) / size[1]) > THICKEN_FROM
    results = []
    for frame in frames:
        part = frame.crop(box)
        part = thicken_lines(part) if shrinks else part
        results.append(ImageOps.pad(part, size, color="white").quantize(COLORS))
    others = {"save_all": True, "append_images": results[1:], "duration": duration, "loop": 0}
    results[0].save(path, **(others if is_animation else {}))


def thicken_lines(image):
    """Replace each pixel by the darkest of the nine around it.

    Same result as `ImageFilter.MinFilter(3)`, in a tenth of its time.
    """
    width, height = image.size
    wide = ImageOps.expand(image, 1, "white")
    rows = [wide.crop((k, 0, k + width, height + 2)) for k in range(3)]
    rows = ImageChops.darker(ImageChops.darker(rows[0], rows[1]), rows[2])
    parts = [rows.crop((0, k, width, k + height)) for k in range(3)]
    return ImageChops.darker(ImageChops.darker(parts[0], parts[1]), parts[2])
