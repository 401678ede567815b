"""Mistakes of a user: exit code 2 and one line that names the value and what fixes it, never a traceback."""

from __future__ import annotations

import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.runner.run_folder import load_run

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = [
    "experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=64", "sensor.samples=1", "descriptor.offsets=32",
    "descriptor.angles=60", "study.step_m=1.5", "study.query_count=4", "study.show=1",
]  # fmt: skip
STAGE = re.compile(r"places +\d+ in [\d.]+ s")  # what the console says of a stage that went well


@pytest.fixture
def refused(omnilab_here):
    """`refused(*arguments)`: the sentence on standard error, after checks that it is the only one and ends with rc 2."""

    def refused(*arguments):
        result = omnilab_here(*arguments)
        assert result.rc == 2, result
        assert result.stdout == ""
        lines = [line for line in result.stderr.splitlines() if not STAGE.fullmatch(line)]
        assert len(lines) == 1, result.stderr
        assert lines[0].startswith("omnilab: ")
        return lines[0].removeprefix("omnilab: ")

    return refused


# --------------------------------------------------------------------------------------------- names and values
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["descriptor=radom"], ["descriptor 'radom'", "there is fourier_phase, fourier_signature, gist", "did you mean descriptor=radon?"]),
        (["sensor=webcam"], ["sensor 'webcam'", "folder", "mirror"]),
        (["distance=poc_bnd"], ["'poc_bnd'", "euclidean", "did you mean distance=poc_band?"]),
        (["study="], ["study ''", "there is altitude, catchment, changes, cost"]),
        (["experiment=quickstrat"], ["experiment 'quickstrat'", "recorded_grid", "did you mean experiment=quickstart?"]),
        (["study.stp_m=1"], ["'study.stp_m'", "Grid", "did you mean step_m?"]),
        (["descriptor.angels=45"], ["'descriptor.angels'", "Radon", "did you mean angles?"]),
        (["speed=3"], ["'speed'", "there is sensor, descriptor", "did you mean seed?"]),
        (["sinks.rerum.live=true"], ["rerum"]),
        (["study.step_m=wide"], ["study.step_m=wide", "a number or null"]),
        (["study.query_count=2.5"], ["study.query_count=2.5", "a whole number"]),
        (["study.queries=some"], ["study.queries=some", "random", "rest"]),
        (["sensor.color=maybe"], ["sensor.color=maybe", "true or false"]),
        (["study.extent_m=[1,two]"], ["two", "a list such as [1.0,2.0]"]),
        (["study.extent_m=[1]"], ["study.extent_m=[1.0]", "2 numbers above 0"]),
        (["study.step_m=-1"], ["study.step_m=-1", "above 0"]),
        (["study.step_m=null"], ["study.step_m=None", "study.every=None", "one of them"]),
        (["study.query_count=0"], ["study.query_count=0", "from 1 to 1000000"]),
        (["sensor.samples=3"], ["samples=3", "square"]),
        (["sensor.crop=2"], ["crop=2", "up to 1"]),
        (["sinks.rerun.port=99999"], ["port=99999", "65535"]),
        (["disturbance=blurr"], ["disturbance 'blurr'", "did you mean disturbance=blur?"]),
        (["+disturbance=blur"], ["give disturbance=NAME without the +"]),
        (["+disturbances.dust.level=1"], ["disturbances.dust is plain YAML", "+disturbance@disturbances.dust=blur"]),
        (["disturbance=occlusion", "disturbances.occlusion.fraction=10"], ["fraction=10", "from 0 to 1"]),
        (["threads=0"], ["threads=0", "from 1 to 256"]),
        (["threads=many"], ["threads=many", "a whole number"]),
        (["seed=-1"], ["seed=-1", "from 0 to"]),
        (["cache_gb=0"], ["cache_gb=0", "above 0", "a number above 0"]),
        (["descriptor=null"], ["null", "~descriptor"]),
        (["~descriptor"], ["needs a descriptor", "descriptor=fourier_phase|fourier_signature|gist", "|radon|"]),
        (["~localizer"], ["needs a localizer", "localizer=bayes_filter|gower|hierarchical", "|nearest|"]),
        (["sensor.size=[1"], ["[1"]),
        (["study.step_m"], ["study.step_m"]),
        (["experiment=recorded_grid"], ["sensor.path", "sensor.path=VALUE"]),
    ],
    ids=lambda value: " ".join(value) if len(value) == 1 else "",
)  # fmt: skip
def test_settings(refused, tmp_path, arguments, told):
    sentence = refused(*arguments)
    for words in told:
        assert words in sentence
    assert not [file for file in tmp_path.rglob("*") if file.is_file()], "nothing ran, so nothing is left behind"


