"""The study `changes`, in a virtual world and on folders in the format of the Bielefeld sets."""

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
SMALL = ["experiment=changes", "study.query_count=12", "study.step_m=0.5", *SENSOR]
RADON = [f"descriptors.{name}.{size}" for name in ("poc", "radon") for size in ("offsets=48", "angles=60")]
RADON += ["descriptors.radon_gist=null"]
OFF = [f"~study.conditions.{name}" for name in ("evening", "lamp_off", "moved", "crowded")]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("changes")


@pytest.fixture(scope="module")
def run(omnilab_at, here):
    conditions = ["+study.conditions.raised={height_m: 1.2}", "+study.conditions.same={samples: 1}"]
    result = omnilab_at(here, *SMALL, *RADON, *OFF, *conditions)
    assert result.rc == 0, result.stderr
    return (here / "logs" / "latest").resolve()


def test_a_row_for_every_method_in_every_condition(run):
    rows = load_run(run).table("changes")
    assert [(row["method"], row["condition"]) for row in rows] == [
        (name, condition)
        for condition in ("unchanged", "raised", "same")
        for name in ("poc", "radon", "fourier_signature")
    ]
    for row in rows:
        rates = [float(row[f"{verdict}_rate"]) for verdict in ("nearest", "second", "wrong")]
        assert sum(rates) == pytest.approx(1)
        assert float(row["nearest_or_second_rate"]) == pytest.approx(rates[0] + rates[1])
        assert float(row["nearest_low"]) <= rates[0] <= float(row["nearest_high"])
        assert int(row["queries"]) == 12


def test_a_condition_that_changes_nothing_is_answered_alike(run):
    rows = {(row["method"], row["condition"]): row for row in load_run(run).table("changes")}
    for name in ("poc", "radon", "fourier_signature"):
        same, unchanged = (
            {key: value for key, value in rows[name, condition].items() if key != "condition"}
            for condition in ("same", "unchanged")
        )
        rates = [key for key in same if key.endswith(("_rate", "_m", "_deg"))]
        assert {key: same[key] for key in rates} == {key: unchanged[key] for key in rates}


def test_what_is_left_behind(run):
    assert {"changes.png", "pictures.png", "run.rrd", "run.mcap"} <= {file.name for file in run.iterdir()}
    metrics = load_run(run).metrics
    worst = min(metrics["radon_raised_nearest_rate"], metrics["radon_same_nearest_rate"])
    assert metrics["radon_nearest_rate_worst"] == worst


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["+study.conditions.dim={lamp: 2}"], "changes 'lamp', which is no setting of the sensor"),
        (["+study.conditions.dim={variant: nobody}"], "nobody"),
        (["study.queries=path"], "is not possible here; give random or recorded"),
        (["study.query_count=0"], "study.query_count=0 is out of range"),
    ],
)
def test_settings_that_make_no_queries(omnilab_here, arguments, told):
    conditions = OFF if "+" in arguments[0] else OFF[1:]
    result = omnilab_here(*SMALL, *RADON, *conditions, *arguments)
    assert result.rc == 2
    assert told in result.stderr


def test_nothing_changes(omnilab_here):
    result = omnilab_here(*SMALL, *OFF)
    assert result.rc == 2
    assert "nothing changes" in result.stderr


@pytest.fixture(scope="module")
def bielefeld(omnilab_at, here):
    """`original` and two other sets, hand-made: pictures named by their column and row alone."""
    folder = here / "sets"
    for name, settings in {
        "original": [],
        "chairs": ["sensor.height_m=0.95"],
        "winlit": ["sensor.height_m=1.0"],
    }.items():
        data = here / f"rendered_{name}"
        arguments = ["experiment=render", "study.step_m=0.3", "study.extent_m=[0.9, 0.6]", f"study.folder={data}"]
        assert omnilab_at(here, *arguments, *SENSOR, *settings).rc == 0
        (folder / name).mkdir(parents=True)
        rows = list(csv.DictReader((data / "positions.csv").read_text().splitlines()))
        x, y = (np.array([float(row[axis]) for row in rows]) for axis in ("x_m", "y_m"))
        column, row_of = (np.rint((a - a.min()) / 0.3).astype(int) for a in (x, y))
        for row, i, j in zip(rows, column, row_of, strict=True):
            shutil.copy(data / row["image"], folder / name / f"pos_{i}_{j}.png")
    return folder


def test_folders_in_the_format_of_bielefeld(omnilab_at, here, bielefeld):
    off = [f"~study.conditions.{name}" for name in ("arboreal", "doorlit", "twilight")]
    radon = ["descriptor.offsets=48", "descriptor.angles=60"]
    result = omnilab_at(here, "experiment=recorded_changes", f"sensor.path={bielefeld / 'original'}", *radon, *off)
    assert result.rc == 0, result.stderr
    rows = load_run(here / "logs" / "latest").table("changes")
    assert [row["condition"] for row in rows] == ["chairs", "winlit"]
    assert load_run(here / "logs" / "latest").metrics["places"] == 12
    assert all(int(row["queries"]) == 12 for row in rows)
    assert all(float(row["nearest_rate"]) > 0.9 for row in rows), "a few centimetres of height change little"
