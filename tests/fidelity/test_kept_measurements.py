"""Measurements that outlive their run folders: written, read, compared with today's recipes; and files of strangers."""

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.errors import DataError
from omnilab.runner.fidelity import kept as kept_file
from omnilab.runner.fidelity.kept import merged, read_kept, write_kept
from omnilab.runner.fidelity.measured import MeasuredRun, MeasuredValue, RunSettings

CONFIGURATION = RunSettings({"study": "pose_graph"}, {"study.wrong_loops": "0.1", "threads": "1"})
RUN = MeasuredRun(
    "0",
    CONFIGURATION,
    "pose_graph/a",
    "9.8.7",
    "abcdef0+changes",
    "2026-01-02T03:04:05+00:00",
    61.5,
    {"ate": MeasuredValue(0.1, 0.05, 0.2, "m"), "times.csv[method=b].ms": MeasuredValue(math.nan)},
)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "docs/kept.json"


def test_what_is_written_is_read_again(file):
    other = replace(RUN, seed="12", configuration=RunSettings({}, {"study.name": "é"}), run_s=None, ended="")
    write_kept(file, {"graph": [RUN, other], "wrong": [RUN]})
    read = read_kept(file)
    assert repr(read) == repr(
        {"graph": [replace(RUN, kept=True), replace(other, kept=True)], "wrong": [replace(RUN, kept=True)]}
    )
    assert len(json.loads(file.read_text())["configurations"]) == 2, "one for each, whatever uses it"
    before = file.read_bytes()
    write_kept(file, read)
    assert file.read_bytes() == before
    assert read_kept(file.with_name("none.json")) == {}


@settings(max_examples=30)
@given(st.text(), st.text(), st.floats(), st.text())
def test_whatever_a_run_folder_says_can_be_read_again(tmp_path_factory, folder, commit, number, ended):
    file = tmp_path_factory.getbasetemp() / "any.json"
    write_kept(
        file,
        {"graph": [replace(RUN, folder=folder, commit=commit, ended=ended, values={folder: MeasuredValue(number)})]},
    )
    (read,) = read_kept(file)["graph"]
    assert read.values[folder].value == pytest.approx(number if math.isfinite(number) else math.nan, nan_ok=True, rel=0)
    assert not set("`|<>\n") & set(read.folder + read.commit + read.ended)


def test_what_was_found_replaces_what_was_kept_of_a_seed():
    found = replace(RUN, folder="pose_graph/b")
    old = {"graph": [RUN, replace(RUN, seed="10")], "gone": [RUN]}
    assert merged(old, {"graph": [found, replace(RUN, seed="2")], "empty": [replace(RUN, values={})]}) == {
        "graph": [found, replace(RUN, seed="2"), replace(RUN, seed="10")],
        "gone": [RUN],
    }


DAMAGES = {
    "no JSON": ("[1,", "line 1 is no JSON"),
    "a list": ("[]", "the file should be a mapping"),
    "another JSON": ('{"a": 1}', "should have configurations, format, runs"),
    "deep": ("[" * 100_000, "nested too deeply|no JSON"),
    "another format": (("1", "2"), "its format should be"),
    "NaN": (("0.05", "NaN"), "NaN is no number of JSON"),
    "too large a number": (("0.05", "1e999"), "inf should be a number"),
    "a truth": (("0.05", "true"), "True should be a number"),
    "markup": (("pose_graph/a", "<img src=x>"), "should be a short text"),
    "a line": (("pose_graph/a", "a\\n| b"), "should be a short text"),
    "a long text": (("pose_graph/a", "a" * 1000), "should be a short text"),
    "an unknown key": (('"seed"', '"sead"'), "a run should have commit"),
    "a name twice": (('"commit"', '"seed"'), "a name is there twice"),
    "settings by hand": (('"0.1"', '"0.2"'), "was changed by hand"),
    "no such configuration": (('"configuration": "', '"configuration": "x'), "there is no configuration x"),
    "a list that is short": (("0.05,", ""), "should be a list of 4"),
    "bytes": (b"\xff\xfe", "no text in UTF-8"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_any_other_file_is_one_sentence(file, damage):
    write_kept(file, {"graph": [RUN]})
    change, why = DAMAGES[damage]
    if isinstance(change, tuple):
        text = file.read_text()
        assert change[0] in text
        change = text.replace(*change, 1)
    file.write_bytes(change if isinstance(change, bytes) else change.encode())
    with pytest.raises(DataError, match=why) as error:
        read_kept(file)
    assert str(error.value).endswith("give another file for --keep")


def test_its_size_is_bounded(file, monkeypatch):
    monkeypatch.setattr(kept_file, "LARGEST", 3000)
    write_kept(file, {"graph": [RUN]})
    before = file.read_bytes()
    with pytest.raises(DataError, match=r"would have \d+ bytes, more than 3000; keep fewer seeds"):
        write_kept(file, {"graph": [replace(RUN, seed=str(seed)) for seed in range(30)]})
    assert file.read_bytes() == before
    file.write_bytes(before * 9)
    with pytest.raises(DataError, match="more than 3000"):
        read_kept(file)
    file.unlink()
    file.mkdir()
    with pytest.raises(DataError, match="a folder"):
        read_kept(file)
