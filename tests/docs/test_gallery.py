"""The gallery of studies: all of them are in it, with pictures that are there, of a size for the web."""

import re
import sys
from pathlib import Path

import cv2
import pytest

from omnilab.runner.registry import discover

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "gallery.md").read_text()
LINKED = re.findall(r"\]\((gallery/[^)]+\.jpg)\)", PAGE)


def test_every_study_is_in_the_gallery_with_its_command():
    shown = re.findall(r"^## (\w+)\n\n.*\n\n`omnilab experiment=", PAGE, re.MULTILINE)
    assert sorted(shown) == sorted(discover("").names("study"))


def test_all_pictures_are_linked():
    assert sorted(LINKED) == sorted(f"gallery/{file.name}" for file in (DOCS / "gallery").iterdir())


@pytest.mark.parametrize("name", LINKED)
def test_a_picture_is_small_and_not_blank(name):
    file = DOCS / name
    assert file.stat().st_size <= 120_000
    image = cv2.imread(str(file), cv2.IMREAD_REDUCED_GRAYSCALE_4)
    assert image.shape[1] <= 300  # a quarter of 1200 pixels
    assert image.std() > 5


def test_the_commands_are_those_that_draw_it(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    import study_pictures

    commands = {command for family in study_pictures.SHOWN.values() for command in family.values()}
    assert commands == set(re.findall(r"`omnilab (experiment=[^`]+)`", PAGE))
    sys.modules.pop("study_pictures")
