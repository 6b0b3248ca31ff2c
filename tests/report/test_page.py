"""Data stored in pages."""

import json
import math
import re
from copy import deepcopy

import numpy as np
from numpy.testing import assert_allclose
from pages import (
    ODD_NAMES,
    ROUNDING,
    T,
    build_case,
    odd_page,
    read_page,
    study_page,
)

from beamdae.report.page.page_file import write_page


def test_pages_store_all_entries(tmp_path):
    page = study_page() | {"title": "{{script}} {{data}}"}
    before = deepcopy(page)
    path = write_page(tmp_path / "new" / "page.html", page)
    assert page["notes"] == before["notes"]
    data = read_page(path)
    for name in ("title", "subtitle", "made", "notes", "columns"):
        assert data[name] == page[name]
    ignored = dict.fromkeys(("curves", "series", "rank", "frames", "at", "file"))
    for actual, expected in zip(data["cases"], page["cases"], strict=True):
        assert actual | ignored == expected | ignored
    actual, expected = data["cases"][0]["curves"], page["cases"][0]["curves"]
    assert_allclose(actual["t"], T, rtol=ROUNDING)
    for name, values in expected["observed"].items():
        assert_allclose(actual["observed"][name], values, rtol=ROUNDING)
    frames = data["groups"][0]["frames"]
    assert [(b["name"], b["kind"], b["points"]) for b in frames["glyphs"]] == [
        ("ground", "ground", 1),
        ("bar", "beam", 3),
        ("bob", "point", 1),
    ]
    x = page["groups"][0]["frames"]["glyphs"][1]["x"]
    assert_allclose(frames["glyphs"][1]["x"], x, atol=2.0 * ROUNDING)


def test_missing_and_infinite_numbers_are_stored_as_missing(tmp_path):
    odd = np.array([1.0, math.nan, 1e300, math.inf, -math.inf, 3.0])
    page = study_page()
    page["cases"] = [
        build_case(
            0,
            "Ida",
            math.nan,
            math.inf,
            curves={"t": np.arange(6.0), "observed": {"x": odd}},
        )
        | {"values": {"steps": -math.inf}},
    ]
    (first,) = read_page(write_page(tmp_path / "page.html", page))["cases"]
    assert (first["error"], first["cost"], first["values"]["steps"]) == (None, None, None)
    stored = first["curves"]["observed"]["x"]
    assert_allclose(stored[np.isfinite(stored)], [1.0, 3.0])


def test_names_cannot_end_the_data_and_nothing_is_loaded(tmp_path):
    text = write_page(tmp_path / "page.html", study_page()).read_text()
    assert text.count("</script>") == 3
    assert "<b>" not in text
    assert f"<title>{study_page()['title']}</title>" not in text
    # The namespace of SVG is an identifier, not an address.
    addresses = set(re.findall(r"https?://[^\s\"'`]*", text))
    assert all(address.startswith("http://www.w3.org/") for address in addresses)
    own = text.replace(re.findall(r"<script>\s*(var echarts=.*?)</script>", text, re.DOTALL)[0], "")
    assert not re.search(r"\b(src|href)\s*=|@import|url\((?!#)", own)


def test_odd_names_are_stored_unchanged(tmp_path):
    text = write_page(tmp_path / "page.html", odd_page()).read_text(encoding="utf-8")
    assert text.count("</script>") == 3
    own = re.sub(r"<script>\s*var echarts=.*?</script>", "", text, flags=re.DOTALL)
    assert not set(map(chr, [*range(9), *range(14, 32), 0x2028])) & set(own)
    (json_text,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(json_text)
    assert data["title"] == "".join(ODD_NAMES)
    assert data["cases"][4]["values"]["u16"] == "u16"
