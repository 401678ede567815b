"""A run's header in its recording, and the layout that is there before anything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from omnilab.api import Image, Mesh, Panel, Progress, RunResult, Text, Tick, ViewLayout
from omnilab_rerun import RerunSink, shown_header
from omnilab_rerun.shown_header import part_with

HEADER = Text("### grid: running\n\nseed 0", markdown=True)
LAYOUT = ViewLayout([[Panel("map", "Room", ["room"])], [Panel("image", "Image", ["image"])]])
ROOM = Mesh(np.array([[-5, -4, 0], [5, 4, 0], [5, -4, 3.0]]), np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8))


@pytest.fixture
def written(tmp_path, read, monkeypatch):
    """`written(record, ...)`: what a sink leaves that is given these, and is closed then; ("result", RunResult) concludes."""
    monkeypatch.setattr(shown_header, "EVERY_S", 0.0)
    monkeypatch.setattr(shown_header, "SHARE", 0.0)

    def written(*entries):
        sink = RerunSink()
        sink.open(tmp_path)
        for path, record, *tick in entries:
            if isinstance(record, RunResult):
                sink.conclude(record)
            elif path == "flush":
                sink.flush()
            else:
                sink.write(path, record, *(tick or [None]))
        sink.close()
        return read(tmp_path / "run.rrd")

    return written


def shares(blueprint):
    """The heights of header and panels, as they were sent."""
    return [
        parts["ContainerBlueprint:row_shares"][-1] for _, parts in blueprint if "ContainerBlueprint:row_shares" in parts
    ]


def shown(blueprint):
    """Names of the views, those that are gone left out."""
    alive = {path: True for path, _ in blueprint}
    alive |= {path: False for path, parts in blueprint if "Clear:is_recursive" in parts}
    found = {
        path: parts["ViewBlueprint:display_name"][-1][0]
        for path, parts in blueprint
        if "ViewBlueprint:display_name" in parts
    }
    return {name for path, name in found.items() if alive[path]}


def visible(blueprint):
    """The panels that are shown, by the last that was sent of each."""
    found = {}
    for path, parts in blueprint:
        if "ViewBlueprint:visible" in parts:
            found[path] = (parts["ViewBlueprint:display_name"][-1][0], parts["ViewBlueprint:visible"][-1][0])
    return {name for name, shown in found.values() if shown}


def test_the_header_lies_still_and_the_last_one_holds(written):
    found = written(("header", HEADER), ("header", Text("### grid: done", markdown=True)))
    assert found.is_static("/header")
    assert [text for (text,) in found.rows("/header", "TextDocument:text")] == [HEADER.text, "### grid: done"]


def test_it_says_how_far_the_run_is_until_it_ends(written):
    done = Text("### grid: done", markdown=True)
    found = written(
        ("header", HEADER),
        *[("progress", Progress("queries", i, 9)) for i in range(3)],
        ("header", done),
        ("flush", None),
    )
    texts = [text for (text,) in found.rows("/header", "TextDocument:text")]
    assert texts[1:] == [*(f"### grid: running, queries {i} of 9\n\nseed 0" for i in range(3)), done.text]


def test_it_is_shown_anew_no_more_often_than_it_can_be_read(written, monkeypatch):
    monkeypatch.setattr(shown_header, "EVERY_S", 60.0)
    found = written(("header", HEADER), *[("progress", Progress("queries", i, 99)) for i in range(99)], ("flush", None))
    assert len(found.rows("/header", "TextDocument:text")) == 2


def test_a_layout_is_there_at_once(written, tmp_path, read):
    """Header and log, before the study has said a word."""
    assert shown(written(("header", HEADER)).blueprint()) == {"Run", "Log"}


def test_the_study_s_layout_takes_its_place_before_the_first_image(written):
    found = written(("header", HEADER), ("", LAYOUT), ("flush", None))
    assert len(found.reader.blueprints()) == 1, "of several, mending a torn file would pick any"
    assert shown(found.blueprint()) == {"Run", "Room", "Image"}


def test_the_room_is_seen_whole_as_soon_as_it_is_known(written):
    image = Image(np.zeros((4, 4), np.uint8), "png")
    found = written(
        ("header", HEADER), ("", LAYOUT), ("flush", None), ("room", ROOM), ("flush", None), ("image", image, Tick(1, 0))
    )
    targets = [
        parts["EyeControls3D:look_target"][-1][0]
        for _, parts in found.blueprint()
        if "EyeControls3D:look_target" in parts
    ]
    assert targets[-1] == [0, 0, 1.5]


def test_a_part_of_the_recording_says_how_the_run_stands_by_now(written, tmp_path, read):
    written(("header", HEADER))
    with part_with("### grid: killed", tmp_path / "run.rrd") as part:
        found = read(part)
    ids = {
        entry.recording_id for entry in [*found.reader.recordings(), *read(tmp_path / "run.rrd").reader.recordings()]
    }
    assert len(ids) == 1
    assert found.rows("/header", "TextDocument:text") == [["### grid: killed"]]
    assert not part.exists()


def test_an_error_has_room(written):
    result = RunResult("failed", error="DataError: no room")
    (before, after) = (
        written(("header", HEADER), ("", LAYOUT), ("result", one)).blueprint() for one in (RunResult("done"), result)
    )
    assert shares(before)[-1][0] < shares(after)[-1][0] < 0.2
    bug = replace(result, traceback="File x, line 3")
    assert shares(written(("header", HEADER), ("", LAYOUT), ("result", bug)).blueprint())[-1][0] > 0.3


def test_what_holds_nothing_is_hidden_before_the_first_image_and_at_the_end(written):
    """No panel says that there is no data."""
    image = Image(np.zeros((4, 4), np.uint8), "png")
    before = [("header", HEADER), ("", LAYOUT), ("room", ROOM)]
    assert visible(written(*before[1:], ("flush", None)).blueprint()) == {"Room"}, "a script has no header"
    assert visible(written(*before, ("flush", None)).blueprint()) == {"Run", "Room"}
    assert visible(written(*before, ("log", Text("x"), Tick(0, 0)), ("flush", None)).blueprint()) == {
        "Run",
        "Room",
        "Image",
    }
    ended = ("result", RunResult("interrupted"))
    assert visible(written(*before, ("log", Text("x"), Tick(0, 0)), ended).blueprint()) == {"Run", "Room"}
    assert visible(written(*before, ("image", image, Tick(0, 0)), ended).blueprint()) == {"Run", "Room", "Image"}
