"""The pages of the documentation have what they have to."""

import re
from pathlib import Path

import beamdae as bd

PAGES = Path(__file__).parents[1] / ".docs" / "api"


def test_every_public_name_has_one_place_in_the_reference():
    text = "\n".join(page.read_text() for page in PAGES.glob("*.md"))
    named = re.findall(r"^   (\w+)$", text, flags=re.MULTILINE)
    assert sorted(named) == sorted(bd.__all__)
