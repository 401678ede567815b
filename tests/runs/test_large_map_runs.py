"""Localizers as the command line runs them: sub-grid positions, and maps that grow."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"


def test_positions_between_the_places_of_the_room(omnilab_at, tmp_path):
    """The bar is 0.15 steps, at headings between the angles of the grid."""
    arguments = ["study.extent_m=[2,2]", "study.query_count=60", "study.show=1", "sensor.samples=1"]
    result = omnilab_at(tmp_path, "experiment=grid", "localizer=interpolated", *arguments)
    assert result.rc == 0, result.stderr
    metrics = load_run(tmp_path / "logs" / "latest").metrics
    assert metrics["position_error_median"] < 0.15 * 0.2
    assert metrics["heading_error_median"] < 0.5


def test_maps_grow_over_steps_and_worlds(omnilab_at, tmp_path):
    arguments = [f"sensor.world={WORLD}", "sensor.size=64", "study.steps_m=[0.5,0.2]", f"study.worlds=[{WORLD},room]"]
    arguments += ["study.query_count=30", "+localizer@localizers.one=hierarchical", "localizers.one.probes=1"]
    result = omnilab_at(tmp_path, "experiment=large_map", *arguments)
    assert result.rc == 0, result.stderr
    folder = tmp_path / "logs" / "latest"
    rows = load_run(folder).table("maps")
    assert [row["localizer"] for row in rows] == ["exhaustive", "hierarchical", "one"] * 4
    places = [int(row["places"]) for row in rows[::3]]
    assert places == sorted(set(places))
    assert places[2] == 2 * places[1]  # the same world twice
    metrics = load_run(folder).metrics
    assert metrics["places_most"] == places[-1]
    assert metrics["agreement_hierarchical"] >= metrics["agreement_one"]
    assert metrics["compared_one"] < metrics["compared_hierarchical"] < metrics["compared_exhaustive"] == places[-1]
    assert all((folder / name).stat().st_size > 0 for name in ("exponents.csv", "scaling.png", "run.rrd", "run.mcap"))
