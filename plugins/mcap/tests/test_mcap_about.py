"""What a log says of its run, as the reference reader finds it: metadata and attachments, also after a repair."""

from __future__ import annotations

import json
import random

import pytest
from mcap.reader import make_reader

from omnilab import api
from omnilab.testing.damage import KINDS, damaged
from omnilab_mcap import McapSink, about

MANIFEST = {"id": "0123abc", "experiment": "grid", "overrides": ["a=1", "b='x y'"], "seed": 7, "identity": "f00"}
RESULT = api.RunResult("done", [api.Metric("rate", 1 / 3, "1"), api.Metric("error", float("nan"), "m")])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run that ended well, with some chunks between what it says at its start and at its end."""
    folder = tmp_path_factory.mktemp("sweep") / "3"
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps(MANIFEST))
    (folder / "config.yaml").write_text("seed: 7\n")
    sink = McapSink()
    sink.open(folder)
    (folder / "metrics.csv").write_text("metric,value\nrate,0.3\n")
    for step in range(60):
        sink.write("/log", api.Text(f"step {step} {random.Random(step).randbytes(100).hex()}"), api.Tick(step, step))
        if step % 10 == 9:
            sink.flush()
    sink.conclude(RESULT)
    sink.close()
    return folder


def described(path):
    """The metadata records, and the attachments by name."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        attachments = {a.name: (a.media_type, a.data.decode()) for a in reader.iter_attachments()}
        return [(m.name, m.metadata) for m in reader.iter_metadata()], attachments


def test_metadata_at_the_start_and_at_the_end(folder):
    [(name, start), (same_name, end)], _ = described(folder / "run.mcap")
    assert name == same_name == "omnilab"
    known = {"run": f"{folder.parent.name}/3", "id": "0123abc", "experiment": "grid", "seed": "7", "identity": "f00"}
    known |= {"overrides": "a=1 'b='\"'\"'x y'\"'\"''"}
    assert start.items() >= (known | {"status": "running"}).items()
    assert end == start | {"status": "done", "metrics.rate": repr(1 / 3), "metrics.error": "nan"}


def test_files_of_the_run_are_attached(folder):
    _, attachments = described(folder / "run.mcap")
    assert attachments == {
        "manifest.json": ("application/json", json.dumps(MANIFEST)),
        "config.yaml": ("application/yaml", "seed: 7\n"),
        "metrics.csv": ("text/csv", "metric,value\nrate,0.3\n"),
    }


def test_a_file_that_is_too_large_or_no_file_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(about, "LARGEST_BYTES", 10)
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    (tmp_path / "config.yaml").mkdir()
    sink = McapSink()
    sink.open(tmp_path)
    sink.close()
    assert described(tmp_path / "run.mcap")[1] == {}


@pytest.mark.parametrize(
    "content", ["", "[1]", "{", "[" * 100_000, '{"overrides": 3, "seed": "x", "experiment": null}']
)
def test_a_manifest_that_says_nothing_stops_no_log(tmp_path, content):
    (tmp_path / "manifest.json").write_text(content)
    sink = McapSink()
    sink.open(tmp_path)
    sink.conclude(api.RunResult("failed", error="x" * 10_000))
    sink.close()
    [(_, start), (_, end)], _ = described(tmp_path / "run.mcap")
    assert start.keys() >= {"run", "id", "status"}
    assert "experiment" not in start
    assert end["error"] == "x" * about.LONGEST


@pytest.mark.parametrize("left", [0.3, 0.7])
def test_a_killed_run_keeps_what_it_said_at_its_start(folder, tmp_path, left):
    whole = (folder / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(whole[: int(left * len(whole))])
    assert "was torn" in McapSink().repair(tmp_path)
    metadata, attachments = described(tmp_path / "run.mcap")
    before, files = described(folder / "run.mcap")
    assert metadata == before[:1]
    assert attachments == {name: files[name] for name in ("manifest.json", "config.yaml")}


@pytest.mark.parametrize("kind", KINDS)
def test_damage_costs_only_what_it_hits(folder, tmp_path, kind):
    """Of what stands outside the damaged bytes nothing is lost."""
    whole, (before, files) = (folder / "run.mcap").read_bytes(), described(folder / "run.mcap")
    places = {name: whole.index(content.encode()) for name, (_, content) in files.items()}
    for seed in range(4):
        data, (start, end) = damaged(whole, kind, random.Random(f"{kind} {seed}"))
        (tmp_path / "run.mcap").write_bytes(data)
        McapSink().repair(tmp_path)
        metadata, attachments = described(tmp_path / "run.mcap")
        assert all(record in before for record in metadata)
        for name, at in places.items():
            if (at + len(files[name][1]) + 100 < start or end + 200 < at) and data != whole:
                assert attachments.get(name) == files[name], f"seed {seed}: {name}"
