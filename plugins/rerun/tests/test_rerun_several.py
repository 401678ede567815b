"""Several runs in one viewer: what is merged, how it is laid out, and what is refused."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

import omnilab_rerun
from omnilab.api import Mesh, Panel, PlaceMap, Series, Signature, Tick, ViewLayout
from omnilab.errors import ConfigError, DataError
from omnilab.hooks import RunSummary
from omnilab_rerun import RerunSink, several
from omnilab_rerun.colors import RUNS
from omnilab_rerun.several.differences import differences, short_names

ROOM = Mesh(np.array([[-5, -4, 0], [5, 4, 0], [5, -4, 3.0]]), np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8))
PANELS = (
    Panel("map", "Room", ("room", "places")),
    Panel("plot", "Position error", ("error/position_m",)),
    Panel("plot", "Bands", ("bands",)),
)


def record(folder: Path, values, panels=PANELS):
    """A run's recording: a room, places, a curve, two more, and a matrix at steps 0 and 2."""
    folder.mkdir(parents=True)
    (folder / "status.json").write_text("{}")
    steps, sink = np.arange(3), RerunSink()
    sink.open(folder)
    if panels:
        sink.write("", ViewLayout([panels[:1], panels[1:]]), None)
    sink.write("room", ROOM, None)
    sink.write("places", PlaceMap(np.zeros((1, 3))), None)
    for path in ("error/position_m", "bands/low", "bands/high"):
        sink.write(path, Series(np.array(values), steps, steps, "m"), None)
    for step in (0, 2):
        sink.write("signature", Signature(np.full((2, 2), values[step], np.float32)), Tick(step, step))
    sink.close()


class KnownRuns:
    """Runs that are over; each is what a study with these components and settings would leave."""

    def __init__(self, **runs: RunSummary) -> None:
        self.runs = runs

    def ready(self, run: Path) -> Path:
        return run

    def summary(self, run: Path) -> RunSummary:
        return self.runs[run.name]


def summary(folder, study="grid", state="done", **config):
    return RunSummary(
        folder, state, study, ["descriptor=hog"], {"study": study, "descriptor": config.pop("descriptor", "radon")},
        {"seed": 0, **config}, {"rate": 0.25, "error": 1.5},
    )  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two runs of one study, one of another, and one without a recording."""
    logs = tmp_path_factory.mktemp("logs")
    record(logs / "a", [0.5, 0.25, 1.0])
    record(logs / "b", [2.0, 3.0, 4.0])
    record(logs / "other", [7.0, 8.0, 9.0], (Panel("map", "Way", ("room",)), Panel("plot", "Far", ("bands/low",))))
    (logs / "bare").mkdir()
    return logs


@pytest.fixture
def runs(logs):
    return KnownRuns(
        a=summary(logs / "a"),
        b=summary(logs / "b", descriptor="hog", state="killed"),
        other=summary(logs / "other", study="trajectory"),
        bare=summary(logs / "bare", state="failed"),
    )


@pytest.fixture
def shown(monkeypatch, read, tmp_path):
    """What the viewer is given: the merged recording, and its header and layout."""
    found = []

    def show(*recordings):
        found.extend(read(Path(shutil.copy(recording, tmp_path))) for recording in recordings)

    monkeypatch.setattr(several, "show", show)
    return found


@pytest.fixture
def view(runs):
    commands = {}
    omnilab_rerun.register_commands(commands.__setitem__, runs)
    return lambda *argv: commands["view"](list(map(str, argv)))


def text_of(recording):
    return recording.rows("/omnilab_view", "TextDocument:text")[0][0]


def views(recording):
    """Kind, rules and legend's visibility of each view, by name."""
    parts = {}
    for path, values in recording.blueprint():
        parts.setdefault(path, {}).update(values)
    found = {}
    for path, part in parts.items():
        if kind := part.get("ViewBlueprint:class_identifier"):
            rules = parts[f"{path}/ViewContents"]["ViewContents:query"][0]
            found[part["ViewBlueprint:display_name"][0][0]] = (kind[0][0], rules)
    return found


def test_each_run_lies_under_its_name_on_the_same_steps(view, logs, shown):
    assert view(logs / "a", logs / "b") == 0
    merged, _ = shown
    for name, values in ("/radon", [0.5, 0.25, 1.0]), ("/hog", [2.0, 3.0, 4.0]):
        assert merged.rows(f"{name}/error/position_m", "step") == [0, 1, 2]
        assert merged.rows(f"{name}/error/position_m", "Scalars:scalars") == [[value] for value in values]
        assert merged.rows(f"{name}/signature", "step") == [0, 2]
        assert merged.is_static(f"{name}/room")
    assert {chunk.entity_path.split("/")[1] for chunk in merged.chunks} == {"radon", "hog"}
    stores = {entry.recording_id for recording in shown for entry in recording.reader.recordings()}
    assert len(stores) == 1, "both parts are one recording"


