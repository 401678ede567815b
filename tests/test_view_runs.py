"""Maps of views as whole runs: simulated drives, and images of a virtual room."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from omnilab.trajectory_files import read_trajectory

pytestmark = pytest.mark.slow


def metrics(folder: Path) -> dict[str, float]:
    with (folder / "metrics.csv").open() as file:
        return {row["metric"]: float(row["value"]) for row in csv.DictReader(file)}


def test_views_are_mapped_from_images_by_both_filters(omnilab_here, tmp_path):
    angle = [2 * math.pi * i / 24 for i in range(27)]
    rows = [f"{-1.6 + 0.4 * math.cos(a)},{-0.6 + 0.4 * math.sin(a)},1,{math.degrees(a) + 90}" for a in angle]
    (tmp_path / "way.csv").write_text("\n".join(["x_m,y_m,z_m,yaw_deg", *rows]) + "\n")
    done = omnilab_here(
        "experiment=view_slam", "sensor.world=room", "sensor.samples=1", "study.path=way.csv", "study.every_m=0.1",
        "study.every_rad=0.3",
    )  # fmt: skip
    assert done.rc == 0, done.stderr
    folder = tmp_path / "logs/latest"
    found = metrics(folder)
    assert max(found["view_ekf_rms"], found["view_graph_rms"]) < 0.1
    assert found["view_ekf_views"] >= 2
    assert found["view_ekf_observed"] > 5
    assert len(read_trajectory(folder / "view_graph_final.tum").T_world_camera) == found["images"]
    assert {"view_ekf.png", "view_graph.png", "run.rrd", "run.mcap"} <= {
        path.name for path in folder.resolve().iterdir()
    }
    assert "the metrics are the same" in omnilab_here("repeat", str(folder.resolve())).stderr


@pytest.mark.parametrize(
    "settings",
    [
        ("experiment=view_range", "study.seeds=2", "study.ranges_m=[9]", "study.fewer_seeds={view_graph:2}"),
        ("experiment=view_count", "study.seeds=2", "study.counts=[2,4]", "study.fewer_seeds={view_graph:2}"),
    ],
)
def test_drives_are_simulated(omnilab_here, tmp_path, settings):
    done = omnilab_here(*settings, "study.scenarios=[open]" if "range" in settings[0] else "seed=0")
    assert done.rc == 0, done.stderr
    assert (tmp_path / "logs/latest/nees.png").exists()
