"""Trajectories as whole runs: from images to maps, files and both logs; in virtual worlds and recorded."""

from __future__ import annotations

import csv
import math

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from omnilab.posegraph.files import read_graph
from omnilab.runner.run_folder import load_run
from omnilab.trajectory.files import read_trajectory

pytestmark = pytest.mark.slow
SMALL = ("experiment=square", "sensor.size=250", "sensor.margin_px=0", "sensor.samples=1", "study.path=path.csv")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "logs/latest"


@pytest.fixture
def path(tmp_path):
    """A round of 0.4 m radius in the room, and a little further: 44 poses, the last four of them again near the first."""
    angle = [2 * math.pi * i / 40 for i in range(44)]
    rows = [
        f"{-1.6 + 0.4 * math.cos(a)},{-0.6 + 0.4 * math.sin(a)},1,{math.degrees(a) + 90},{10**8 * i}"
        for i, a in enumerate(angle)
    ]
    (tmp_path / "path.csv").write_text("\n".join(["x_m,y_m,z_m,yaw_deg,stamp_ns", *rows]) + "\n")
    return tmp_path / "path.csv"


def test_a_round_in_the_room_is_mapped_and_its_files_and_logs_hold_it(omnilab_here, folder, path):
    done = omnilab_here(*SMALL, "loop_closure.exclude=20", "loop_closure.parallax_steps=4", "study.same_place_m=0.3")
    assert done.rc == 0, done.stderr
    found = load_run(folder).metrics
    assert found["ate"] < 0.05
    assert found["closures"] >= 1
    assert found["closure_precision"] == 1
    assert found["images"] == 44
    final = read_trajectory(folder / "gtsam_batch.tum")
    graph = read_graph(folder / "graph.g2o")
    assert len(final.T_world_camera) == len(graph) == 44
    assert {"paths.png", "errors.png", "time.png", "steps.csv"} <= {path.name for path in folder.resolve().iterdir()}
    with (folder / "run.mcap").open("rb") as file:
        frames = set()
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            ["/tf"]
        ):
            assert channel.topic == "/tf"
            frames |= {one.child_frame_id for one in message.transforms}
    assert {"robot", "camera"} <= frames
    assert "the metrics are the same" in omnilab_here("repeat", str(folder.resolve())).stderr


def test_the_printed_variant_and_wheels_run_beside_each_other(omnilab_here, tmp_path, path):
    done = omnilab_here(
        "-m", *SMALL, "odometry=appearance,simulated", "loop_closure=hog_threshold", "loop_closure.w=0.001"
    )
    assert done.rc == 0, done.stderr
    with next((tmp_path / "logs/square").glob("*/summary.csv")).open() as file:
        ate = [float(row["ate"]) for row in csv.DictReader(file)]
    assert len(ate) == 2
    assert max(ate) < 0.4


def test_a_recorded_sequence_is_mapped_with_and_without_its_poses(omnilab_here, tmp_path, folder, path):
    made = omnilab_here(
        "experiment=render", f"study.folder={tmp_path}/set", "sensor.size=250", "sensor.samples=1", "study.layout=path",
        "study.path=path.csv", "~sinks.rerun", "~sinks.mcap",
    )  # fmt: skip
    assert made.rc == 0, made.stderr
    recorded = ("experiment=recorded_trajectory", f"sensor.path={tmp_path}/set")
    done = omnilab_here(
        *recorded, "odometry=planar_epipolar", "loop_closure=geometric_verification", "loop_closure.exclude=20"
    )
    assert done.rc == 0, done.stderr
    assert load_run(folder).metrics["ate"] < 0.05
    wheels = omnilab_here(*recorded, "odometry=recorded", f"odometry.file={path}", "sensor.positions=null")
    assert wheels.rc == 0, wheels.stderr
    assert "ate" not in load_run(folder).metrics
    assert len(read_trajectory(folder / "online.tum").T_world_camera) == 44


def test_a_sequence_of_one_image_is_one_sentence(omnilab_here, tmp_path):
    (tmp_path / "one.csv").write_text("x_m,y_m,z_m\n-1,-1,1\n")
    done = omnilab_here(*SMALL[:-1], "study.path=one.csv")
    assert done.rc == 2
    assert "a sequence of 1 image makes no trajectory; give 2 or more" in done.stderr
