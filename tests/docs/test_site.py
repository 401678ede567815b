"""The site: every page has its place, what is made is true, nothing is fetched, and a search from a folder finds."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from omnilab.runner.discovery import discover
from omnilab.runner.site import command
from omnilab.runner.site.components import path_of
from omnilab.runner.site.pages import made_pages, navigation
from omnilab.runner.site.plugin import documents_elsewhere, page_of, repository_path
from omnilab.runner.site.recipes import Recipe, measurements
from omnilab.runner.site.texts import manual, settings_table

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return made_pages(discover(), DOCS)


def entries(node: object) -> list[str]:
    """All pages of a navigation."""
    if isinstance(node, dict | list):
        return [page for inner in (node.values() if isinstance(node, dict) else node) for page in entries(inner)]
    return [str(node)]


def test_every_written_page_has_its_place():
    (text,) = re.findall(
        r"^nav:\n.*?(?=^\S)", (ROOT / "omnilab/runner/site/site.yml").read_text(), re.DOTALL | re.MULTILINE
    )
    named = entries(yaml.safe_load(text))
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    written |= {page for page in documents_elsewhere(DOCS) if "plugin_" not in page}
    assert written - set(named) == set(), "give them a place in the nav of omnilab/runner/site/site.yml"
    assert {page for page in named if page.endswith(".md")} <= written


def test_every_plugin_document_of_the_root_is_a_page():
    pages = documents_elsewhere(DOCS)
    paths = [
        *ROOT.glob("plugins/*/README.md"),
        *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING", "SECURITY")),
    ]
    assert len(pages) == len(paths) > 10
    for path in paths:
        page = page_of(path.relative_to(ROOT).as_posix())
        assert pages[page] == path.read_text(encoding="utf-8")
        assert repository_path(page) == path.relative_to(ROOT).as_posix()
    assert [entry for entry in navigation("project/", discover(), {}, pages) if "plugin_slam" in str(entry)] == [
        {"omnilab-slam": "project/plugin_slam.md"}
    ]


def test_every_component_and_recipe_has_a_page_in_the_navigation(made):
    registry = discover()
    listed = {
        page
        for entry in ("theory/", "studies/", "recipes/", "reference/")
        for page in entries(navigation(entry, registry, made, {}))
    }
    assert listed == set(made)
    for component in registry.components.values():
        page = made[path_of(component)]
        assert page.startswith(f"# {component.name}\n")
        assert manual(component.cls.__doc__).strip() in page
        assert f"omnilab plugins {component.name}\n" in page
    assert len([path for path in made if path.startswith("recipes/")]) > 60


def test_a_recipe_knows_its_components_and_what_was_measured():
    recipe = Recipe("mine", "# @package _global_\n# One thing.\n# Another.\ndefaults:\n  - override /sensor: mirror\n"
                            "  - /descriptor@descriptors.a: hog\n  - override /disturbance: [light, blur]\n")  # fmt: skip
    assert recipe.comment == "One thing.\nAnother."
    assert recipe.components == [
        ("sensor", "mirror"),
        ("descriptor", "hog"),
        ("disturbance", "light"),
        ("disturbance", "blur"),
    ]
    fidelity = (
        "| claim | a |\n| `x` (1): So. | 1 \\| 2 | – | **reached** | mine_room, other |\n| `y`: So. | 3 | – | – | others |\n"
        "| run | command |\n| mine_room | `omnilab experiment=mine a=1` | 0 |\n| others | `omnilab experiment=mines` | 0 |\n"
    )
    runs = {"mine_room": "omnilab experiment=mine a=1"}
    assert measurements("mine", fidelity) == (runs, [["`x` (1): So.", "1 | 2", "–", "**reached**", "mine_room, other"]])


def test_texts_survive_markdown():
    said = manual("Sum of a * b where x < 3, `c < d`::\n\n        code\n\n    end")
    assert said == "Sum of a \\* b where x \\< 3, `c < d`:\n\n    code\n\nend"
    found = settings_table([
        {"name": "a", "required": True, "type": "str", "default": None, "range": None, "unit": None, "comment": "x | y"},
        {"name": "b", "required": False, "type": "bool | None", "default": None, "range": None, "unit": None, "comment": ""},
    ])  # fmt: skip
    assert "| `a` | **to be given** | `str` | x \\| y |" in found
    assert "| `b` | `null` | `bool \\| None` |  |" in found


def test_docs_says_what_is_missing_and_touches_no_other_folder(omnilab_here, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").touch()
    done = omnilab_here("docs", "--build", "mine")
    assert (done.rc, done.stderr) == (
        2,
        "omnilab: mine is there and holds no site of omnilab docs; give an empty or a new folder\n",
    )
    assert (
        omnilab_here("docs", "--port", "70000").stderr == "omnilab: --port 70000 is no port; give one from 0 to 65535\n"
    )
    monkeypatch.setattr(command, "find_spec", lambda name: None if name == "material" else name)
    done = omnilab_here("docs", "--build", "new")
    assert done.rc == 2
    assert re.fullmatch(
        r"omnilab: the site needs material, not installed here; run: uv pip install .*'mkdocs-material.*'\n",
        done.stderr,
    )
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_site_is_whole_fetches_nothing_and_can_be_searched_from_a_folder(omnilab_here, tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / command.MARK).write_text("unfinished")  # one of ours, of which the building was interrupted
    done = omnilab_here("docs", "--build", "site")
    assert (done.rc, done.stdout) == (0, "site/index.html\n")
    for page in (tmp_path / "site").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=[\"']?(?:https?:)?//", text), page
    pytest.importorskip("playwright.sync_api")
    if not Path("/usr/bin/chromium").exists():
        pytest.skip("no browser to search with: /usr/bin/chromium")
    # in a process of its own: other tests' browser may hold this one's event loop
    words = [sys.executable, "-c", SEARCH, (tmp_path / "site/index.html").as_uri()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr


SEARCH = """
import sys
from playwright.sync_api import sync_playwright

with sync_playwright() as play:
    browser = play.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
    tab = browser.new_page()
    tab.goto(sys.argv[1])
    tab.locator("input.md-search__input").click()  # which waits for the page's scripts
    tab.keyboard.type("phase-only correlation", delay=20)
    tab.locator(".md-search-result__item").first.wait_for(timeout=180_000)  # the whole index is read first
    browser.close()
"""
