"""The command `new`: what it makes and says, and what it refuses, in one sentence and with nothing half-written."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omnilab.errors import ConfigError
from omnilab.runner.authoring import new as command
from omnilab.runner.authoring.names import check_name
from omnilab.runner.authoring.rendering import NewComponent
from omnilab.runner.registry import Registry, discover


@pytest.fixture(scope="module")
def registry() -> Registry:
    return discover("")


@pytest.mark.parametrize(
    ("kind", "name", "sentence"),
    [
        ("descriptor", "radon", "descriptor 'radon' of plugin 'appearance'"),
        ("sensor", "SkyLine", "did you mean sky_line?"),
        ("sensor", "sky-line", "did you mean sky_line?"),
        ("sensor", "2d", "is no name of a component"),
        ("sensor", "", "is no name of a component"),
        ("sensor", "../up", "is no name of a component"),
        ("sensor", "a" * 51, "up to 50"),
        ("descriptor", "class", "is a word of Python; give another name, such as class_descriptor"),
        ("descriptor", "none", "is a word of"),
        ("descriptor", "null", "is a word of Hydra"),
        ("descriptor", "signatures", "the class of 'signatures' would be Signatures"),
        ("descriptor", "exception", "the class of 'exception' would be Exception"),
        ("descriptor", "test", "the module of 'test' would be test, and there is one"),
        ("descriptor", "types", "there is one of that name already"),
        ("descriptor", "numpy", "there is one of that name already"),
        ("study", "quickstart", "a recipe of"),
    ],
)
def test_a_name_that_cannot_be_is_refused(kind: str, name: str, sentence: str, registry: Registry) -> None:
    component = NewComponent(kind, name)
    with pytest.raises(ConfigError) as error:
        check_name(component, component.name, registry)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_the_names_that_are_advised_can_be(registry: Registry) -> None:
    for component in (NewComponent("descriptor", "class_descriptor"), NewComponent("descriptor", "my_signatures")):
        check_name(component, component.name, registry)
        check_name(component, component.package, registry)


def test_a_package_takes_no_name_of_another(registry: Registry) -> None:
    component = NewComponent("backend", "slam")
    with pytest.raises(ConfigError, match="would be omnilab_slam, and there is one"):
        check_name(component, component.package, registry)


def test_a_kind_that_is_none(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    rc, out, err = omnilab_here("new", "descriptors", "mine")
    assert (rc, out, err.count("\n")) == (2, "", 1)
    assert "(did you mean descriptor?)" in err
    assert list(tmp_path.iterdir()) == []


def test_a_distribution_is_made_and_its_files_are_as_others_make_theirs(
    omnilab_here: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "omnilab-mine").mkdir()  # empty, which is no obstacle
    rc, out, _ = omnilab_here("new", "descriptor", "mine")
    assert rc == 0
    (made,) = tmp_path.iterdir()
    (tmp_path / "other").mkdir()
    assert made.stat().st_mode == (tmp_path / "other").stat().st_mode
    assert out.startswith("omnilab-mine is made. Next:\n  cd omnilab-mine\n")
    assert "descriptor=mine" in out


def test_what_is_there_is_left_alone(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "omnilab-mine").mkdir()
    (tmp_path / "omnilab-mine/notes").write_text("mine")
    (tmp_path / "test_mine.py").write_text("mine")
    for form, there in (("--package", "omnilab-mine"), ("--file", "test_mine.py")):
        rc, out, err = omnilab_here("new", "descriptor", "mine", form)
        assert (rc, out, err.count("\n")) == (2, "", 1)
        assert f"{there} is there already" in err
    found = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert found == ["omnilab-mine", "omnilab-mine/notes", "test_mine.py"]


def test_a_folder_that_is_not_there(omnilab_here: Callable[..., Any]) -> None:
    rc, _, err = omnilab_here("new", "descriptor", "mine", "--into", "nowhere")
    assert rc == 2
    assert err.endswith("there is no folder nowhere; make it first, or give another with --into DIR\n")


def test_a_folder_that_cannot_be_looked_into(
    omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def closed(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "omnilab-mine").mkdir()
    monkeypatch.setattr(Path, "iterdir", closed)
    rc, _, err = omnilab_here("new", "descriptor", "mine")
    assert (rc, err.count("\n")) == (2, 1)
    assert "nothing can be made in . (Permission denied)" in err


@pytest.mark.parametrize("form", ["--package", "--file"])
def test_a_disk_that_fills_up_leaves_nothing(
    form: str, omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written, write = [], Path.write_text

    def filling(path: Path, *arguments: Any, **more: Any) -> int:
        written.append(path)
        if len(written) == 2:
            raise OSError(28, "No space left on device", str(path))
        return write(path, *arguments, **more)

    monkeypatch.setattr(Path, "write_text", filling)
    rc, out, err = omnilab_here("new", "descriptor", "mine", form)
    assert (rc, out) == (2, "")
    assert err.endswith(
        "nothing can be made in . (No space left on device); mend that, or give another folder with --into DIR\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_the_second_file_that_cannot_be_moved_takes_the_first_away(
    omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename = Path.rename

    def refusing(path: Path, target: Path) -> Path:
        if target.name == "test_mine.py":
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refusing)
    rc, _, err = omnilab_here("new", "descriptor", "mine", "--file")
    assert (rc, "Permission denied" in err) == (2, True)
    assert list(tmp_path.iterdir()) == []


# -------------------------------------------------------------------------------------------------- git, and next steps
def test_the_author_is_who_git_says_and_git_need_not_be_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    git = tmp_path / "git"
    git.write_text("#!/bin/sh\necho 'Ada \"the first\" Lovelace'\n")
    git.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    component = NewComponent("descriptor", "mine")
    assert command._author(component) == 'Ada "the first" Lovelace'
    git.write_text("#!/bin/sh\nexit 1\n")
    assert command._author(component) == "The authors of omnilab-mine"
    git.unlink()
    assert command._author(component) == "The authors of omnilab-mine"


@pytest.mark.slow
def test_the_steps_of_a_file_work_when_they_are_followed(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "my work").mkdir()
    rc, out, _ = omnilab_here("new", "sink", "mine", "--file", "--into", "my work")
    assert rc == 0
    steps = [line.partition("  #")[0].strip() for line in out.splitlines()[1:]]
    assert steps[0] == "cd 'my work'"
    followed = " && ".join(steps[:-1])  # the last is a run
    done = subprocess.run(
        followed, shell=True, cwd=tmp_path, env=os.environ, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
    assert "sink=mine keeps all" in done.stdout


def test_a_recipe_is_no_package(omnilab_here: Callable[..., Any]) -> None:
    rc, _, err = omnilab_here("new", "recipe", "mine", "--package")
    assert rc == 2
    assert "a recipe is one file" in err
    assert "new study mine" in err
    assert not Path("experiment").exists()
    assert omnilab_here("new", "recipe", "mine", "--file").rc == 0


def test_a_recipe_is_found_where_it_is_made(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    rc, out, _ = omnilab_here("new", "recipe", "mine")
    assert rc == 0
    (step, _) = [line.partition("  #")[0].split() for line in out.splitlines()[1:]]
    rc, shown, err = omnilab_here(*step[step.index("--config-dir") :])
    assert rc == 0, err
    assert "step_m: 0.8" in shown
    for name, sentence in (
        ("mine", "is there already"),
        ("quickstart", "called 'quickstart' already"),
        ("a/b", "no name"),
    ):
        rc, _, err = omnilab_here("new", "recipe", name)
        assert (rc, err.count("\n")) == (2, 1)
        assert sentence in err
    assert [path.name for path in (tmp_path / "experiment").iterdir()] == ["mine.yaml"]
