"""Plugins of another version of the contract: told what changed, or not loaded."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from omnilab import renamed
from omnilab.api import KINDS
from omnilab.api.contract import CHANGES, CONTRACT_VERSION
from omnilab.runner.registry import Registry, discover

ROOT = Path(__file__).parents[2]
MEAN = '''
from dataclasses import dataclass
from omnilab import Signatures, hookimpl

@dataclass
class Mean:
    """The mean grey level."""
    view, color, rotation, default_distance = "mirror", False, "invariant", "euclidean"
    def describe(self, images):
        return Signatures(images.mean(axis=(1, 2))[:, None])

@hookimpl
def register_descriptors(register):
    register("mean", Mean)
'''


@pytest.fixture
def found(tmp_path: Path):
    """Discovers a plugin with a line on the contract before it."""

    def found(line: str, source: str = MEAN) -> Registry:
        (tmp_path / "mean.py").write_text(f"{line}\n{source}")
        return discover(f"none,{tmp_path / 'mean.py'}")

    return found


@pytest.mark.parametrize("line", ["", f'CONTRACT = "{CONTRACT_VERSION}"'])
def test_of_todays_nothing_is_said(found, line: str) -> None:
    registry = found(line)
    assert ("descriptor", "mean") in registry.components
    assert registry.notes == registry.failures == []


def test_one_of_an_older_contract_is_told_what_concerns_it(found) -> None:
    registry = found('CONTRACT = "1.0"')
    assert ("descriptor", "mean") in registry.components
    (note,) = registry.notes
    assert "it was written for contract 1.0, since when arrays that a component is given are read-only" in note
    assert "; descriptor: `turned` is called `rotation`" in note
    assert note.endswith(f'; see to that, and write CONTRACT = "{CONTRACT_VERSION}"')
    assert "odometry" not in note


def test_its_words_of_then_are_said_once(found) -> None:
    (note,) = found('CONTRACT = "1.0"', MEAN.replace('rotation, default_distance = "mirror", False, "invariant"',
                                                     'turned, default_distance = "mirror", False, "same"')).notes  # fmt: skip
    assert note.count("turned") == 1


def test_why_one_of_an_older_contract_fails_is_said_with_it(found) -> None:
    (failure,) = found('CONTRACT = "1.0"', MEAN.replace("rotation, ", "").replace('"invariant", ', "")).failures
    assert "lacks rotation" in failure.sentence
    assert "`turned` is called `rotation`" in failure.sentence


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('CONTRACT = "2.2"', "written for contract 2.2, and omnilab .* pip install --upgrade omnilab"),
        ('CONTRACT = "11.0"', "written for contract 11.0"),
        ("CONTRACT = 2.0", 'CONTRACT = 2.0 is no version of the contract; write CONTRACT = "2.1"'),
        ('CONTRACT = "2"', "CONTRACT = '2' is no version"),
        ('CONTRACT = "2.0.1"', "CONTRACT = '2.0.1' is no version"),
    ],
)
def test_one_of_a_newer_contract_is_not_loaded(found, line: str, sentence: str) -> None:
    registry = found(line)
    (failure,) = registry.failures
    assert re.search(sentence, failure.sentence)
    assert not registry.components


def test_the_table_is_whole() -> None:
    words = " ".join(each.what for each in CHANGES)
    for old, new in {**renamed.MEMBERS, "said": "warnings", "learnt": "descriptor_state"}.items():
        assert f"`{old}`" in words
        assert f"`{new}`" in words
    assert {each.kind for each in CHANGES} <= {"", *KINDS}
    assert CHANGES[-1].version == CONTRACT_VERSION


def test_the_document_has_the_table() -> None:
    text = (ROOT / "docs/releases.md").read_text(encoding="utf-8")
    for each in CHANGES:
        assert f"| {each.version} | {each.kind or 'all'} | {each.what} |" in text
