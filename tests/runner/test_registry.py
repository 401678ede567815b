"""Discovery: every way in which a plugin can be wrong is told in one line, and stops nothing else."""

from __future__ import annotations

import importlib
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from omnilab.errors import ConfigError
from omnilab.runner.cli import main
from omnilab.runner.plugins.config_nodes import store_components
from omnilab.runner.registry import HOOKS, Registry, discover

MEAN = '''
from dataclasses import dataclass
from typing import Literal
import numpy as np
from omnilab import Report, Signatures, hookimpl

@dataclass
class Mean:
    """The mean grey level."""

    gain: float = 1.0  # what it is multiplied with
    view, color, rotation, default_distance = "mirror", False, "invariant", "euclidean"

    def describe(self, images):
        return Signatures(self.gain * images.mean(axis=(1, 2), dtype=np.float32)[:, None])
'''
GOOD = MEAN + "@hookimpl\ndef register_descriptors(register): register('mean', Mean)\n"

BROKEN = {  # what a plugin's file adds to Mean: words of the sentence about it
    "raise RuntimeError('no licence')": ["RuntimeError: no licence"],
    "import not_installed_anywhere": ["ModuleNotFoundError", "'not_installed_anywhere'"],
    "def (": ["SyntaxError"],
    "import sys; sys.exit(3)": ["SystemExit: 3"],
    "def register_descriptors(register): register('mean', Mean)": ["registers nothing", "@hookimpl"],
    "@hookimpl\ndef register_descriptor(register): register('mean', Mean)": [
        "unknown hook 'register_descriptor'",
        *HOOKS.values(),
    ],
    "@hookimpl\ndef register_descriptors(reg): reg('mean', Mean)": ["register_descriptors(reg)", "'reg'"],
    "@hookimpl\ndef register_descriptors(register): raise ValueError('my\\nbug')": ["ValueError: my bug"],
    "@hookimpl\ndef register_descriptors(register):\n  register('mean', Mean)\n  register('mean', Mean)": [
        "descriptor 'mean' is registered twice",
        "Mean",
    ],
    "@hookimpl\ndef register_descriptors(register): register('mean', Mean())": ["Mean(gain=1.0)", "@dataclass"],
    "@hookimpl\ndef register_descriptors(register): register('mean', lambda: Mean())": ["<lambda>", "@dataclass"],
    "class Plain(Mean): extra: int = 1\n@hookimpl\ndef register_descriptors(register): register('plain', Plain)": [
        "descriptor 'plain'",
        "Plain",
        "@dataclass",
    ],
    "@hookimpl\ndef register_sinks(register): register('mean', Mean)": [
        "sink 'mean' (Mean) lacks open, write, flush, close, repair",
        "omnilab.api",
    ],
    "del Mean.rotation\n@hookimpl\ndef register_descriptors(register): register('mean', Mean)": [
        "descriptor 'mean' (Mean) lacks rotation (rotation is one of equivariant, invariant, none); see Descriptor"
    ],
    "@dataclass\nclass Bad(Mean):\n  mode: Literal['a'] = 'a'\n"
    "@hookimpl\ndef register_descriptors(register): register('bad', Bad)": ["Bad", "mode", "Literal"],
    "@dataclass\nclass Bad(Mean):\n  weights: np.ndarray | None = None\n"
    "@hookimpl\ndef register_descriptors(register): register('bad', Bad)": ["Bad", "weights", "ndarray"],
    "@hookimpl\ndef register_commands(register): register('look at', print)": ["command 'look at'", "lower case"],
    "@hookimpl\ndef register_commands(register): register('look', 3)": ["command 'look' is 3", "function"],
    "@hookimpl\ndef register_descriptors(register): register('My-Mean', Mean)": ["'My-Mean'", "lower case"],
    "@hookimpl\ndef register_descriptors(register): register('', Mean)": ["descriptor ''", "lower case"],
    "@hookimpl\ndef register_descriptors(register): register('mean/../x', Mean)": ["'mean/../x'", "lower case"],
}

