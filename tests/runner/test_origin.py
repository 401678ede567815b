"""Which commit a run says it was made with."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import omnilab.runner.run_folder  # noqa: F401  which imports the module, and has a function of its name

ORIGIN = sys.modules["omnilab.runner.run_folder.origin"]


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A source tree with one file, which omnilab is taken to run from."""
    monkeypatch.setattr(ORIGIN, "__file__", str(tmp_path / "omnilab" / "runner" / "run_folder" / "origin.py"))
    (tmp_path / "a.py").write_text("a = 1\n")
    return tmp_path


def git(source: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    return subprocess.run(
        ["git", "-C", source, *who, *words], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_a_commit_is_named_with_what_was_edited_since(source: Path) -> None:
    git(source, "init", "-q")
    assert ORIGIN.commit() is None  # there is none yet
    git(source, "add", "a.py")
    git(source, "commit", "-qm", "a")
    head = git(source, "rev-parse", "HEAD")
    (source / "logs").write_text("untracked\n")
    assert ORIGIN.commit() == head
    git(source, "checkout", "-q", "--detach")
    assert ORIGIN.commit() == head
    (source / "a.py").write_text("a = 2\n")
    assert ORIGIN.commit() == f"{head}+changes"
    git(source, "commit", "-qam", "b")
    assert ORIGIN.commit() == git(source, "rev-parse", "HEAD") != head


def test_no_commit_is_named_of_what_is_no_clone(source: Path) -> None:
    assert ORIGIN.commit() is None
    (source / ".git").write_text("gitdir: nowhere\n")
    assert ORIGIN.commit() is None
