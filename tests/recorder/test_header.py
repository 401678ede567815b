"""The header of a run: the first record of its logs, and the last; what Markdown makes of it."""

from __future__ import annotations

import html
import re
import signal
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import RrdReader

from omnilab.api import Metric, Progress, RunResult, Text
from omnilab.errors import visible
from omnilab.manifest import Manifest
from omnilab.run_header import HEADER, in_words, plain, run_header
from omnilab.runner.recorder import Recorder
from omnilab_mcap import McapSink
from omnilab_rerun import RerunSink

RUN = Manifest(
    "0a", Path("/logs/grid/2026-11-30_12-00-00-0a0b0c"), "grid", ("experiment=grid", "seed=3", "logs=/tmp/x"), 3, "f0",
    "2026-11-30T12:00:00+00:00", "0.1.0", "0123456789abcdef+changes",
)  # fmt: skip
METRICS = [
    Metric(name, value, unit)
    for name, value, unit in (("rate", 1 / 3, "1"), ("ate", 2, "m"), ("c", 3, "s"), ("d", 4, "1"))
]


class Memory:
    """Keeps the texts it is given."""

    def __init__(self) -> None:
        self.taken = []

    def open(self, folder):
        pass

    def write(self, path, record, tick):
        self.taken.append((path, getattr(record, "text", None)))

    def flush(self):
        pass

    close = flush


def shown(markdown):
    """The text that a reader of Markdown sees, line by line."""
    text = html.unescape(re.sub(r"<[^>]*>", "", MarkdownIt().render(markdown)))
    return [line.strip() for line in text.splitlines() if line]


def test_it_says_which_run_it_is_and_how_it_stands():
    assert shown(run_header(RUN, "running")) == [
        "grid: running",
        "seed 3 · 2026-11-30 12:00 UTC · omnilab 0.1.0 · commit 01234567+changes · seed=3",
    ]


def test_it_says_what_came_out():
    title, metrics, _ = shown(run_header(RUN, "done", RunResult("done", METRICS)))
    assert (title, metrics) == ("grid: done", "rate 0.3333 · ate 2 m · c 3 s")
    assert "error no value" in run_header(RUN, "done", RunResult("done", [Metric("error", float("nan"), "m")]))


def test_it_says_what_went_wrong_and_how_far_it_came():
    result = RunResult("failed", error="ValueError: a_b *c* <d> & [e](f)\n`g` _h_", traceback="line 1\n  File <x>, *y*")
    found = shown(run_header(RUN, "failed", result, "at queries 86 of 200"))
    assert found[0] == "grid: failed, at queries 86 of 200"
    assert found[2:] == ["ValueError: a_b *c* <d> & [e](f) `g` _h_", "line 1", "File <x>, *y*"]


def test_of_many_overrides_a_few_are_shown_and_what_is_not_known_is_left_out():
    bare = Manifest("0a", Path("/logs/mine"), overrides=tuple(f"study.a{i}={'x' * 99}" for i in range(10)))
    title, line = shown(run_header(bare, "running"))
    assert title == "mine: running"
    assert line.count("xxx ...") == 8
    assert line.endswith(" · 2 more")
    assert shown(run_header(Manifest("0a", Path("/logs/mine")), "running"))[1] == "nothing overridden"


@settings(max_examples=60)
@given(st.text(st.sampled_from("ab_*`[]()<>&;!~|\\\\ \x1b\néü1") | st.characters(), min_size=1, max_size=20))
def test_any_text_is_shown_as_it_is(text):
    """By a parser of CommonMark: nothing in a name or an error becomes a link, a picture, an emphasis."""
    given = f"x {text}"
    inline = MarkdownIt().parseInline(plain(given))[0].children
    assert {token.type for token in inline} <= {"text", "text_special"}
    assert "".join(token.content for token in inline) == visible(" ".join(given.split()))


def test_progress_in_words():
    assert in_words(None) == in_words(Progress("", 0, 0)) == ""
    assert in_words(Progress("queries", 0, 200)) == "queries 0 of 200"
    assert in_words(Progress("images", 12, 0)) == "images 12"
    assert in_words(Progress("results", 0, 0)) == "results"


@pytest.mark.parametrize(
    ("result", "last"),
    [
        (RunResult("done", METRICS), "### grid: done\n"),
        (RunResult("failed", error="DataError: no room"), "### grid: failed, at places 1 of 2\n"),
        (RunResult("interrupted"), "### grid: interrupted, at places 1 of 2\n"),
    ],
)
def test_it_is_the_first_record_and_the_last(result, last):
    sink = Memory()
    with Recorder({"memory": sink}, manifest=RUN) as record:
        assert sink.taken == [(HEADER, run_header(RUN, "running"))]
        record.log("progress", Progress("places", 1, 2))
        record.result = result
    (_, text), *before = sink.taken[::-1]
    assert text.startswith(last)
    assert [path for path, _ in before] == ["progress", HEADER]


def interrupted(recorder):
    with recorder:
        recorder.result = RunResult("interrupted")
        recorder.interrupt(signal.SIGTERM)


def test_an_interrupted_run_has_its_last_header():
    sink = Memory()
    with pytest.raises(KeyboardInterrupt):
        interrupted(Recorder({"memory": sink}, manifest=RUN))
    assert [path for path, _ in sink.taken] == [HEADER, HEADER]


def test_scripts_without_a_run_have_none():
    sink = Memory()
    with Recorder({"memory": sink}) as record:
        record.log("log", Text("x"))
        record.result = RunResult("done")
    assert sink.taken == [("log", "x")]


def test_both_logs_have_the_same(tmp_path):
    with Recorder({"mcap": McapSink(), "rerun": RerunSink()}, tmp_path, manifest=RUN) as record:
        record.result = RunResult("done", METRICS)
    with (tmp_path / "run.mcap").open("rb") as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/header"])
        logged = [decoded.message for _, _, _, decoded in messages]
    chunks = RrdReader(tmp_path / "run.rrd").stream().filter(content="/header").to_chunks()
    shown = [text for chunk in chunks for (text,) in chunk.to_record_batch().to_pydict()["TextDocument:text"]]
    assert logged == shown == [run_header(RUN, "running"), run_header(RUN, "done", RunResult("done", METRICS))]
