"""What `omnilab plugins` keeps for the next time: never what would be listed otherwise now."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from omnilab.runner import plugin_files
from omnilab.runner.plugins import command, listing

SCRIPT = Path(sys.executable).with_name("omnilab")
PLUGIN = '''
from dataclasses import dataclass
from pathlib import Path

from omnilab import hookimpl

@dataclass
class Quiet:
    """Writes nothing."""

    def open(self, folder): ...
    def write(self, path, record, tick): ...
    def flush(self): ...
    def close(self): ...
    def repair(self, folder): ...

@hookimpl
def register_sinks(register):
    register("quiet", Quiet)

@hookimpl
def register_folders(register):
    register("shipped")
'''
NUMPY = r"\| +numpy\n"  # imported, as `-X importtime` says
NAMES = map("omnilab_kept_{}".format, count())  # a module of its own for each test: a process imports each once


def install(site: Path, module: str, distribution: str, code: str = PLUGIN) -> None:
    """A distribution of one module, as pip would leave it."""
    about = site / f"{distribution.replace('-', '_')}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[omnilab]\n{distribution.removeprefix('omnilab-')} = {module}\n")
    (site / f"{module}.py").write_text(code)


class Here:
    """An installation with one plugin, which is of omnilab[all], and a cache of its own."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self.site, self.cache, self.module = tmp_path / "site", tmp_path / "cache", next(NAMES)
        self._capsys, self.discovered = capsys, 0
        (self.site / "shipped" / "experiment").mkdir(parents=True)
        (self.site / "shipped" / "experiment" / "mine.yaml").write_text("# Of mine.\n")
        core = self.site / "omnilab-0.1.0.dist-info"
        core.mkdir()
        (core / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: omnilab\nVersion: 0.1.0\nRequires-Dist: omnilab-mini\n"
        )
        install(self.site, self.module, "omnilab-mini")
        monkeypatch.syspath_prepend(self.site)
        monkeypatch.setenv("XDG_CACHE_HOME", str(self.cache))
        monkeypatch.setenv(plugin_files.VARIABLE, "none,mini")
        monkeypatch.setattr(listing, "RACE_S", -1e6)  # but for one test: nothing here is older than the test
        monkeypatch.setattr(command, "discover", self._discover)
        sources = listing._sources  # of which those of the test process are others' to change
        monkeypatch.setattr(listing, "_sources", lambda folders: [p for p in sources(folders) if self._is_mine(p)])

    def _is_mine(self, path: str | Path) -> bool:
        return Path(path).is_relative_to(self.site)

    def _discover(self) -> object:
        from omnilab.runner.registry import discover

        self.discovered += 1
        return discover()

    def listed(self) -> tuple[int, str, str]:
        """Exit code, standard output and standard error of `omnilab plugins`."""
        code = command.plugins([])
        return (code, *self._capsys.readouterr())

    def files(self) -> list[Path]:
        return [path for path in self.cache.rglob("*") if path.is_file()]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return Here(tmp_path, monkeypatch, capsys)


def test_a_listing_is_printed_again_without_looking_for_plugins(here: Here) -> None:
    first = here.listed()
    assert first[0] == 0
    assert "Writes nothing." in first[1]
    assert "Of mine." in first[1]
    assert [here.listed(), here.listed()] == [first, first]
    assert here.discovered == 1
    assert len(here.files()) == 1


@pytest.mark.parametrize("words", [["-v"], ["--json"], ["quiet"]])
def test_all_else_loads_plugins(here: Here, words: list[str]) -> None:
    here.listed()
    command.plugins(words)
    assert here.discovered == 2


