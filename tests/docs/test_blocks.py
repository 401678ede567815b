"""Every fenced block of every page is typed, composed or parsed; what is not says why in one table."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml
from doc_blocks import PAGES, ROOT, Block, Newcomer, all_blocks, blocks_of, commands

from omnilab.api import KINDS
from omnilab.runner.cli import COMMANDS, main
from omnilab.runner.discovery import discover
from omnilab.runner.overrides.command_line import parse_override
from omnilab.runner.overrides.composition import compose

BLOCKS = all_blocks()
TYPED = [
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
    ROOT / "docs/quickstart.md",
    ROOT / "docs/writing_recipes.md",
    ROOT / "docs/plugins.md",
]  # for real
ELSEWHERE = {  # pages whose blocks another test types
    "docs/comparing.md": "tests/compare/test_comparing_docs.py",
    "README.md": "tests/runner/test_third_party.py",
}
NO_COMMANDS = {  # blocks in which no line is a command of ours: the begin of the first line, and why they are only read
    "omnilab/": "a tree of folders, whose paths tests/project/test_docs.py looks up",
    "job  settings": "what a terminal shows while a sweep runs",
    "omnilab: job 2": "what is printed where that is no terminal",
    "logs/quickstart/": "what the first run prints",
    "logs/latest": "what a run prints",
    ".ci/wheels": "wheels, which tests/project/test_ways_in.py makes",
    "pip install --find-links": "wheels, which tests/project/test_package.py installs",
    "uv tool install": "tools, of which tests/project/test_package.py tries one",
    "docker build": "a container, whose recipe tests/project/test_ways_in.py reads",
    "docker run": "the same",
    "eval": "completion, which tests/overrides/test_completion.py has bash do",
    "pip install uv": "a clone's set-up: the suite itself runs in one",
    "pytest tests/benchmarks": "benchmarks, which take minutes",
    "python plugins": "a script of the repository's",
}
PLACEHOLDERS = {"resume", "retry_failed", "shards"}  # settings of a sweep, which the command takes before Hydra


def runs() -> list[tuple[Block, list[str]]]:
    """Commands that run an experiment, on pages that nobody types."""
    typed = {path.relative_to(ROOT).as_posix() for path in TYPED} | ELSEWHERE.keys()
    known = {*COMMANDS, *discover().commands}
    found = [(block, words) for block in BLOCKS if block.page not in typed for words in commands(block)]
    return [(block, words) for block, words in found if not words or words[0] not in known]


def test_every_block_is_of_a_kind_that_is_tested():
    for block in BLOCKS:
        if block.language in {"", "sh"} and not list(commands(block)):
            first = block.lines[0].lstrip()
            tutorial = block.page.startswith("docs/tutorials/") and block.language == "sh"
            assert tutorial or any(first.startswith(begin) for begin in NO_COMMANDS), f"{block.place}: {first}"
        else:
            assert block.language in {"", "sh", "text", "console", "python", "yaml", "toml"}, block.place


def test_every_command_and_option_exists(capsys):
    plugins, helped = discover().commands, dict[str, str]()
    for block in BLOCKS:
        for words in commands(block):
            if not words or words[0] not in {*COMMANDS, *plugins}:
                continue
            name = " ".join(words[:2]) if words[0] in {"sweep", "fidelity", "world", "dataset"} else words[0]
            if name not in helped:
                with pytest.raises(SystemExit):
                    main([*name.split(), "--help"])
                helped[name] = capsys.readouterr().out
            for option in (word.partition("=")[0] for word in words[1:] if word.startswith("--")):
                assert option in helped[name], f"{block.place}: {name} has no {option}"


def test_every_override_can_be_read_and_names_what_there_is():
    registry, recipes = discover(), {path.stem for path in ROOT.glob("conf/experiment/*.yaml")}
    for block, words in runs():
        for word in (word for word in words if not word.startswith("-")):
            override = parse_override(word)
            assert override is not None, f"{block.place}: {word}"
            values = word.partition("=")[2].strip("[]").split(",")
            if override.key_or_group == "experiment":
                assert recipes.issuperset(values), f"{block.place}: {word}"
            elif override.key_or_group.partition("@")[0] in KINDS and values != [""]:
                assert all(registry.find(override.key_or_group.partition("@")[0], value) for value in values), (
                    block.place
                )


def test_code_is_python_that_imports_what_there_is():
    for block in BLOCKS:
        if block.language == "python":
            for node in ast.walk(ast.parse(block.text, block.place)):
                if isinstance(node, ast.ImportFrom) and str(node.module).startswith("omnilab"):
                    module = import_module(str(node.module)) if "tiny" not in str(node.module) else None
                    for name in node.names if module else ():
                        assert hasattr(module, name.name), f"{block.place}: {node.module} has no {name.name}"
        elif block.language == "yaml":
            assert yaml.safe_load(block.text), block.place
        elif block.language == "toml":
            assert tomllib.loads(block.text), block.place


@pytest.mark.slow
def test_every_run_composes():
    registry = discover()
    for words in {tuple(words) for _, words in runs()}:
        compose([word for word in words if word.partition("=")[0] not in PLACEHOLDERS], registry)


@pytest.mark.slow
@pytest.mark.timeout(900)  # whole runs as large as the page has them
@pytest.mark.parametrize("page", TYPED, ids=lambda path: path.stem)
def test_a_page_does_what_it_says(page: Path, tmp_path, omnilab_here, monkeypatch):
    newcomer = Newcomer(tmp_path, omnilab_here, monkeypatch.setenv)
    for block in blocks_of(page):
        newcomer.type(block)


@pytest.mark.slow
def test_every_answer_is_what_is_said(tmp_path, omnilab_here, monkeypatch):
    from PIL import Image

    def folder(name: str, table: str = "", sizes: Sequence[int] = (64, 64, 64, 64)) -> None:
        (tmp_path / name).mkdir()
        for i, height in enumerate(sizes):
            Image.effect_noise((64, height), 60).save(tmp_path / name / f"{i}.png")
        if table:
            (tmp_path / name / "positions.csv").write_text(table)

    folder("empty", sizes=())
    folder("plain")
    folder("sizes", "image,x_m,y_m\n0.png,0,0\n1.png,1,0\n2.png,0,1\n", (64, 72, 80))
    folder("renamed", "image,x_m,y_m\n0.png,0,0\n1.png,1,0\n7.png,0,1\n", (64, 64, 64))
    folder("semicolons", "image;x_m;y_m\n0.png;0;0\n1.png;1;0\n2.png;0;1\n", (64, 64, 64))
    newcomer = Newcomer(tmp_path, omnilab_here, monkeypatch.setenv)
    blocks = blocks_of(ROOT / "docs/faq.md")
    assert len(blocks) >= 20
    for block in blocks:
        if not ("=ray" in block.text and find_spec("ray")):  # which says what is missing where ray is
            newcomer.type(block)


def test_pages_are_found():
    assert len(PAGES) > 30
    assert all((ROOT / where).exists() for where in ELSEWHERE.values())