Write = Callable[[str, str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """`write(name, text)`: a single-file plugin."""

    def write(name: str, text: str) -> Path:
        path = tmp_path / f"{name}.py"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """`install(distribution, text)`: an installed distribution with one plugin, as the metadata files tell it."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(site)

    def install(distribution: str, text: str) -> None:
        module = distribution.replace("-", "_")
        (site / f"{module}.py").write_text(text)
        monkeypatch.delitem(sys.modules, module, raising=False)
        info = site / f"{module}-2.5.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 2.5\n")
        (info / "entry_points.txt").write_text(f"[omnilab]\n{distribution.removeprefix('omnilab-')} = {module}\n")
        importlib.invalidate_caches()

    return install


def the_failure(registry: Registry) -> str:
    """The sentence about the one plugin that failed."""
    assert len(registry.failures) == 1
    sentence = registry.failures[0].sentence
    assert "\n" not in sentence
    return sentence


# ------------------------------------------------------------------------------------------------- what can be wrong
@pytest.mark.parametrize(("text", "words"), BROKEN.items(), ids=range(len(BROKEN)))
def test_a_broken_plugin_is_told_and_stops_no_other(write: Write, text: str, words: list[str]) -> None:
    broken, good = write("broken", f"{MEAN}\n{text}\n"), write("good", GOOD)
    registry = discover(f"none,{broken},{good}")
    sentence = the_failure(registry)
    assert sentence.startswith(f"plugin 'broken' ({broken}) not loaded: ")
    for word in words:
        assert word in sentence
    assert registry.names("descriptor") == ["mean"]
    assert registry.get("descriptor", "mean").plugin.name == "good"


def test_a_name_taken_by_another_plugin_names_both(write: Write) -> None:
    first, second = write("first", GOOD), write("second", GOOD)
    registry = discover(f"none,{first},{second}")
    assert the_failure(registry) == (
        f"plugin 'second' ({second}) not loaded: descriptor 'mean' is registered already by plugin 'first' ({first});"
        f" rename it, or leave one plugin out with OMNILAB_PLUGINS=none,{first}"
    )
    assert registry.get("descriptor", "mean").plugin.name == "first"


def test_one_bad_component_takes_its_whole_plugin_out(write: Write) -> None:
    path = write("half", GOOD + "@hookimpl\ndef register_sinks(register): register('mean', Mean)\n")
    registry = discover(f"none,{path}")
    assert the_failure(registry).endswith("see Sink in omnilab.api")
    assert not registry.components


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    sentence = the_failure(discover(f"none,{tmp_path}/mine.py"))
    assert f"there is no file {tmp_path}/mine.py; correct the path in OMNILAB_PLUGINS" in sentence


def test_a_broken_distribution_is_named_with_its_version(install: Callable[[str, str], None]) -> None:
    install("omnilab-lidar", "import a_driver_that_is_missing")
    registry = discover()
    assert the_failure(registry).startswith("plugin 'lidar' (omnilab-lidar 2.5) not loaded: ModuleNotFoundError: ")
    assert "a_driver_that_is_missing" in registry.failures[0].traceback
    assert registry.names("descriptor") == discover("-lidar").names("descriptor")


def test_ours_come_first_so_that_no_other_takes_their_names(install: Callable[[str, str], None]) -> None:
    install("aaa", MEAN + "@hookimpl\ndef register_descriptors(register): register('radon', Mean)\n")
    registry = discover()
    assert "'radon' is registered already by plugin 'appearance' (omnilab-appearance" in the_failure(registry)
    assert registry.get("descriptor", "radon").plugin.distribution == "omnilab-appearance"


# ------------------------------------------------------------------------------------------------------ OMNILAB_PLUGINS
def test_the_variable_adds_files_and_leaves_plugins_out(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMNILAB_PLUGINS", f" {write('mine', GOOD)} , -studies,")
    registry = discover()
    assert not registry.failures
    assert {"mean", "radon"} <= set(registry.names("descriptor"))
    assert registry.names("study") == []
    assert not discover("none").components


def test_an_installed_plugin_is_found_and_can_be_left_out(install: Callable[[str, str], None]) -> None:
    install("photometry", GOOD)
    component = discover().get("descriptor", "mean")
    assert component.plugin.title == "plugin 'photometry' (photometry 2.5)"
    assert component.summary == "The mean grey level."
    assert "mean" not in discover("-photometry").names("descriptor")


def test_a_components_class_is_what_hydra_builds(write: Write) -> None:
    store_components(discover(f"none,{write('mine', GOOD)}"))
    node = ConfigStore.instance().load("descriptor/mean.yaml").node
    built = OmegaConf.to_object(OmegaConf.merge(node, {"gain": 2}))
    assert type(built).__name__ == "Mean"
    assert built.gain == 2.0
    assert pickle.loads(pickle.dumps(built)) == built


# ------------------------------------------------------------------------------------------------------- suggestions
def test_a_misspelt_name_gets_a_list_and_a_suggestion(write: Write) -> None:
    registry = discover(f"none,{write('mine', GOOD)}")
    sentence = "descriptor 'maen' does not exist; there is mean (did you mean descriptor=mean?)"
    with pytest.raises(ConfigError, match=f"^{re.escape(sentence)}$"):
        registry.get("descriptor", "maen")
    with pytest.raises(ConfigError, match=r"sensor 'mean' does not exist; there is none$"):
        registry.get("sensor", "mean")


def test_a_missing_name_recalls_the_plugins_that_failed(write: Write) -> None:
    registry = discover(f"none,{write('mine', 'import nowhere_to_be_found')}")
    with pytest.raises(ConfigError, match=r"not loaded: mine \(omnilab plugins -v says why\)"):
        registry.get("descriptor", "mean")


# ------------------------------------------------------------------------------------------------- the command line
def test_failures_come_last_with_exit_code_1(write: Write) -> None:
    broken = write("broken", "import nowhere_to_be_found")
    script = "import sys; from omnilab.runner.cli import main; main(sys.argv[1:])"
    done = [
        subprocess.run(
            [sys.executable, "-c", script, "plugins", *option],
            env={"OMNILAB_PLUGINS": str(broken)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=60,
            check=False,
        )
        for option in ([], ["-v"])
    ]
    assert [one.returncode for one in done] == [1, 1]
    short, verbose = (one.stdout.splitlines() for one in done)
    assert short[-1].startswith(f"omnilab: plugin 'broken' ({broken}) not loaded: ModuleNotFoundError: ")
    assert verbose[: len(short)] == short
    assert verbose[len(short)] == "Traceback (most recent call last):"
    assert f'  File "{broken}", line 1, in <module>' in verbose


PING = """
@dataclass
class Ping:
    needs = ()

    def run(self, parts, record, rng):
        return Report([])

@hookimpl
def register_studies(register): register("ping", Ping)
"""


def test_a_run_goes_on_and_shows_the_failure(
    write: Write, omnilab_here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, ping = write("broken", "import nowhere_to_be_found"), write("ping", MEAN + PING)
    monkeypatch.setenv("OMNILAB_PLUGINS", f"{broken},{ping}")
    rc, _, err = omnilab_here("~experiment", "study=ping", "~sinks.rerun", "~sinks.mcap", "hydra.run.dir=logs/ping")
    sentence = f"plugin 'broken' ({broken}) not loaded: ModuleNotFoundError: No module named 'nowhere_to_be_found'"
    assert err.splitlines()[0] == f"omnilab: {sentence} (omnilab plugins -v shows the traceback)"
    assert rc == 0
    assert err.count(sentence) == 1
    assert sentence in Path("logs/ping/run.log").read_text()
    assert json.loads(Path("logs/ping/manifest.json").read_text())["plugins_failed"] == [sentence]


GRUMBLE = """
import logging

@dataclass
class Grumble:
    needs = ()

    def run(self, parts, record, rng):
        for level in logging.INFO, logging.WARNING, logging.WARNING:
            logging.getLogger("omnilab").log(level, "the %s light flickers", logging.getLevelName(level))
        return Report([])

@hookimpl
def register_studies(register): register("grumble", Grumble)
"""


def test_warnings_of_a_plugin_are_kept_in_the_log_and_told_to_the_user_once(
    write: Write, omnilab_here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMNILAB_PLUGINS", str(write("grumble", MEAN + GRUMBLE)))
    run = "~experiment", "study=grumble", "~sinks.rerun", "~sinks.mcap"
    for job in "ab":  # in one process, as the jobs of a sweep
        rc, _, err = omnilab_here(*run, f"hydra.run.dir=logs/{job}")
        assert (rc, err) == (0, "omnilab: the WARNING light flickers\n")
        assert Path(f"logs/{job}/run.log").read_text().count("light flickers") == 3


# ----------------------------------------------------------------------------------------------------------- commands
COMMAND = "from omnilab import hookimpl\n@hookimpl\ndef register_commands(register): register('look', lambda argv: len(argv))\n"


def test_a_plugin_adds_a_command(tmp_path, monkeypatch, capsys) -> None:
    (tmp_path / "looker.py").write_text(COMMAND)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(tmp_path / "looker.py"))
    with pytest.raises(SystemExit) as end:
        main(["look", "here", "there"])
    assert end.value.code == 2
    with pytest.raises(SystemExit):
        main(["lok"])
    assert "'lok' is no command" in (told := capsys.readouterr().err)
    assert "did you mean look?" in " ".join(told.split())


def test_two_plugins_with_one_command_are_told_apart(tmp_path) -> None:
    for name in ("one.py", "two.py"):
        (tmp_path / name).write_text(COMMAND)
    registry = discover(f"{tmp_path / 'one.py'},{tmp_path / 'two.py'}")
    assert "command 'look' is registered already" in registry.failures[0].sentence
    assert "look" in registry.commands


@pytest.mark.parametrize(
    ("points", "metadata", "expected"),
    [
        (b"[omnilab]\nmine = nothing.there\n", b"Name: mine\n", "plugin 'mine' (mine) not loaded: ModuleNotFoundError"),
        (b"[omnilab]\nmine = nothing.there\n", b"\n", "plugin 'mine' (?) not loaded: ModuleNotFoundError"),
        (b"[omnilab]\nmine = nothing.there\n", b"Name: \xff\n", "plugin 'mine' (?) not loaded: ModuleNotFoundError"),
        (
            b"[omnilab]\nmine = \xff\n",
            b"Name: mine\n",
            "plugin 'mine-1.dist-info' (mine) not loaded: what it says of itself",
        ),
        (b"[omnilab]\nmine\n", b"Name: mine\n", "plugin 'mine-1.dist-info' (mine) not loaded: what it says of itself"),
    ],
)
def test_a_distribution_with_damaged_metadata_hides_no_other(tmp_path, monkeypatch, points, metadata, expected):
    folder = tmp_path / "mine-1.dist-info"
    folder.mkdir()
    (folder / "entry_points.txt").write_bytes(points)
    (folder / "METADATA").write_bytes(metadata)
    monkeypatch.syspath_prepend(tmp_path)
    registry = discover("")
    (failure,) = registry.failures
    assert failure.sentence.startswith(expected)
    assert {"radon", "radon_hog"} & set(registry.names("descriptor"))
