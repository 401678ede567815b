"""The comparing studies as whole runs: one command, one table, the same figures again, records in both logs."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from mcap.reader import make_reader

pytestmark = pytest.mark.slow  # whole runs, each in a process of its own

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = (f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1", "study.side=4", "study.query_count=16")
ROBUSTNESS = (
    "experiment=robustness", *SMALL, "descriptors.radon.offsets=48", "descriptors.radon.angles=60",
    "descriptors.sift.features=60", "descriptors.gist=null",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "logs/latest"


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def topics(folder):
    with (folder / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    return {channel.topic for channel in summary.channels.values()}


def test_robustness_is_one_command(omnilab_here, folder):
    done = omnilab_here(*ROBUSTNESS, "~sinks.rerun")
    assert done.rc == 0, done.stderr
    assert "radon_area " in done.stdout
    table = {row["method"]: row for row in rows(folder / "robustness.csv")}
    assert list(table) == ["radon", "fourier_signature", "sift", "hog"]
    levels = rows(folder / "levels.csv")
    assert len(levels) == len(table) * (1 + 5 * 3)
    clear = [float(row["nearest_rate"]) for row in levels if row["disturbance"] == "clear"]
    assert clear[0] > 0.5, "guesses would find one in sixteen"
    assert all(0.1 < float(row["sharpness"]) < 1 for row in table.values())
    assert {f"{name}.png" for name in ("pictures", "rates", "sharpness", "surfaces", "pareto")} <= {
        path.name for path in folder.resolve().iterdir()
    }
    assert any("nearest" in topic and "radon" in topic for topic in topics(folder))
    repeated = omnilab_here("repeat", str(folder.resolve()))
    assert repeated.rc == 0
    assert "the metrics are the same" in repeated.stderr


def test_robustness_on_a_recording_that_one_setting_declares_equirectangular(omnilab_here, folder, tmp_path):
    sphere = ("sensor=equirectangular", f"sensor.world={WORLD}", "sensor.width=128", "sensor.height=64")
    off = ("~sinks.rerun", "~sinks.mcap")
    assert omnilab_here("experiment=render", *sphere, "study.folder=set", "study.step_m=0.6", *off).rc == 0
    (tmp_path / "set/camera.json").unlink()
    images = len(list((tmp_path / "set/images").iterdir()))
    few = ("~descriptors.sift", "~descriptors.gist", "~descriptors.hog", "study.query_count=12", "disturbance=blur")
    recording = ("sensor.path=set", "sensor.panorama=equirectangular")
    done = omnilab_here("experiment=recorded_robustness", *recording, *few, *off)
    assert done.rc == 0, done.stderr
    levels = rows(folder / "levels.csv")
    assert float(levels[0]["nearest_rate"]) > 0.7
    assert images > 40
    refused = omnilab_here(
        "experiment=robustness", "sensor=folder", *recording, "study.step_m=0.6", "study.side=2", *off
    )
    assert refused.rc == 2
    assert "of robustness study.every=2" in refused.stderr  # which the run above gives


def test_each_batch_size_gives_the_same_rates(omnilab_here, folder):
    found = []
    for batch in (64, 7):
        done = omnilab_here(
            *ROBUSTNESS, f"sensor.batch={batch}", "disturbance=occlusion", "~sinks.rerun", "~sinks.mcap"
        )
        assert done.rc == 0, done.stderr
        found.append([row["nearest_rate"] for row in rows(folder / "levels.csv")])
    assert found[0] == found[1]


def test_resolution_is_one_command(omnilab_here, folder):
    done = omnilab_here("experiment=resolution", *SMALL, "study.sizes=[[64,60],[32,30],[12,6]]", "~sinks.rerun")
    assert done.rc == 0, done.stderr
    table = rows(folder / "resolution.csv")
    assert len(table) == 3 * 2 * 2  # sizes, distances, kinds of headings
    of = {(row["size"], row["distance"], row["headings"]): row for row in table}
    assert float(of["64 x 60", "poc_band", "on_grid"]["nearest_rate"]) > 0.5, "guesses would find one in sixteen"
    coarse = [float(of["12 x 6", "poc_band", h]["heading_error_median_deg"]) for h in ("on_grid", "any")]
    assert coarse[0] < coarse[1]
    assert "smallest_angles_poc_any" in done.stdout
    assert any("nearest" in topic for topic in topics(folder))


def test_a_strength_that_cannot_be_is_one_sentence(omnilab_here):
    done = omnilab_here(*ROBUSTNESS, "study.levels.occlusion.fraction=[0.1,2]", "~sinks.rerun", "~sinks.mcap")
    assert done.rc != 0
    assert "fraction=2" in done.stderr
    assert "Traceback" not in done.stderr
