"""The study `steps`, as the command line runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]
SIZES = [
    f"descriptors.{name}.{size}" for name in ("poc", "poc_band", "radon_gist") for size in ("offsets=48", "angles=60")
]
SMALL = [
    "experiment=steps",
    "study.query_count=15",
    "study.steps_m=[0.5, 1.0]",
    "study.heading_steps=60",
    *SENSOR,
    *SIZES,
]


@pytest.fixture(scope="module")
def run(omnilab_at, tmp_path_factory):
    here = tmp_path_factory.mktemp("steps")
    result = omnilab_at(here, *SMALL)
    assert result.rc == 0, result.stderr
    return (here / "logs" / "latest").resolve()


def test_a_row_for_every_step_method_and_kind_of_headings(run):
    rows = load_run(run).table("steps")
    assert [(row["step_m"], row["headings"], row["method"]) for row in rows] == [
        (step, headings, name)
        for step in ("0.5", "1.0")
        for headings in ("any", "on_grid")
        for name in ("poc", "poc_band", "radon_gist")
    ]
    assert all(sum(float(row[f"{v}_rate"]) for v in ("nearest", "second", "wrong")) == pytest.approx(1) for row in rows)


def test_each_method_has_the_distance_of_its_name(run):
    """Beside their names they are the same descriptor: what differs is the distance."""
    rows = {(row["method"], row["step_m"], row["headings"]): row for row in load_run(run).table("steps")}
    errors = [
        [rows[name, "0.5", "any"][f"heading_error_{s}_deg"] for s in ("mean", "median")] for name in ("poc", "poc_band")
    ]
    assert errors[0] != errors[1]
    assert {row["heading_error_mean_deg"] for row in load_run(run).table("steps") if row["method"] == "radon_gist"}


def test_coarser_maps_have_fewer_places(run):
    places = {row["step_m"]: int(row["places"]) for row in load_run(run).table("steps")}
    assert places["0.5"] > 3 * places["1.0"] > 0


def test_figures_and_times(run):
    assert {"success.png", "heading_error.png", "run.rrd", "run.mcap"} <= {file.name for file in run.iterdir()}
    assert all(float(row["locate_ms"]) > 0 for row in load_run(run).table("times"))


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("steps_m=[]", "study.steps_m=[] holds 0 numbers; give 1 or more"),
        ("steps_m=[-1]", "study.steps_m=[-1.0] holds -1, which is out of range"),
        ("heading_steps=0", "study.heading_steps=0 is out of range"),
    ],
)
def test_settings_that_make_no_study(omnilab_here, setting, told):
    result = omnilab_here(*SMALL, f"study.{setting}")
    assert result.rc == 2
    assert told in result.stderr
