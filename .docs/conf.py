"""Configuration of the site, which builds offline: `sphinx-build -W -n .docs results/docs`."""

import importlib.util
import os
import re
import shutil
import sys
from itertools import takewhile
from operator import attrgetter
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import index, pending_xref, toctree
from sphinx.transforms import SphinxTransform

import beamdae as bd
from beamdae import catalog

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
model_gallery = importlib.import_module("model_gallery")
gallery_cards = importlib.import_module("gallery_cards")
generated_pages = importlib.import_module("generated_pages")
search_words = importlib.import_module("search_words")
kernel_server = importlib.import_module("kernel_server")
# Model files are imported by name, in notebooks as well.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, (str(HERE.parent), os.getenv("PYTHONPATH")))
)

project = "beamdae"
author = "The beamdae developers"
copyright = "The beamdae developers, MIT license"
version = release = bd.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["gallery/*.ipynb", "gallery/*.py", "scripts", "paper", "demo"]
templates_path = ["_templates"]

html_theme = "furo"
html_title = "beamdae"
# MathJax comes from a package, so that pages can be read offline. The package is not listed as an
# extension, because that would prevent parallel builds.
_mathjax = Path(importlib.util.find_spec("sphinx-mathjax-offline").origin).parent
html_static_path = ["_static", str(_mathjax / "static")]
mathjax_path = "mathjax/tex-chtml.js"
html_css_files = ["site.css"]
html_js_files = [("gallery.js", {"defer": "defer"})]
html_show_sphinx = False

# A name in single backticks links to its page where it has one.
default_role = "autolink"
nitpicky = True
# Types of other packages and internal types of beamdae have no page here.
nitpick_ignore_regex = [("py:class", r"(?!beamdae\.[A-Z]).*"), ("py:obj", r"(?!beamdae\.).*")]
suppress_warnings = ["toc.empty_glob"]

# Members of these protocols are documented once, on the page of the protocol.
_PROTOCOLS = {
    bd.Part: ["multipliers", "reactions", "constraint", "observed"],
    bd.Integrator: [],
}
autosummary_generate = True
autosummary_context = {
    "hidden": {
        public.name: ", ".join([*other_members, *(x for x in vars(protocol) if x[0] != "_")])
        for public in catalog.NAMES.values()
        for protocol, other_members in _PROTOCOLS.items()
        if isinstance(value := attrgetter(public.path)(bd), type)
        and issubclass(value, protocol)
        and value is not protocol
    }
}
autodoc_inherit_docstrings = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
napoleon_google_docstring = False
napoleon_use_ivar = True

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
# Files written by cells do not end up among the pages.
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True

copybutton_exclude = ".linenos, .gp, .go"

sphinx_gallery_conf = {
    "examples_dirs": "scripts",
    "gallery_dirs": "gallery",
    "filename_pattern": "",
    "image_scrapers": ("model_gallery.save_picture",),
    "capture_repr": ("_repr_html_",),
    "reset_modules": (),
    "backreferences_dir": "gallery/names",
    "doc_module": ("beamdae",),
    "reference_url": {"beamdae": None},
    "run_stale_examples": True,
    "abort_on_example_error": True,
    "within_subsection_order": "FileNameSortKey",
    "remove_config_comments": True,
    "download_all_examples": False,
    "min_reported_time": 1000,
    "write_computation_times": False,
    "show_memory": False,
    "show_signature": False,
}


def write_pages(app, config):
    """Write the generated pages, and copy the notebooks of `models/tutorials`.

    This comes before Sphinx lists the pages, because autosummary reads only the listed ones.
    """
    generated_pages.write_reference(HERE / "api")
    generated_pages.write_map(HERE / "develop" / "map.md")
    generated_pages.write_scoreboard(HERE / "develop" / "scoreboard.md")
    generated_pages.write_words(HERE / "words.md", search_words.WORDS)
    generated_pages.write_motion(HERE / "index.md", HERE / "first_screen.gif")
    model_gallery.write_scripts(HERE / "scripts")
    tutorials = HERE / "tutorials"
    shutil.rmtree(tutorials, ignore_errors=True)
    if (notebooks := HERE.parent / "models" / "tutorials").is_dir():
        shutil.copytree(notebooks, tutorials, ignore=shutil.ignore_patterns("*.py", "__pycache__"))


class AddSearchWords(SphinxTransform):
    """Enter the words of a page in the index; the search lists main entries first."""

    default_priority = 500  # before the domains collect the entries

    def apply(self):
        """Insert one node with all entries, which refer to the title of the page."""
        words = search_words.WORDS.get(self.env.docname, ())
        section = self.document.next_node(nodes.section)
        if words and section is not None:
            anchor = section["ids"][0]
            entries = [("single", word, anchor, "main", None) for word in words]
            self.document.insert(0, index(entries=entries))