@pytest.mark.parametrize("word", ["run", "plugin", "help", "screenshot"])
def test_commands(refused, word):
    sentence = refused(word)
    assert f"'{word}' is no command" in sentence
    assert "plugins, new, runs, repeat, repair, " in sentence
    assert ", view, " in sentence


def test_a_mistake_in_a_sweep_is_told_before_it_starts(refused, tmp_path):
    assert "'study.stp_m'" in refused("-m", "study.stp_m=1,2")
    assert not list(tmp_path.rglob("metrics.csv"))


# --------------------------------------------------------------------------------------------- worlds
def face(corners, texture="brick"):
    textures = "{brick: {kind: plain, color: [9, 9, 9]}}"
    return f"map_m: [4, 3]\ntextures: {textures}\nobjects:\n- {{kind: face, corners: [{corners}], texture: {texture}}}"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("map_m: [4, 3]\nobjects: [{kind: rom, size: [6, 5, 3]}]", ["line 2", "object 1", "'rom'", "room"]),
        ("map_m: [4, 3]\nobjects:\n- {kind: room, size: [6, 5], floor: a, ceiling: a, north: a, south: a, east: a, west: a}",
         ["line 3", "object 1", "size=[6, 5]", "3 finite numbers"]),
        (face("[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]"), ["line 4", "object 1", "one plane"]),
        (face("[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]"), ["line 4", "object 1", "on a line"]),
        (face("[0, 0, 0], [1, 0, 0], [1, 1, 0]"), ["line 4", "object 1", "4 corners, not 3"]),
        (face("[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, .nan]"), ["line 4", "object 1", "finite numbers"]),
        (face("[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]", "brik"), ["line 4", "'brik'", "did you mean 'brick'?"]),
        ("map_m: [4, 3]\nobjects: []", ["world", "face"]),
        ("objects: []", ["map_m", "add it"]),
        ("map_m: [4, 3\n", ["line 2", "YAML"]),
        ("", ["is empty", "map_m"]),
        ("a: &a [1]\nb: *a", ["line 2", "alias"]),
    ],
    ids=["kind", "size", "skew", "flat", "triangle", "nan", "texture", "no face", "no map", "no YAML", "empty", "alias"],
)  # fmt: skip
def test_worlds(refused, tmp_path, text, told):
    file = tmp_path / "world.yaml"
    file.write_text(text)
    sentence = refused(*SMALL, f"sensor.world={file}")
    for words in (str(file), *told):
        assert words in sentence


def test_a_world_that_does_not_exist(refused, tmp_path):
    sentence = refused(*SMALL, "sensor.world=rooom")
    assert "'rooom'" in sentence
    assert "did you mean 'room'?" in sentence
    run = load_run(tmp_path / "logs" / "latest")
    assert run.state == "failed"
    assert "'rooom'" in run.status["error"]


