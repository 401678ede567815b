"""Maps of views as whole runs: simulated drives, and images of a virtual room."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import Parts, PathPoses
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.runner.run_folder import load_run
from omnilab.trajectory.files import read_trajectory
from omnilab_appearance import PlanarEpipolar, Simulated
from omnilab_mirror import Mirror
from omnilab_slam import ViewEkf, ViewGraph
from omnilab_studies import ViewSlam
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.view_slam.front_end import AssociationSettings

pytestmark = pytest.mark.slow


def test_views_are_mapped_from_images_by_both_filters(omnilab_here, tmp_path):
    """Of a world; with the views of that run; then of the same images as a recording, with the wheels from a file."""
    angle = [2 * math.pi * i / 24 for i in range(27)]
    rows = [f"{-1.6 + 0.4 * math.cos(a)},{-0.6 + 0.4 * math.sin(a)},1,{math.degrees(a) + 90}" for a in angle]
    (tmp_path / "path.csv").write_text("\n".join(["x_m,y_m,z_m,yaw_deg", *rows]) + "\n")
    there = ("sensor.world=room", "sensor.samples=1", "study.path=path.csv", "study.every_m=0.1", "study.every_rad=0.3")
    done = omnilab_here("experiment=view_slam", *there, "study.keep=views")
    assert done.rc == 0, done.stderr
    folder = (tmp_path / "logs/latest").resolve()
    found = load_run(folder).metrics
    assert max(found["view_ekf_rms"], found["view_graph_rms"]) < 0.1
    assert found["view_ekf_views"] >= 2
    assert found["view_ekf_observed"] > 5
    assert len(read_trajectory(folder / "view_graph_final.tum").T_world_camera) == found["images"]
    assert {"view_ekf.png", "view_graph.png", "run.rrd", "run.mcap"} <= {path.name for path in folder.iterdir()}
    assert "the metrics are the same" in omnilab_here("repeat", str(folder)).stderr

    again = ("experiment=known_views", *there, "sensors.known.path=views")
    done = omnilab_here(*again)
    assert done.rc == 0, done.stderr
    known = load_run(tmp_path / "logs/latest").metrics
    assert known["known_views"] == found["view_ekf_views"]
    assert max(known["view_ekf_views"], known["view_graph_views"]) <= 1
    assert max(known["view_ekf_rms"], known["view_graph_rms"]) < 0.1
    other = omnilab_here(*again, "sensor.size=300")
    assert other.rc == 2
    assert "the views of sensors.known were taken by another camera" in other.stderr

    taken = [line.split() for line in (folder / "truth.tum").read_text().splitlines() if line[0] != "#"]
    raised = [" ".join([stamp, x, y, "1", *turn]) for stamp, x, y, _, *turn in taken]
    (tmp_path / "taken.tum").write_text("\n".join(raised) + "\n")
    along_path = ("study.layout=path", "study.path=taken.tum", "study.folder=set")
    done = omnilab_here("experiment=render", "sensor.world=room", "sensor.samples=1", *along_path)
    assert done.rc == 0, done.stderr
    wheels = f"odometry.file={folder / 'odometry.tum'}"
    done = omnilab_here("experiment=recorded_views", "sensor.path=set", wheels)
    assert done.rc == 0, done.stderr
    recorded = load_run(tmp_path / "logs/latest").metrics
    assert recorded["images"] == found["images"]
    assert recorded["odometry_rms"] == pytest.approx(found["odometry_rms"], abs=2e-3)
    assert max(recorded["view_ekf_rms"], recorded["view_graph_rms"]) < 0.1
    assert recorded["view_ekf_observed"] > 5


@dataclass
class Lying(PlanarEpipolar):
    """Now and then takes a view for another: a direction and a turn out of thin air."""

    share: float = 0.1
    lies: int = 0

    def estimate(self, before, now, rng):
        found = super().estimate(before, now, rng)
        if found.failed or rng.random() > self.share:
            return found
        self.lies += 1
        away = rng.uniform(1, 5)
        x, y, turn = found.vector
        c, s = math.cos(away), math.sin(away)
        return replace(found, vector=np.array([c * x - s * y, s * x + c * y, turn + away]))


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_wrong_associations_are_gated_and_counted(share):
    angle = np.linspace(0, 2.2 * np.pi, 60)
    at = np.column_stack([-1.6 + 0.6 * np.cos(angle), -0.6 + 0.6 * np.sin(angle), np.ones(60)])
    ring = planar_poses(at, angle + np.pi / 2)
    sensor, views = Mirror(samples=1), Lying(share=share)

    class RingMirror(Mirror):
        def plan(self, layout):
            return sensor.plan(PathPoses(ring))

    parts = Parts(
        sensor=RingMirror(samples=1), odometry=Simulated(), odometries={"views": views},
        view_filters={"ekf": ViewEkf(), "graph": ViewGraph()},
    )  # fmt: skip
    study = ViewSlam(images=Source.recorded, views=AssociationSettings(similarity=0.5))
    report = study.run(parts, Recorder(), np.random.default_rng(2))
    found = {metric.name: metric.value for metric in report.metrics}
    for name in ("ekf", "graph"):
        assert found[f"{name}_rms"] < 0.1
        assert found[f"{name}_observed"] > 20
        if share:
            assert 0.3 * share < found[f"{name}_gated"] < 3 * share
        else:
            assert found[f"{name}_gated"] < 0.02
    assert (views.lies > 0) == (share > 0)


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