def edit(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


def touch_up(path: Path) -> None:
    """Other content of the same size and time."""
    times = path.stat()
    edit(path, "Quiet", "Quite")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


CHANGES: dict[str, Callable[[Here], object]] = {
    "a file": lambda here: edit(here.site / f"{here.module}.py", "Writes nothing.", "Writes nothing at all."),
    "a file, to the same size and time": lambda here: touch_up(here.site / f"{here.module}.py"),
    "a recipe": lambda here: edit(here.site / "shipped" / "experiment" / "mine.yaml", "mine", "yours"),
    "one recipe more": lambda here: (here.site / "shipped" / "experiment" / "b.yaml").write_text("# Of b.\n"),
    "a version": lambda here: edit(here.site / "omnilab_mini-1.0.dist-info" / "METADATA", "1.0", "1.1"),
    "an entry point": lambda here: edit(here.site / "omnilab_mini-1.0.dist-info" / "entry_points.txt", "mini", "tiny"),
    "one distribution more": lambda here: install(here.site, f"{here.module}_b", "omnilab-b"),
    "a module that hides another": lambda here: (here.site / "numpy.py").write_text(""),
    "a dependency that is gone": lambda here: (here.site / f"{here.module}.py").unlink(),
}


@pytest.mark.parametrize("change", CHANGES)
def test_it_is_made_anew_when_something_has_changed(here: Here, change: str) -> None:
    here.listed()
    CHANGES[change](here)
    assert listing.kept() is None


@pytest.mark.parametrize("attribute", ["warnoptions", "version", "path"])
def test_it_is_made_anew_for_another_python(here: Here, monkeypatch: pytest.MonkeyPatch, attribute: str) -> None:
    here.listed()
    value = getattr(sys, attribute)
    monkeypatch.setattr(sys, attribute, value + ("x" if isinstance(value, str) else ["x"]))
    assert listing.kept() is None


def test_it_is_made_anew_for_other_plugins_of_the_environment(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    here.listed()
    monkeypatch.setenv(plugin_files.VARIABLE, "none")
    assert "quiet" not in here.listed()[1]
    assert here.discovered == 2


def test_what_is_younger_than_the_start_is_not_kept(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "RACE_S", 2.0)
    here.listed()
    assert here.files() == []


def test_a_broken_plugin_is_named_every_time(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    install(here.site, f"{here.module}_b", "omnilab-b", "import not_there\n")
    edit(
        here.site / "omnilab-0.1.0.dist-info" / "METADATA", "omnilab-mini\n", "omnilab-mini\nRequires-Dist: omnilab-b\n"
    )
    monkeypatch.setenv(plugin_files.VARIABLE, "none,mini,b")
    for _ in range(3):
        code, listed, said = here.listed()
        assert code == 1
        assert "quiet" in listed
        assert "plugin 'b' (omnilab-b 1.0) not loaded: ModuleNotFoundError" in said
    assert here.files() == []


def test_nothing_is_kept_where_a_plugin_is_not_of_ours(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = PLUGIN.replace('"quiet"', '"silent"').replace("shipped", "theirs")
    (here.site / "theirs" / "experiment").mkdir(parents=True)
    (here.site / "theirs" / "experiment" / "theirs.yaml").write_text("# Of theirs.\n")
    install(here.site, f"{here.module}_b", "theirs", theirs)
    monkeypatch.setenv(plugin_files.VARIABLE, "none,mini,theirs")
    for _ in range(2):
        code, listed, _ = here.listed()
        assert code == 0
        assert "silent" in listed
    assert here.files() == []
    assert here.discovered == 2


def test_nothing_is_kept_where_a_file_is_a_plugin(here: Here, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(PLUGIN.partition("@hookimpl\ndef register_folders")[0])
    monkeypatch.setenv(plugin_files.VARIABLE, f"none,{tmp_path / 'mine.py'}")
    assert here.listed()[0] == 0
    assert here.files() == []


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b"[" * 100_000, b"\xff\xfe"])
def test_a_damaged_file_is_made_anew(here: Here, content: bytes) -> None:
    first = here.listed()
    (file,) = here.files()
    file.write_bytes(content)
    assert here.listed() == first
    assert here.discovered == 2
    assert here.listed() == first
    assert here.discovered == 2


def test_a_listing_that_holds_no_rows_is_made_anew(here: Here) -> None:
    first = here.listed()
    (file,) = here.files()
    for damage in ('"listing": [["sink", [["a", "b"]]]', '"listing": [["sink", 3]', '"listing": [3]'):
        file.write_text(file.read_text().partition('"listing"')[0] + damage + "}")
        assert listing.kept() is None
    assert here.listed() == first


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(here: Here) -> None:
    here.cache.write_text("a file, and no folder")
    first = here.listed()
    assert first[0] == 0
    assert here.listed() == first
    assert here.discovered == 2


def test_without_a_home_nothing_is_kept(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", lost)
    assert here.listed()[::2] == (0, "")


def test_processes_that_list_at_once_write_one_whole_file_which_the_next_prints_without_numpy(tmp_path: Path) -> None:
    env = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), plugin_files.VARIABLE: "none"}
    command = [sys.executable, "-X", "importtime", SCRIPT, "plugins"]
    for _ in range(10):  # until no file of ours is younger than two seconds, as those of a new clone are
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        both = [each.communicate() for each in [subprocess.Popen(command, env=env, **pipes) for _ in range(2)]]
        assert both[0][0] == both[1][0]
        assert "quickstart" in both[0][0]
        if (tmp_path / "cache").is_dir():
            break
        time.sleep(1.0)
    (file,) = (tmp_path / "cache" / "omnilab").iterdir()
    assert file.suffix == ".json"
    assert any(re.search(NUMPY, said) for _, said in both)
    again = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    assert again.stdout == both[0][0]
    assert not re.search(NUMPY, again.stderr)
    assert "rich.console" in again.stderr
