"""Runs whose files a stranger wrote; `bombs` can be imported from here."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))

PING = '''
import os
from dataclasses import dataclass
from pathlib import Path
from omnilab import Metric, Report, hookimpl
from omnilab.api import setting

@dataclass
class Ping:
    """Measures the length of a text and of a file."""
    text: str = "x"
    file: str | None = None
    output: str | None = setting(None, writes=True)
    needs = ()
    def run(self, parts, record, rng):
        read = os.path.getsize(self.file) if self.file and os.path.isfile(self.file) else 0
        if self.output:
            Path(self.output).write_text(self.text)
        return Report([Metric("length", float(len(self.text)), "1"), Metric("read", float(read), "1")])

@hookimpl
def register_studies(register): register("ping", Ping)
'''
WORDS = "~experiment", "study=ping", "~sinks.rerun", "~sinks.mcap", "hydra.run.dir=given"


@pytest.fixture(scope="session")
def ping_file(tmp_path_factory):
    """A plugin with a study that does nearly nothing."""
    file = tmp_path_factory.mktemp("plugin") / "ping.py"
    file.write_text(PING)
    return file


@pytest.fixture
def ping(ping_file, monkeypatch):
    """The study `ping`."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(ping_file))
    return ping_file


@pytest.fixture(scope="session")
def finished(omnilab_in, tmp_path_factory, ping_file):
    """The folder of a run of that study."""
    here = tmp_path_factory.mktemp("finished")
    result = omnilab_in(here, *WORDS, env={"OMNILAB_PLUGINS": str(ping_file)})
    assert result.rc == 0, result.stderr
    return here / "given"


@pytest.fixture
def run(finished, ping, tmp_path):
    """`run(config={...}, manifest={...})`: a copy of it, of which these files say something else."""
    folder = tmp_path / "given"
    shutil.copytree(finished, folder)

    def change(config=(), manifest=()):
        settings = yaml.safe_load((folder / "config.yaml").read_text()) | dict(config)
        (folder / "config.yaml").write_text(yaml.safe_dump(settings))
        said = json.loads((folder / "manifest.json").read_text()) | dict(manifest)
        (folder / "manifest.json").write_text(json.dumps(said))
        return str(folder)

    return change
