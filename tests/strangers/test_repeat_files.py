"""`omnilab repeat` of runs whose files a stranger wrote, or something damaged: it writes where the caller says."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run


@pytest.mark.parametrize(("arguments", "logs"), [([], "logs"), (["--logs", "été=3 ${x}"], "été=3 ${x}")])
def test_a_strangers_run_is_written_where_the_caller_says(omnilab_here, run, tmp_path, monkeypatch, arguments, logs):
    monkeypatch.setenv("SECRET", "abracadabra")
    home = tmp_path / "home"
    home.mkdir()
    folder = run(
        {"logs": str(home), "cache": "${oc.env:SECRET}", "cache_gb": 1e-9, "study": {"text": "${oc.env:SECRET}"}}
    )
    result = omnilab_here("repeat", folder, *arguments)
    assert "the metrics differ" in result.stderr, "the text is 17 characters now"
    again = load_run(tmp_path / logs / "latest")
    assert again.metrics["length"] == len("${oc.env:SECRET}")
    assert again.config["study"]["text"] == "${oc.env:SECRET}"
    assert again.config["cache_gb"] == 4, "or a stranger's would throw the caller's away"
    assert list(home.iterdir()) == []
    assert not [path for path in tmp_path.rglob("*") if "abracadabra" in path.name]
    assert not [path for path in again.folder.iterdir() if b"abracadabra" in path.read_bytes()]


@pytest.mark.parametrize("name", ["../../escaped", "/tmp/escaped", "a/../../b", "", "a b\n", "~"])
def test_an_experiment_of_an_odd_name_is_refused(omnilab_here, run, tmp_path, name):
    result = omnilab_here("repeat", run(manifest={"experiment": name}))
    assert result.rc == 2
    assert "which is no name; correct it" in result.stderr
    assert not (tmp_path / "logs" / "latest").exists()


@pytest.mark.parametrize(
    ("config", "manifest", "told"),
    [
        ({"seed": "many"}, {}, "config.yaml has seed=many, which does not fit"),
        ({"speed": 3}, {}, "config.yaml has speed=3, which does not fit"),
        ({"sinks": 3}, {}, "has sinks=3, and components by name belong there"),
        ({"study": {"txt": "x"}}, {}, "no longer fits Ping"),
        ({"study": {"text": [1]}}, {}, "no longer fits Ping (its setting text)"),
        ({"sensor": "mirror"}, {}, "do not say what its sensor was"),
        ({}, {"components": None}, "do not say what its"),
        ({}, {"components": {"study": "ping"}}, "do not say what its"),
        ({}, {"components": {"study": {"name": 3}}}, "do not say what its"),
    ],
    ids=range(9),
)
def test_files_that_do_not_fit_are_named(omnilab_here, run, config, manifest, told):
    result = omnilab_here("repeat", run(config, manifest))
    assert result.rc == 2, result.stderr
    assert told in result.stderr
    assert "Traceback" not in result.stderr


def test_the_run_itself_repeats(omnilab_here, run, tmp_path):
    result = omnilab_here("repeat", run())
    assert result.rc == 0, result.stderr
    assert "the metrics are the same" in result.stderr
    assert Path(tmp_path / "logs" / "latest").exists()


# ---------------------------------------------------------------------------------------- what is read, and what is written
@pytest.fixture
def secret(tmp_path):
    """A file of the caller's, that no run has read."""
    file = tmp_path / "home" / "secret"
    file.parent.mkdir()
    file.write_text("abracadabra")
    return file


def refused(result, name, place):
    assert result.rc == 2, result.stderr
    assert f"names study.{name}={place}, of which its manifest holds no digest or another" in result.stderr
    assert "add --trust" in result.stderr


@pytest.mark.parametrize(
    "named", ["{}", "home/secret", "./home/../home/secret", "link", "home", "home/..", "/etc/passwd"]
)
def test_a_file_that_the_run_did_not_read_is_not_opened(omnilab_here, run, secret, tmp_path, named):
    (tmp_path / "link").symlink_to(secret)
    place = named.format(secret)
    refused(omnilab_here("repeat", run({"study": {"file": place}})), "file", place)
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize(
    "files", [{"study.file": "0" * 64}, None, 3, {"study.file": None}, {"study.file": [1]}], ids=str
)
def test_digests_of_anything_else_are_none(omnilab_here, run, secret, files):
    refused(omnilab_here("repeat", run({"study": {"file": str(secret)}}, {"files": files})), "file", secret)


def test_a_file_of_home_is_not_opened(omnilab_here, run, secret, monkeypatch):
    monkeypatch.setenv("HOME", str(secret.parent))
    refused(omnilab_here("repeat", run({"study": {"file": "~/secret"}})), "file", secret)


def test_a_pipe_is_not_waited_for(omnilab_here, run, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    refused(omnilab_here("repeat", run({"study": {"file": "pipe"}})), "file", "pipe")


def test_a_file_below_a_folder_that_another_setting_names_is_found(omnilab_here, run, secret, tmp_path):
    (tmp_path / "images").mkdir()
    result = omnilab_here("repeat", run({"study": {"text": "images", "file": "../home/secret"}}))
    assert result.rc == 2
    assert (
        "study.text=images, study.file=../home/secret" in result.stderr
        or "study.file below study.text" in result.stderr
    )


def test_the_caller_may_trust_a_run(omnilab_here, run, secret, tmp_path):
    assert omnilab_here("repeat", run({"study": {"file": str(secret)}}), "--trust").rc == 1, "other metrics, but it ran"
    assert load_run(tmp_path / "logs" / "latest").metrics["read"] == len("abracadabra")


@pytest.mark.parametrize("name", ["input", "images"])
def test_ones_own_run_is_repeated_until_its_inputs_change(omnilab_here, ping, tmp_path, name):
    """A file by its content, a folder by the names and sizes of what it holds."""
    (tmp_path / "images" / "below").mkdir(parents=True)
    (tmp_path / "images" / "below" / "a.png").write_text("a")
    (tmp_path / "input").write_text("abc")
    assert omnilab_here("~experiment", "study=ping", f"study.file={name}", "~sinks.rerun", "~sinks.mcap",
                        "hydra.run.dir=given").rc == 0  # fmt: skip
    (tmp_path / "images" / ".DS_Store").write_text("what is hidden is no image")
    assert omnilab_here("repeat", "given").rc == 0
    with (tmp_path / "images" / "below" / "a.png").open("a") as out:
        out.write("b")
    (tmp_path / "input").write_text("abd")
    refused(omnilab_here("repeat", "given"), "file", name)


def test_a_folder_that_holds_the_runs_is_the_same_after_another_run(omnilab_here, ping, tmp_path):
    (tmp_path / "a.png").write_text("a")
    words = "~experiment", "study=ping", "study.file=.", "~sinks.rerun", "~sinks.mcap", "hydra.run.dir=logs/given"
    assert omnilab_here(*words).rc == 0
    assert omnilab_here("repeat", "logs/given").rc == 0
    assert omnilab_here("repeat", "logs/given").rc == 0


def test_what_a_run_writes_goes_into_the_new_runs_folder(omnilab_here, run, tmp_path):
    elsewhere = tmp_path / "home"
    result = omnilab_here("repeat", run({"study": {"output": str(elsewhere)}}))
    assert result.rc == 0, result.stderr
    assert not elsewhere.exists()
    assert (tmp_path / "logs" / "latest" / "study.output").read_text() == "x"