# --------------------------------------------------------------------------------------------- recorded folders
@pytest.fixture
def recording(tmp_path):
    """A folder of 5 x 3 smooth pictures on a grid of 0.5 m, with its positions file."""
    folder = tmp_path / "images"
    folder.mkdir()
    rng = np.random.default_rng(2)
    lines = ["image,x_m,y_m,yaw_deg"]
    for i in range(15):
        picture = cv2.resize(rng.integers(0, 255, (9, 9), dtype=np.uint8), (64, 64), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{i:02d}.png"), picture)
        lines.append(f"{i:02d}.png,{i % 5 / 2},{i // 5 / 2},0")
    (folder / "positions.csv").write_text("\n".join(lines) + "\n")
    return folder


def recorded(folder):
    return [
        "experiment=recorded_grid", f"sensor.path={folder}", "sensor.circle_px=[31.5,31.5,32]", "study.show=1",
        "descriptor.offsets=32", "descriptor.angles=60",
    ]  # fmt: skip


def test_a_folder_that_does_not_exist(refused, tmp_path):
    sentence = refused(*recorded(tmp_path / "nowhere"))
    assert f"the folder {tmp_path / 'nowhere'} does not exist" in sentence
    assert "sensor.path=DIR" in sentence


def test_an_empty_folder(refused, tmp_path):
    (tmp_path / "empty").mkdir()
    sentence = refused(*recorded(tmp_path / "empty"))
    assert str(tmp_path / "empty") in sentence
    assert "holds no image" in sentence


def truncate(file):
    file.write_bytes(file.read_bytes()[:-40])


def overwrite(file):
    file.write_text("this is no picture")


@pytest.mark.parametrize("damage", [truncate, overwrite])
@pytest.mark.parametrize("name", ["06.png", "12.png"], ids=["query", "place"])
def test_a_bad_image_among_good_ones_is_named(refused, recording, damage, name):
    damage(recording / name)
    sentence = refused(*recorded(recording))
    assert name in sentence
    assert "sensor.on_bad_image=skip" in sentence


@pytest.mark.slow
def test_bad_images_are_skipped_and_counted(omnilab_here, recording, tmp_path):
    truncate(recording / "06.png")
    overwrite(recording / "12.png")
    result = omnilab_here(*recorded(recording), "sensor.on_bad_image=skip")
    assert result.rc == 0, result.stderr
    run = load_run(tmp_path / "logs" / "latest")
    assert run.metrics["left_out"] == 2
    assert run.metrics["places"] == 6 - 1
    assert run.metrics["queries"] == 9 - 1
    assert "06.png" not in {row["key"] for row in run.table("queries")}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("06.png,", "66.png,", ["names 1 images that are not there (66.png)", "does not name 1 that are (06.png)"]),
        ("06.png,0.5,0.5,0\n", "", ["does not name 1 that are (06.png)"]),
        ("06.png,0.5,", "06.png,nan,", ["line 8", "x_m='nan'", "finite number"]),
        ("06.png,0.5,", "06.png,east,", ["line 8", "x_m='east'", "finite number"]),
        ("06.png,0.5,", "06.png,", ["line 8", "3 values for 4 columns"]),
        ("06.png,", "05.png,", ["line 8", "names 05.png again", "line 7"]),
        ("x_m,y_m", "x,y_m", ["has a column 'x'", "write x_m (in metres)"]),
    ],
)
def test_positions_that_do_not_match(refused, recording, old, new, told):
    file = recording / "positions.csv"
    assert file.read_text().count(old) == 1
    file.write_text(file.read_text().replace(old, new))
    sentence = refused(*recorded(recording))
    for words in (str(file), *told):
        assert words in sentence


def test_no_positions(refused, recording):
    (recording / "positions.csv").unlink()
    sentence = refused(*recorded(recording))
    assert "15 images without positions" in sentence
    assert "positions.csv" in sentence


# --------------------------------------------------------------------------------------- what a sensor cannot deliver
def test_a_recording_has_no_random_poses(refused, recording):
    sentence = refused(*recorded(recording), "study.queries=random")
    assert "15 images on a" in sentence
    assert "none at random poses" in sentence
    assert "study.queries=rest" in sentence


def test_a_virtual_sensor_has_no_rows(refused):
    sentence = refused(*SMALL, "study.step_m=null", "study.every=2")
    assert "step_m" in sentence
    assert "every" in sentence


def test_a_virtual_sensor_has_recorded_nothing(refused):
    assert "recorded nothing" in refused(*SMALL, "study.queries=rest")


