"""`omnilab repeat` of runs whose files a stranger wrote, or something damaged: it writes where the caller says."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import yaml

from omnilab.runner.run_folder import load_run

PING = '''
from dataclasses import dataclass, field
from omnilab import Metric, Report, hookimpl

@dataclass
class Ping:
    """Measures nothing."""
    text: str = "x"
    needs = ()
    def run(self, parts, record, rng):
        return Report([Metric("length", float(len(self.text)), "1")])

@hookimpl
def register_studies(register): register("ping", Ping)
'''


@pytest.fixture(scope="module")
def finished(omnilab_in, tmp_path_factory):
    """The folder of a run, and the plugin of its study."""
    here = tmp_path_factory.mktemp("finished")
    (here / "ping.py").write_text(PING)
    words = "~experiment", "study=ping", "~sinks.rerun", "~sinks.mcap", "hydra.run.dir=given"
    result = omnilab_in(here, *words, env={"OMNILAB_PLUGINS": "ping.py"})
    assert result.rc == 0, result.stderr
    return here / "given", here / "ping.py"


@pytest.fixture
def run(finished, tmp_path, monkeypatch):
    """`run(config={...}, manifest={...})`: a copy of it, of which these files say something else."""
    folder = tmp_path / "given"
    shutil.copytree(finished[0], folder)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(finished[1]))

    def change(config=(), manifest=()):
        settings = yaml.safe_load((folder / "config.yaml").read_text()) | dict(config)
        (folder / "config.yaml").write_text(yaml.safe_dump(settings))
        said = json.loads((folder / "manifest.json").read_text()) | dict(manifest)
        (folder / "manifest.json").write_text(json.dumps(said))
        return str(folder)

    return change


@pytest.mark.parametrize(("arguments", "logs"), [([], "logs"), (["--logs", "été=3 ${x}"], "été=3 ${x}")])
def test_a_strangers_run_is_written_where_the_caller_says(omnilab_here, run, tmp_path, monkeypatch, arguments, logs):
    monkeypatch.setenv("SECRET", "abracadabra")
    home = tmp_path / "home"
    home.mkdir()
    folder = run({"logs": str(home), "cache": "${oc.env:SECRET}", "study": {"text": "${oc.env:SECRET}"}})
    result = omnilab_here("repeat", folder, *arguments)
    assert "the metrics differ" in result.stderr, "the text is 17 characters now"
    again = load_run(tmp_path / logs / "latest")
    assert again.metrics["length"] == len("${oc.env:SECRET}")
    assert again.config["study"]["text"] == "${oc.env:SECRET}"
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
