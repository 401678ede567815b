"""Components of every kind, made of the templates, in both forms."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from omnilab.api import KINDS
from omnilab.runner.authoring.rendering import NewComponent, distribution, single_file


@pytest.fixture(scope="session")
def name_of() -> Callable[[str], str]:
    """`name_of(kind)`: a name that no component has, of one word, or longer than any other."""
    return lambda kind: f"unheard_of_{kind}" if kind in {"distance", "study"} else f"x{kind}"[:7].strip("_")


def _write(texts: Mapping[str, str], folder: Path) -> None:
    for path, text in texts.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")


@pytest.fixture(scope="session")
def single_files(tmp_path_factory: pytest.TempPathFactory, name_of: Callable[[str], str]) -> Path:
    """A folder with a plugin of each kind that is a single file, and its tests."""
    folder = tmp_path_factory.mktemp("files")
    for kind in KINDS:
        _write(single_file(NewComponent(kind, name_of(kind))), folder)
    return folder


@pytest.fixture(scope="session")
def distributions(tmp_path_factory: pytest.TempPathFactory, name_of: Callable[[str], str]) -> Path:
    """A folder with the folders of a distribution of each kind."""
    folder = tmp_path_factory.mktemp("distributions")
    for kind in KINDS:
        component = NewComponent(kind, name_of(kind))
        _write(distribution(component, "Ada Lovelace"), folder / component.distribution)
    return folder


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """`importable(folder)`: modules in the folder can be imported for as long as the test lasts."""

    def importable(folder: Path) -> None:
        monkeypatch.syspath_prepend(folder)
        for name in [path.stem for path in folder.iterdir()]:
            monkeypatch.delitem(sys.modules, name, raising=False)

    return importable
