"""The documents say what is true: shown files, listed components and commands, and code that runs."""

import re
from pathlib import Path

import pytest

from omnilab.api import KINDS
from omnilab.runner.cli import COMMANDS
from omnilab.runner.registry import discover

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


EXPERIMENTS = (ROOT / "docs/experiments.md").read_text(encoding="utf-8")
COMPONENTS = (ROOT / "docs/components.md").read_text(encoding="utf-8")


def _blocks(language, text=README):
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_add_your_own_is_what_the_tests_install():
    assert (ROOT / "tests/third_party/omnilab_tiny.py").read_text(encoding="utf-8") in _blocks("python")


def test_what_a_newcomer_needs_is_on_the_first_pages():
    end = README.index("omnilab new descriptor mine")
    assert README[:end].count("\n") < 80
    assert README.count("\n") < 100  # two screens
    assert (ROOT / re.search(r"!\[.*?\]\((.*?)\)", README, flags=re.DOTALL)[1]).is_file()


def test_the_table_of_components_is_complete():
    registry = discover("")
    for kind in KINDS:
        row = re.search(rf"^\| {kind} \|(.*)\|$", COMPONENTS, flags=re.MULTILINE)
        assert row, f"docs/components.md has no row for {kind}"
        assert set(registry.names(kind)) <= set(re.findall(r"`(\w+)`", row[1]))


def test_every_command_and_recipe_is_shown():
    for command in COMMANDS:
        assert f"omnilab {command}" in EXPERIMENTS
    for recipe in (ROOT / "conf/experiment").glob("*.yaml"):
        assert f"experiment={recipe.stem}" in EXPERIMENTS or recipe.stem == "quickstart"


@pytest.mark.slow
def test_the_library_example_runs(tmp_path, monkeypatch, capsys, request):
    request.getfixturevalue("omnilab_here")("study.step_m=2", "study.query_count=4", "study.show=1", "sensor.size=64")
    page = (ROOT / "docs/quickstart.md").read_text(encoding="utf-8")
    (example,) = _blocks("python", page)
    exec(compile(example, "quickstart.md", "exec"), {})
    assert "nearest_rate" in capsys.readouterr().out


def test_every_virtual_camera_and_world_has_its_picture():
    from omnilab_mirror.scene.shipped import shipped
    from omnilab_mirror.sensors.virtual import VirtualCamera

    registry = discover("")
    sensors = [n for n in registry.names("sensor") if issubclass(registry.get("sensor", n).cls, VirtualCamera)]
    assert len(sensors) > 5
    for kind, names, document in (("camera", sensors, "cameras.md"), ("world", shipped(), "worlds.md")):
        text = (ROOT / "docs" / document).read_text(encoding="utf-8")
        for name in names:
            assert f"(pictures/{kind}_{name}.jpg)" in text
            assert f"`{name}`" in text
            assert (ROOT / f"docs/pictures/{kind}_{name}.jpg").is_file()


def test_contributing_names_files_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"`((?:omnilab|plugins|conf|tests)/[\w/.]+)`", text):
        assert (ROOT / path.replace("NAME", "quickstart")).exists(), path


def test_every_step_of_a_journey_is_a_function_of_its_file():
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    steps = re.findall(r"`((?:omnilab|plugins)/[\w/]+\.py)(?::(\w+))?`((?:(?:,| and) `\w+`)*)", text)
    assert len(steps) > 35
    for path, name, more in steps:
        source = (ROOT / path).read_text(encoding="utf-8")
        for function in filter(None, [name, *re.findall(r"`(\w+)`", more)]):
            assert re.search(rf"^\s*def {function}\(", source, re.MULTILINE), f"{path} has no {function}"
    for folder in re.findall(r"`(plugins/[\w/]+/)`", text):
        assert (ROOT / folder).is_dir()


def test_every_promise_is_held_by_a_test_that_exists():
    promises = 0
    for document in ("docs/reliability.md", "SECURITY.md"):
        for path, name in re.findall(
            r"`((?:tests|plugins)/[\w/]+\.py)(?::(\w+))?`", (ROOT / document).read_text("utf-8")
        ):
            source = (ROOT / path).read_text(encoding="utf-8")
            assert not name or re.search(rf"^def {name}\(", source, re.MULTILINE), f"{document}: {path} has no {name}"
            promises += 1
    assert promises > 40
