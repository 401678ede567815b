"""Pose graphs as whole runs: one command, files in the run's folder, the same again, records in both logs."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from mcap.reader import make_reader

from omnilab.posegraph.files import read_graph

SMALL = ("study.walk.count=60", "study.walk.side=5")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "logs/latest"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_walk_is_optimised_by_one_command_and_the_answer_is_a_graph_again(omnilab_here, folder):
    done = omnilab_here("experiment=pose_graph", *SMALL)
    assert done.rc == 0, done.stderr
    found = {row["metric"]: float(row["value"]) for row in rows(folder / "metrics.csv")}
    assert found["chi2"] < found["chi2_before"] / 10
    assert found["ate"] < 0.3
    graph = read_graph(folder / "gtsam_batch.g2o")
    assert len(graph) == 60
    assert len((folder / "gtsam_batch.tum").read_text().splitlines()) == 60
    repeated = omnilab_here("repeat", str(folder.resolve()))
    assert "the metrics are the same" in repeated.stderr
    again = omnilab_here("experiment=pose_graph", f"study.path={folder.resolve()}/gtsam_batch.g2o", "backend=gtsam_gnc")
    assert again.rc == 0, again.stderr
    assert float(rows(folder / "backends.csv")[0]["chi2_before"]) == pytest.approx(found["chi2"], rel=1e-9)


def test_back_ends_stand_side_by_side_among_wrong_loops(omnilab_here, folder):
    done = omnilab_here("experiment=wrong_loops", *SMALL)
    assert done.rc == 0, done.stderr
    table = {row["backend"]: row for row in rows(folder / "backends.csv")}
    assert list(table) == ["gtsam_batch", "huber", "dcs", "gnc", "isam2"]
    assert float(table["gnc"]["rms_to_clean_m"]) < 0.1 < float(table["gtsam_batch"]["rms_to_clean_m"])
    assert {"graphs.png", "growth.png", "isam2.g2o", "edges.csv"} <= {path.name for path in folder.resolve().iterdir()}
    with (folder / "run.mcap").open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {"/before", "/after/gnc", "/after/isam2", "/time/isam2"} <= topics


def test_a_file_that_cannot_be_used_is_one_sentence(omnilab_here, tmp_path):
    (tmp_path / "torn.g2o").write_text("EDGE_SE2 0 1 1 0 0 1 0 0 1 0\n")
    done = omnilab_here("experiment=pose_graph", f"study.path={tmp_path}/torn.g2o", "~sinks.rerun", "~sinks.mcap")
    assert done.rc == 2
    assert "has 10 values after EDGE_SE2; write 11" in done.stderr
    assert "Traceback" not in done.stderr