def test_a_run_has_one_name_and_colour_everywhere(view, logs, shown):
    view(logs / "a", logs / "b")
    _, looks = shown
    colors = [red << 24 | green << 16 | blue << 8 | 255 for red, green, blue in RUNS.values()]
    for name, color in zip(("radon", "hog"), colors, strict=False):
        assert looks.rows(f"/{name}/error/position_m", "SeriesLines:names") == [[name]]
        assert looks.rows(f"/{name}/bands/low", "SeriesLines:names") == [[f"{name}: low"]]
        for part in ("error/position_m", "bands/low", "bands/high"):
            assert looks.rows(f"/{name}/{part}", "SeriesLines:colors") == [[color]]
        assert looks.rows(f"/{name}/frame", "LineStrips3D:colors") == [[color]]
        (frame,) = looks.rows(f"/{name}/frame", "LineStrips3D:strips")[0]
        assert np.ptp(frame, axis=0).tolist() == [10, 8, 0], "around the room"


def test_a_saved_recording_holds_the_runs_and_their_layout(view, logs, read, tmp_path, capsys):
    assert view(logs / "a", logs / "b", "--save", tmp_path / "both.rrd") == 0
    assert f"the merged recording is {tmp_path / 'both.rrd'}" in capsys.readouterr().err
    saved = read(tmp_path / "both.rrd")
    assert len(saved.reader.recordings()) == 1
    assert saved.rows("/hog/error/position_m", "Scalars:scalars") == [[2.0], [3.0], [4.0]]
    assert saved.rows("/hog/error/position_m", "SeriesLines:names") == [["hog"]]
    assert {"Runs", "Position error [m]", "radon: Room", "hog: Room"} <= views(saved).keys()
    with pytest.raises(ConfigError, match=r"both\.png would be a recording by another name; give \S+both\.rrd"):
        view(logs / "a", logs / "b", "--save", tmp_path / "both.png")
    assert [path.name for path in tmp_path.iterdir()] == ["both.rrd"]


def test_maps_side_by_side_and_a_plot_for_each_error(view, logs, shown):
    view(logs / "a", logs / "b")
    found = views(shown[1])
    assert {name: kind for name, (kind, _) in found.items()} == {
        "Runs": "TextDocument", "Position error [m]": "TimeSeries", "Bands [m]": "TimeSeries",
        "radon: Room": "3D", "hog: Room": "3D",
    }  # fmt: skip
    assert found["Position error [m]"][1] == ["+ /radon/error/position_m/**", "+ /hog/error/position_m/**"]
    assert {"+ /hog/room/**", "+ /hog/places/**", "+ /hog/frame"} <= set(found["hog: Room"][1])
    targets = [v["EyeControls3D:look_target"] for _, v in shown[1].blueprint() if "EyeControls3D:look_target" in v]
    np.testing.assert_allclose(np.reshape(targets, (2, 3)), [[0, 0, 1.5]] * 2)


def test_the_header_says_what_differs_and_how_the_runs_ended(view, logs, shown):
    view(logs / "a", logs / "b")
    lines = text_of(shown[1]).splitlines()
    assert lines[0] == "| run | color | descriptor | rate | error | status | folder |"
    assert lines[2] == "| **radon** | blue | radon | 0.25 | 1.5 | done | a |"
    assert lines[3] == "| **hog** | orange | hog | 0.25 | 1.5 | killed | b |"
    assert f"`{logs}`" in lines[-1]


def test_runs_of_different_studies_show_what_they_share_and_say_the_rest(view, logs, shown, capsys):
    view(logs / "a", logs / "b", logs / "other")
    told = capsys.readouterr().err
    assert "of different studies (grid, trajectory): what they share is shown" in told
    assert "of trajectory radon no plot shows Far; view it alone" in told
    assert "trajectory radon: Way" in views(shown[1])


@pytest.mark.parametrize("laid_out", [True, False])
def test_a_run_that_has_not_come_to_its_errors_yet_takes_no_plot_from_the_others(
    view, logs, runs, shown, tmp_path, laid_out
):
    (tmp_path / "young").mkdir()
    sink = RerunSink()
    sink.open(tmp_path / "young")
    sink.write("room", ROOM, None)
    if laid_out:
        sink.write("", ViewLayout([PANELS]), None)
    sink.write("signature", Signature(np.ones((2, 2), np.float32)), Tick(0, 0))
    sink.close()
    runs.runs["young"] = summary(tmp_path / "young", descriptor="hog", state="running")
    view(logs / "a", tmp_path / "young")
    found = views(shown[1])
    assert {"Position error [m]", "Bands [m]", "radon: Room", "hog: Room"} <= found.keys()
    assert "+ /hog/frame" in found["hog: Room"][1]


