"""The components there are: all are listed, documented and ready to configure, and listing them is quick."""

from __future__ import annotations

import ast
import inspect
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import MISSING, fields, make_dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from omegaconf import OmegaConf

from omnilab import hooks
from omnilab.api import KINDS
from omnilab.runner.registry import discover


# --------------------------------------------------------------------------------------------------------------- listed
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
    assert (
        "omnilab plugins | new | runs | repeat | repair | sweep | compare | fidelity | submit | docs | check | calibrate | camera | convert | dataset | report | serve | view | world "
        in out
    )
    for kind in KINDS:
        assert re.search(rf"^{kind}: {', '.join(discover().names(kind))}$", out, re.MULTILINE)
    recipes = sorted(path.stem for path in (Path(__file__).parents[2] / "conf/experiment").glob("*.yaml"))
    assert f"experiment: {', '.join(recipes)}\n" in out


HEAVY = {"cv2", "gtsam", "matplotlib", "mcap", "numba", "pandas", "pyarrow", "rerun", "scipy", "skimage"}


def test_listing_plugins_imports_nothing_heavy() -> None:
    script = f"""
import sys
from omnilab.runner.cli import main
try:
    main(["plugins"])
except SystemExit as end:
    assert end.code == 0
print("HEAVY", *sorted({HEAVY} & set(sys.modules)))
"""
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True).stdout
    assert out.splitlines()[-1].strip() == "HEAVY"


@pytest.mark.parametrize(
    ("name", "registered"),
    [
        ("RadonHog", "radon_hog"), ("Log", "log"), ("Onnx", "onnx"), ("RotationalPca", "rotational_pca"),
        ("ViewEkf", "view_ekf"), ("GtsamIsam2", "gtsam_isam2"),
    ],
)  # fmt: skip
def test_a_component_is_registered_by_its_class_name_in_snake_case(name: str, registered: str) -> None:
    assert hooks.snake_case(name) == registered


def test_a_package_registers_the_dataclasses_that_it_imports_in_order() -> None:
    package = ModuleType("package")
    later, sooner = make_dataclass("LaterOne", []), make_dataclass("ASooner", [])
    vars(package).update(LaterOne=later, ASooner=sooner, Plain=type("Plain", (), {}), one=later(), module=hooks)
    registered: list[tuple[str, type[Any], str]] = []

    def register(name: str, cls: type[Any], formerly: str = "") -> None:
        registered.append((name, cls, formerly))

    hooks.register_all(register, package, {"later_one": "late"})
    assert registered == [("later_one", later, "late"), ("asooner", sooner, "")]


# ----------------------------------------------------------------------------------------------------------- documented
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


@cache
def parsed(path: Path) -> tuple[str, list[ast.ClassDef]]:
    """A file's text and its classes."""
    source = path.read_text()
    return source, [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)]


def documented(cls: type[Any], field: str) -> bool:
    """Whether a field has a comment on its own lines or the line above, or is named in a docstring of its class."""
    owner = next(c for c in cls.__mro__ if field in vars(c).get("__annotations__", {}))
    source, classes = parsed(Path(inspect.getsourcefile(owner) or ""))
    (body,) = (node.body for node in classes if node.name == owner.__name__)
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


def test_the_manual_of_an_experiment_is_its_configuration(omnilab_here: Callable[..., Any]) -> None:
    asked = omnilab_here("plugins", "recorded_grid")
    assert asked.rc == 2
    proposed = "experiment=recorded_grid --cfg job"
    assert f"'recorded_grid' is an experiment, no component; its settings: omnilab {proposed}" in asked.stderr
    followed = omnilab_here(*proposed.split())
    assert followed.rc == 0
    assert "every: 2" in followed.stdout