def resolve_public_name(app, env, node, contnode):
    """Resolve references to the defining module of a public name to the page of the name."""
    public = catalog.NAMES.get(node.get("reftarget", "").rpartition(".")[2])
    if node.get("refdomain") != "py" or public is None:
        return None
    target = f"beamdae.{public.path}"
    domain = env.domains["py"]
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, contnode)


def link_code(app, doctree):
    """Link inline code such as `bd.Beam(...)` to the page of its name."""
    for code in list(doctree.findall(nodes.literal)):
        name = re.match(r"bd\.(?:results\.|quantities\.)?(\w+)", code.astext())
        public = catalog.NAMES.get(name[1]) if name else None
        if public is None or isinstance(code.parent, nodes.reference):
            continue
        target = f"beamdae.{public.path}"
        link = pending_xref("", refdomain="py", reftype="obj", reftarget=target, refwarn=True)
        link["refdoc"] = app.env.docname
        code.replace_self(link)
        link.append(code)


def describe_pictures(app, doctree):
    """Give pictures of notebooks a text; by default, it would be the name of the file."""
    for picture in doctree.findall(nodes.image):
        picture.setdefault("alt", "Picture: result of the code above")


# Stands for a colon while napoleon reads a docstring; from the private use area of Unicode.
_COLON = "\ue000"


def adapt_to_napoleon(app, what, name, value, options, lines):
    """Split attributes that share a description, and hide colons in summaries of properties."""
    adapted, section = [], ""
    for k, line in enumerate(lines):
        if set(line) == {"-"}:
            section = lines[k - 1]
        adapted.append(line)
        if section == "Attributes" and re.fullmatch(r"\w+(, \w+)+", line):
            *others, adapted[-1] = line.split(", ")
            body = list(takewhile(lambda text: text.startswith(" "), lines[k + 1 :]))
            adapted[-1:-1] = [entry for other in others for entry in (other, *body)]
    # In the first line of a property, napoleon takes text before a colon for a type.
    if what == "property":
        adapted[:1] = [line.replace(":", _COLON) for line in adapted[:1]]
    lines[:] = adapted


def escape_markup(app, what, name, value, options, lines):
    """Convert |x|, a . b and `Law`s, which are markup or errors in reStructuredText."""
    for k, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            line = line.replace(_COLON, ":")
            line = re.sub(r"`(\w+)`(?=s\b)", r"`\1`\\ ", line)
            line = re.sub(r"(?<=\S) \. (?=\S)", " · ", line)
            lines[k] = re.sub(r"(`[^`]*`)|\|", lambda m: m[1] or r"\|", line)


def shorten_navigation(app, env):
    """Omit the pages of single names from the side bar, whose tree is part of every page.

    The pages of the reference list them. With 200 names, writing pages would take twice the time.
    """
    for page, contents in env.tocs.items():
        if page.startswith("api/"):
            for names in list(contents.findall(toctree)):
                if any(target.startswith("api/names/") for _, target in names["entries"]):
                    names.parent.remove(names)
    return []


# The navigation does not list these pages, so it depends only on their folder and parents.
_UNLISTED_PAGES = ("api/names/", "_modules/")
_NAVIGATIONS = {}


def share_navigation(app, page, template, context, doctree):
    """Compute the navigation of unlisted pages once.

    It takes most of the time of writing a page.
    """
    compute = context.get("toctree")
    if compute is None or not page.startswith(_UNLISTED_PAGES):
        return
    place = (page.rpartition("/")[0], *(parent["link"] for parent in context["parents"]))

    def navigation(**options):
        key = (*place, *sorted(options.items()))
        if key not in _NAVIGATIONS:
            _NAVIGATIONS[key] = compute(**options)
        return _NAVIGATIONS[key]

    context["toctree"] = navigation


def start_kernels(app, env, pages):
    """Start the server of kernels if notebooks may be executed."""
    if pages and app.config.nb_execution_mode != "off" and hasattr(os, "fork"):
        kernel_server.start()


def add_demo(app, exception):
    """Add the page in the browser if PYODIDE names the folder of a Pyodide distribution."""
    distribution = os.getenv("PYODIDE")
    if exception is None and distribution:
        sys.path.insert(0, str(HERE / "demo"))
        importlib.import_module("build").build_page(Path(distribution), Path(app.outdir) / "demo")


def setup(app):
    """Connect the steps before pages are read and the look-up of names."""
    app.add_transform(AddSearchWords)
    app.connect("config-inited", write_pages)
    app.connect("env-before-read-docs", start_kernels)
    app.connect("env-updated", shorten_navigation)
    # Before the theme computes the navigation.
    app.connect("html-page-context", share_navigation, priority=400)
    app.connect("source-read", gallery_cards.write_cards)
    app.connect("build-finished", gallery_cards.save_thumbnails)
    app.connect("build-finished", add_demo)
    app.connect("autodoc-process-docstring", adapt_to_napoleon, priority=400)
    app.connect("autodoc-process-docstring", escape_markup)
    app.connect("doctree-read", link_code)
    app.connect("doctree-read", describe_pictures)
    app.connect("missing-reference", resolve_public_name)