def test_runs_without_any_layout_have_a_map_and_a_plot_for_each_curve(view, runs, shown, tmp_path):
    for name, descriptor in ("x", "radon"), ("y", "hog"):
        record(tmp_path / name, [1.0, 2.0, 3.0], ())
        runs.runs[name] = summary(tmp_path / name, descriptor=descriptor)
    view(tmp_path / "x", tmp_path / "y")
    plots = {"error/position_m [m]", "bands/low [m]", "bands/high [m]"}
    assert plots | {"Runs", "radon: Map", "hog: Map"} == views(shown[1]).keys()


def test_a_run_without_a_recording_is_left_out_and_named(view, logs, shown, capsys):
    view(logs / "a", logs / "bare", logs / "b")
    assert f"{logs / 'bare'} has no run.rrd and is left out; run it with the sink rerun" in capsys.readouterr().err
    assert {chunk.entity_path.split("/")[1] for chunk in shown[0].chunks} == {"radon", "hog"}


def test_what_cannot_be_shown_is_refused(view, logs, monkeypatch, shown):
    with pytest.raises(ConfigError, match=r"a is given twice; give each run once"):
        view(logs / "a", logs / "b", logs / "b" / ".." / "a")
    with pytest.raises(ConfigError, match=r"9 runs are more than can be told apart; give up to 8, such as \S+0 \S+1"):
        view(*(logs / str(i) for i in range(9)))
    monkeypatch.setattr(several, "FILE", "none.rrd")
    with pytest.raises(DataError, match=r"none of the 2 runs has a recording; run the experiments with the sink rerun"):
        view(logs / "a", logs / "b")
    assert shown == []


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_recording_that_cannot_be_read_is_named(view, logs, runs, tmp_path):
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "run.rrd").write_bytes((logs / "a" / "run.rrd").read_bytes()[:20])
    runs.runs["torn"] = summary(tmp_path / "torn")
    with pytest.raises(DataError, match=r"torn/run\.rrd cannot be read back; mend it: omnilab repair .*torn"):
        view(logs / "a", tmp_path / "torn")


def test_a_full_disk_is_told_before_anything_is_written(view, logs, monkeypatch, shown):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10}))
    with pytest.raises(DataError, match=r"together take 0 MB, and \S+ has room for 0; set TMPDIR"):
        view(logs / "a", logs / "b")


def test_a_sweep_is_its_jobs_by_number_without_earlier_attempts(logs, tmp_path):
    for name in ("10", "9", "attempts/9", "x"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "status.json").write_text("{}")
    (tmp_path / "8").mkdir()
    from omnilab_rerun.view_command import jobs_of

    assert jobs_of(tmp_path) == [tmp_path / "9", tmp_path / "10"]
    assert jobs_of(logs / "a") == [logs / "a"]
    assert jobs_of(tmp_path / "none") == [tmp_path / "none"]


def test_a_step_that_none_of_them_has_is_refused(view, logs, tmp_path):
    with pytest.raises(ConfigError, match=r"the merged recording has no step 7; it has 0 to 2"):
        view(logs / "a", logs / "b", "--screenshot", tmp_path / "p.png", "--step", 7)


def test_settings_of_a_component_that_differs_itself_are_left_out_unless_given():
    one = RunSummary(Path("1"), "done", "x", ["descriptor.angles=45"], {"descriptor": "radon"}, {"descriptor": {"angles": 45, "rows": 3}, "sinks": {"rerun": 1}, "seed": 1})  # fmt: skip
    two = RunSummary(
        Path("2"), "done", "x", [], {"descriptor": "hog"}, {"descriptor": {"cells": 2}, "cache": "c", "seed": 1}
    )
    assert differences([one, two]) == {"descriptor": ["radon", "hog"], "descriptor.angles": ["45", "-"]}


@pytest.mark.parametrize(
    ("different", "folders", "names"),
    [
        ({"descriptor": ["radon", "hog"], "distance": ["poc", "l2"]}, "ab", ["radon", "hog"]),
        ({"study.step_m": ["1", "1"], "seed": ["0", "1"]}, "ab", ["seed=0", "seed=1"]),
        ({}, "ab", ["a", "b"]),
        ({"sensor.path": ["x" * 40, "y" * 40]}, ["s/0", "t/0"], ["s/0", "t/0"]),
        ({}, ["s/0", "p/s/0"], ["1 s/0", "2 s/0"]),
    ],
)
def test_short_names(different, folders, names):
    runs = [RunSummary(Path(folder), "done", components={"descriptor": "x"}) for folder in folders]
    assert short_names(runs, different) == names


@pytest.mark.slow
def test_the_picture_shows_every_run_in_its_colour(view, logs, tmp_path):
    import cv2

    try:
        view(logs / "a", logs / "b", "--screenshot", tmp_path / "p.png")
    except DataError as error:
        if re.search("Vulkan", str(error)):
            pytest.skip(str(error))
        raise
    pixels = cv2.imread(str(tmp_path / "p.png"))[..., ::-1].astype(int)
    for color in list(RUNS.values())[:2]:
        assert (np.abs(pixels - color).max(-1) < 30).sum() > 500
    assert RrdReader(logs / "a" / "run.rrd").recordings(), "and left the runs alone"
