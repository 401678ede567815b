"""The study `room`, virtual and on a folder in the format of the Bielefeld sets."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]
SMALL = ["study.query_count=5", "study.starts=3", "study.show=1", "descriptors.poc=null", "distances.poc=null"]
SIZES = [f"descriptors.{name}.{size}" for name in ("poc_band", "radon_gist") for size in ("offsets=48", "angles=60")]
RADON = ["descriptor.offsets=48", "descriptor.angles=60"]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("room")


def check_maps(folder, places):
    rows = load_run(folder).table("local_maps")
    assert {(row["method"], row["localizer"]) for row in rows} == {
        (name, maker) for name in ("poc_band", "radon_gist") for maker in ("spring", "smacof")
    }
    assert {row["places"] for row in load_run(folder).table("times")} == {str(places)}
    assert all(0 < float(row["median_m"]) <= float(row["p95_m"]) for row in rows)
    starts = [
        row for row in load_run(folder).table("errors") if (row["method"], row["localizer"]) == ("poc_band", "spring")
    ]
    assert len({row["error_m"] for row in starts}) > 5, "other starts, other maps"
    return rows


def test_with_and_without_occlusion(omnilab_at, here):
    arguments = [
        "-m",
        "experiment=room",
        "study.side=4",
        "study.steps_m=[0.25]",
        "disturbances.occlusion.fraction=0,0.3",
    ]
    result = omnilab_at(here, *arguments, *SMALL, *SIZES, *RADON, *SENSOR)
    assert result.rc == 0, result.stderr
    (sweep,) = (here / "logs" / "room").iterdir()
    clear, occluded = (check_maps(sweep / job, 16) for job in ("0", "1"))
    assert [row["median_m"] for row in clear] != [row["median_m"] for row in occluded]


@pytest.fixture(scope="module")
def recorded(omnilab_at, here):
    """Places and tests in two folders, hand-made: the places named by column and row, the tests by position."""
    for name, arguments in {
        "places": ["study.step_m=0.3", "study.extent_m=[0.9, 0.9]"],
        "tests": ["study.layout=random", "study.count=6", "study.extent_m=[0.9, 0.9]"],
    }.items():
        assert omnilab_at(here, "experiment=render", f"study.folder={here / name}", *arguments, *SENSOR).rc == 0
    rows = list(csv.DictReader((here / "places/positions.csv").read_text().splitlines()))
    x, y = (np.array([float(row[axis]) for row in rows]) for axis in ("x_m", "y_m"))
    column, line = (np.rint((a - a.min()) / 0.3).astype(int) for a in (x, y))
    (here / "original").mkdir()
    for row, i, j in zip(rows, column, line, strict=True):
        shutil.copy(here / "places" / row["image"], here / "original" / f"pos_{i}_{j}.png")
    return len(rows)


def test_on_a_folder_in_the_format_of_bielefeld(omnilab_at, here, recorded):
    """The queries are the images beside every second row and column."""
    arguments = [
        "experiment=recorded_room",
        f"sensor.path={here / 'original'}",
        "sensor.names=bielefeld",
        "study.every=2",
    ]
    result = omnilab_at(here, *arguments, "study.neighbours=[4]", *SMALL, *SIZES, *RADON)
    assert result.rc == 0, result.stderr
    rows = check_maps((here / "logs" / "latest").resolve(), 4)
    assert {row["step_m"] for row in rows} == {"0.6"}


def test_with_queries_of_another_folder(omnilab_at, here, recorded):
    arguments = ["experiment=recorded_room", f"sensor.path={here / 'places'}", f"+study.tests.path={here / 'tests'}"]
    result = omnilab_at(here, *arguments, *SMALL, *SIZES, *RADON)
    assert result.rc == 0, result.stderr
    check_maps((here / "logs" / "latest").resolve(), recorded)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["study.every=0"], "study.every=0 is out of range"),
        (["study.every=null", "+study.tests.path=x"], "a virtual room takes no tests"),
        (["study.every=1"], "leaves no queries"),
        (["+study.tests.folder=x"], "changes 'folder', which is no setting of the sensor"),
        (["study.neighbours=[99]"], "give fewer neighbours"),
    ],
)
def test_what_makes_no_room(omnilab_at, here, recorded, arguments, told):
    result = omnilab_at(here, "experiment=recorded_room", f"sensor.path={here / 'places'}", *SMALL, *arguments)
    assert result.rc == 2
    assert told in result.stderr
