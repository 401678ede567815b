"""A start makes no configuration nodes: what is taken for plain is plain for OmegaConf, and of ours all is."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, make_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import pytest
from omegaconf import OmegaConf

from omnilab.api import setting
from omnilab.runner.plugins.plain_settings import are_plain
from omnilab.runner.registry import discover

Colour = Enum("Colour", ["red", "green"])


@dataclass
class Inner:
    """Settings of a setting."""

    count: int = 3
    names: list[str] = field(default_factory=lambda: ["a"])


@dataclass
class Wrong:
    """A setting of a setting of no type that one can have."""

    action: Callable[[], None] = print


class Listing(dict[str, int]):
    """OmegaConf warns of such."""


PLAIN = [
    (int, setting(3, at_least=1)), (float, 3), (str, "???"), (bool, False), (int, field()), (int | None, None), (str | None, "a"),
    (list[float], setting([1.0, 2])), (list[list[int]], setting([[1], []])), (dict[str, int], setting({"a": 1})),
    (Any, setting([1, [None, "a"]])), (Colour, Colour.red), (Inner, field(default_factory=Inner)), (list[Inner], setting([])),
    (dict[str, Inner | None], field(default_factory=lambda: {"a": Inner(), "b": None})),
]  # fmt: skip
OTHERS = [  # of which OmegaConf takes some
    (int, None), (int, "a"), (int, 1.5), (bool, 1), (str, "${seed}"), (str, "${"), (list[int], setting(["a"])), (list[str], setting(["${"])),
    (dict[str, int], setting({1: 1})), (dict[str, int], None), (Literal["a"], "a"), (Callable[[], None], print), (Any, print),
    (Wrong, field(default_factory=Wrong)), (Inner, field(default_factory=lambda: Inner(names=[print]))), (int | list[int], 3),
    (list[Callable[[], None]], setting([])), (Path, Path("a")), (Colour, "red"), (Listing, field(default_factory=Listing)),
]  # fmt: skip


@pytest.mark.parametrize(("hint", "default"), PLAIN)
def test_what_is_taken_for_plain_is_so_for_omegaconf(hint: Any, default: Any) -> None:
    cls = make_dataclass("Mine", [("mine", hint, default)])
    assert are_plain(cls)
    assert list(OmegaConf.structured(cls)) == ["mine"]


@pytest.mark.parametrize(("hint", "default"), OTHERS)
def test_all_else_is_left_to_omegaconf(hint: Any, default: Any) -> None:
    assert not are_plain(make_dataclass("Mine", [("mine", hint, default)]))


def test_every_component_of_ours_is_plain() -> None:
    components = discover("").components.values()
    assert [c.title for c in components if not are_plain(c.cls)] == []
    for component in components:
        OmegaConf.structured(component.cls)


def test_a_listing_imports_neither_hydra_nor_what_only_runs_need() -> None:
    script = "import sys; from omnilab.runner.discovery import discover; discover(); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert "omnilab_studies.localization.grid.study" in loaded
    assert not {"hydra", "omegaconf", "yaml", "cv2", "scipy", "numba", "rerun", "http"} & set(loaded)
