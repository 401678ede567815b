"""Discovery: every way in which a plugin can be wrong is told in one line, and stops nothing else."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import pytest
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from omnilab import hooks
from omnilab.cli import main
from omnilab.errors import ConfigError
from omnilab.registry import COMMANDS_HOOK, HOOKS, KINDS, Registry, discover, members

MEAN = '''
from dataclasses import dataclass
from typing import Literal
import numpy as np
from omnilab import Report, Signatures, hookimpl

@dataclass
class Mean:
    """The mean grey level."""

    gain: float = 1.0  # what it is multiplied with
    view, color, turned, default_distance = "mirror", False, "same", "euclidean"

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
    "del Mean.turned\n@hookimpl\ndef register_descriptors(register): register('mean', Mean)": [
        "descriptor 'mean' (Mean) lacks turned; see Descriptor in omnilab.api"
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
        " rename it, or leave one plugin out with OMNILAB_PLUGINS=-second"
    )
    assert registry.get("descriptor", "mean").plugin.name == "first"


def test_one_bad_component_takes_its_whole_plugin_out(write: Write) -> None:
    path = write("half", GOOD + "@hookimpl\ndef register_sinks(register): register('mean', Mean)\n")
    registry = discover(f"none,{path}")
    assert the_failure(registry).endswith("see Sink in omnilab.api")
    assert not registry.components
    assert "descriptor" not in ConfigStore.instance().repo


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
    discover(f"none,{write('mine', GOOD)}")
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
    with pytest.raises(ConfigError, match=r"1 plugin\(s\) failed to load, see: omnilab plugins -v"):
        registry.get("descriptor", "mean")


# ------------------------------------------------------------------------------------------------- the command line
def test_the_list_names_every_component_and_its_origin(omnilab_here: Callable[..., Any]) -> None:
    rc, out, err = omnilab_here("plugins")
    assert (rc, err) == (0, "")
    for (kind, name), component in discover().components.items():
        cls, plugin = component.cls, component.plugin
        line = f"  {name}  {cls.__module__}.{cls.__qualname__}, {plugin.distribution} {plugin.version}\n"
        assert line in f"\n{out}".partition(f"\n{kind}\n")[2]
        assert " ".join(component.summary.split()) in " ".join(out.split())


def test_help_names_commands_components_and_experiments(omnilab_here: Callable[..., Any]) -> None:
    rc, out, err = omnilab_here("--help")
    assert (rc, err) == (0, "")
    assert "omnilab plugins | runs | view | repeat | repair | check | world " in out
    for kind in KINDS:
        assert re.search(rf"^{kind}: {', '.join(discover().names(kind))}$", out, re.MULTILINE)
    recipes = sorted(path.stem for path in (Path(__file__).parents[1] / "conf/experiment").glob("*.yaml"))
    assert f"experiment: {', '.join(recipes)}\n" in out


def test_failures_come_last_with_exit_code_1(write: Write) -> None:
    broken = write("broken", "import nowhere_to_be_found")
    script = "import sys; from omnilab.cli import main; main(sys.argv[1:])"
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


HEAVY = {"cv2", "gtsam", "matplotlib", "mcap", "numba", "pandas", "pyarrow", "rerun", "scipy", "skimage"}


def test_listing_plugins_imports_nothing_heavy() -> None:
    script = f"""
import sys
from omnilab.cli import main
try:
    main(["plugins"])
except SystemExit as end:
    assert end.code == 0
print("HEAVY", *sorted({HEAVY} & set(sys.modules)))
"""
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True).stdout
    assert out.splitlines()[-1].strip() == "HEAVY"


# ------------------------------------------------------------------------------------------ what there is, documented
def test_every_hook_has_a_kind_a_docstring_and_a_protocol() -> None:
    specs = {name: spec for name, spec in vars(hooks).items() if name.startswith("register_")}
    assert set(specs) == {*HOOKS.values(), COMMANDS_HOOK}
    assert set(HOOKS) == set(KINDS)
    for name, spec in specs.items():
        assert spec.__doc__, name
        assert list(inspect.signature(spec).parameters) == ["register"], name
    for kind, protocol in KINDS.items():
        assert protocol.__doc__, kind
        for member in members(protocol):
            if callable(method := getattr(protocol, member, None)):
                assert method.__doc__, f"{kind}: {member}"


def test_every_component_is_documented() -> None:
    registry = discover()
    assert not registry.failures
    undocumented = []
    for component in registry.components.values():
        cls = component.cls
        if not cls.__doc__ or cls.__doc__.startswith(f"{cls.__name__}("):
            undocumented.append(cls.__name__)
        undocumented += [f"{cls.__name__}.{f.name}" for f in fields(cls) if not documented(cls, f.name)]
    assert undocumented == []


def documented(cls: type[Any], field: str) -> bool:
    """Whether a field has a comment on its own lines or the line above, or is named in a docstring of its class."""
    owner = next(c for c in cls.__mro__ if field in vars(c).get("__annotations__", {}))
    source = Path(inspect.getsourcefile(owner) or "").read_text()
    (body,) = (n.body for n in ast.walk(ast.parse(source)) if isinstance(n, ast.ClassDef) and n.name == owner.__name__)
    (node,) = (
        n for n in body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name) and n.target.id == field
    )
    lines = source.splitlines()
    commented = lines[node.lineno - 2].strip().startswith("#") or "  # " in "".join(
        lines[node.lineno - 1 : node.end_lineno]
    )
    return commented or f"`{field}`" in str(owner.__doc__)


def test_every_default_pickles_and_passes_through_the_configuration_unchanged() -> None:
    complete = 0
    for component in discover().components.values():
        node = OmegaConf.structured(component.cls)
        if OmegaConf.missing_keys(node) or any(
            f.default is f.default_factory is MISSING for f in fields(component.cls)
        ):
            continue  # a path, say, that only the user knows
        default = component.cls()
        assert pickle.loads(pickle.dumps(default)) == default, component.name
        assert OmegaConf.to_object(node) == default, component.name
        complete += 1
    assert complete >= len(KINDS)


def test_the_manual_of_a_component_shows_its_settings(omnilab_here: Callable[..., Any]) -> None:
    rc, out, err = omnilab_here("plugins", "radon")
    assert (rc, err) == (0, "")
    assert "descriptor=radon" in out
    assert "offsets: int = 173  # samples across the image circle" in out
    rc, out, err = omnilab_here("plugins", "radn")
    assert rc == 2
    assert "did you mean radon?" in err


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