# --------------------------------------------------------------------------------------- folders of runs
@pytest.mark.parametrize("mode", [[], ["-m"]], ids=["alone", "sweep"])
def test_logs_below_a_file(refused, tmp_path, mode):
    (tmp_path / "file").write_text("in the way")
    sentence = refused(*mode, *SMALL, f"logs={tmp_path / 'file' / 'logs'}")
    assert str(tmp_path / "file" / "logs") in sentence
    assert "logs=DIR" in sentence


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_logs_without_permission(refused, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    assert "Permission denied" in refused(*SMALL, f"logs={tmp_path / 'locked'}")


@pytest.mark.parametrize("command", ["view", "repeat", "repair"])
@pytest.mark.parametrize("name", ["nowhere", "empty", "logs/latest"])
def test_commands_on_what_is_no_run(refused, tmp_path, command, name):
    (tmp_path / "empty").mkdir()
    arguments = [] if name == "logs/latest" else [name]  # the default
    sentence = refused(command, *arguments)
    assert f"{name} holds no run" in sentence
    assert "omnilab runs" in sentence


@pytest.mark.parametrize("command", ["view", "repeat", "repair"])
@pytest.mark.parametrize("text", ["", "{", "]"])
def test_commands_on_a_damaged_run(refused, tmp_path, command, text):
    (tmp_path / "status.json").write_text(text)
    sentence = refused(command, str(tmp_path))
    assert str(tmp_path) in sentence
    assert "cannot be read" in sentence


def test_a_job_that_was_never_built_cannot_be_repeated(omnilab_here, refused, tmp_path):
    assert omnilab_here("-m", *SMALL, "study.step_m=-1").rc == 1
    (job,) = (tmp_path / "logs" / "quickstart").glob("*/0")
    sentence = refused("repeat", str(job))
    assert "study.step_m=-1 is out of range" in sentence


@pytest.mark.slow
def test_a_run_without_a_recording_cannot_be_viewed(omnilab_here, refused):
    assert omnilab_here(*SMALL, "~sink@sinks.rerun").rc == 0
    sentence = refused("view", "logs/latest")
    assert "run.rrd does not exist" in sentence
    assert "sink rerun" in sentence


@pytest.mark.slow
def test_a_damaged_file_of_a_run_is_named_and_hides_no_other_run(omnilab_here, refused, tmp_path):
    for _ in range(2):
        assert omnilab_here(*SMALL, "~sinks.rerun", "~sinks.mcap").rc == 0
    damaged = (tmp_path / "logs/latest").resolve()
    for file, text in [
        ("status.json", "[]"),
        ("manifest.json", "{}"),
        ("config.yaml", "a: [unclosed"),
        ("config.yaml", "sensor: {}"),
        ("metrics.csv", "metric,value,unit\nnearest_rate,much,1\n"),
        ("metrics.csv", "name\nnearest_rate\n"),
    ]:
        whole = (damaged / file).read_text()
        (damaged / file).write_text(text)
        if file in ("manifest.json", "config.yaml"):
            assert file in refused("repeat", str(damaged))
        listed = omnilab_here("runs")
        assert listed.rc == 0
        assert listed.stdout.count("nearest_rate") >= 1
        assert ("unreadable" in listed.stdout) == (file != "config.yaml")  # which is not needed for the list
        (damaged / file).write_text(whole)


def test_settings_that_do_not_exist_are_refused_after_a_plus_too(refused):
    assert "'study.colour' is not a setting" in refused(*SMALL, "+study.colour=red")
    assert "'speed' is not a setting" in refused(*SMALL, "+speed=3")
    assert "'sinks.console.x' is not a setting" in refused(*SMALL, "+sinks.console.x=1")


@pytest.mark.slow
def test_a_saved_run_that_no_longer_fits_is_told(omnilab_here, refused, tmp_path):
    assert omnilab_here(*SMALL, "~sinks.rerun", "~sinks.mcap").rc == 0
    config = tmp_path / "logs/latest/config.yaml"
    config.write_text(config.read_text().replace("offsets:", "ofsets:"))
    assert "no longer fits Radon" in refused("repeat")


def test_runs_of_a_folder_that_does_not_exist(refused):
    assert "there is no folder nowhere" in refused("runs", "nowhere")


@pytest.mark.slow
def test_a_sweep_over_experiments_has_one_folder(omnilab_here, tmp_path):
    rest = [o for o in SMALL if not o.startswith("experiment=")]
    done = omnilab_here("-m", *rest, "experiment=quickstart,grid", "~sinks.rerun", "~sinks.mcap")
    assert done.rc == 0
    (summary,) = (tmp_path / "logs").rglob("summary.csv")
    assert sorted(job.name for job in summary.parent.iterdir() if job.is_dir()) == ["0", "1"]
