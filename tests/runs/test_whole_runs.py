"""Whole runs, alone, on recorded images and without Hydra: what they leave behind, and that it agrees."""

from __future__ import annotations

import hashlib
import json
import math
import statistics
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import RrdReader

from omnilab.api import Frames, GridPoses, Mesh, Parts, PathPoses, Plan, PoseRequest
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.runner.run_folder import load_run
from omnilab_appearance import Nearest, PocBand, Radon
from omnilab_mirror import Mirror
from omnilab_studies import Grid
from omnilab_studies.localization.grid.study import Queries

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]
RADON = ["descriptor.offsets=48", "descriptor.angles=60"]
SMALL = ["experiment=quickstart", "study.query_count=12", "study.show=4", *SENSOR, *RADON]
STEP_M = 0.5
CHEST_M = ((0.6, 1.4), (0.25, 0.75))  # x and y of the solid in the world, 5 cm around which no camera fits
COLORS = ("nearest", "second", "wrong")


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("alone")


@pytest.fixture(scope="module")
def command(omnilab_in, here):
    result = omnilab_in(here, *SMALL, f"study.step_m={STEP_M}", "seed=5")
    assert result.rc == 0, result.stderr
    return result


@pytest.fixture(scope="module")
def folder(command, here):
    (folder,) = (here / "logs" / "quickstart").iterdir()
    return folder


@pytest.fixture(scope="module")
def metrics(folder):
    return load_run(folder).metrics


@pytest.fixture(scope="module")
def queries(folder):
    return load_run(folder).table("queries")


# --------------------------------------------------------------------------------------------------- one run
def test_a_run_leaves_these_files(folder):
    assert {file.name for file in folder.iterdir()} == {
        "config.yaml", "manifest.json", "status.json", "metrics.csv", "cost.csv", "queries.csv", "run.log", "run.lock",
        "progress.json",
        "run.rrd", "run.mcap", "foxglove_layout.json", "success.png", "distance_surface.png", "error_map.png", "worst.png",
        "recall.png",
    }  # fmt: skip


def test_status_is_done(folder):
    status = json.loads((folder / "status.json").read_text())
    assert status["status"] == "done"
    assert status["sinks_dropped"] == {}


def test_config_holds_every_setting_as_it_ran(folder):
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["study"] | {"step_m": STEP_M, "query_count": 12, "show": 4, "queries": "random"} == config["study"]
    assert config["sensor"] | {"world": str(WORLD), "size": 96, "batch": 64} == config["sensor"]
    assert config["seed"] == 5
    assert set(config["sinks"]) == {"console", "rerun", "mcap"}
    assert config["distance"], "the descriptor's default distance is written out"


def test_manifest_says_what_ran(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    components = manifest["components"]
    assert {slot: part["name"] for slot, part in components.items()} == {
        "sensor": "mirror", "descriptor": "radon", "distance": "poc_band", "localizer": "nearest", "study": "grid",
        "sinks.console": "console", "sinks.rerun": "rerun", "sinks.mcap": "mcap",
    }  # fmt: skip
    assert components["descriptor"]["class"] == f"{Radon.__module__}.Radon"
    assert components["descriptor"]["distribution"] == "omnilab-appearance"
    assert all(part["version"] for part in components.values())
    assert manifest["seed"] == 5
    assert manifest["config_hash"] == hashlib.sha256((folder / "config.yaml").read_bytes()).hexdigest()
    assert manifest["experiment"] == "quickstart"
    assert "study.query_count=12" in manifest["overrides"]
    assert {"commit", "host", "python", "command"} <= manifest.keys()
    assert manifest["host"]["cores"] >= 1


def test_latest_points_at_the_run(folder, here):
    link = here / "logs" / "latest"
    assert link.is_symlink()
    assert link.resolve() == folder.resolve()
    assert not link.readlink().is_absolute(), "a copied logs folder keeps its link"


def test_the_command_prints_the_metrics(command, metrics):
    shown = dict(line.split()[:2] for line in command.stdout.splitlines()[3:])
    for name, value in metrics.items():
        assert float(shown[name]) == pytest.approx(value, rel=1e-5), name


def test_runs_lists_it(folder, here, metrics, omnilab_here, monkeypatch):
    monkeypatch.chdir(here)
    listed = omnilab_here("runs")
    assert listed.rc == 0
    (line,) = [line for line in listed.stdout.splitlines() if folder.name in line]
    assert " done " in line
    assert f"nearest_rate {metrics['nearest_rate']:.4g}" in line
    assert "study.query_count=12" in line


def test_costs_are_positive_and_the_stages_fit_into_the_whole(folder):
    costs = {row["cost"]: (float(row["value"]), row["unit"]) for row in load_run(folder).table("cost")}
    assert costs["peak memory"][1] == "MiB"
    assert costs["peak memory"][0] > 30
    seconds = {name: value for name, (value, unit) in costs.items() if unit == "s"}
    assert {"wall", "describe", "localise", "places: images", "queries: images", "sink rerun", "sink mcap"} <= set(
        seconds
    )
    assert all(value >= 0 for value in seconds.values())
    assert (
        sum(seconds[name] for name in ("describe", "localise", "places: images", "queries: images")) < seconds["wall"]
    )


@pytest.mark.parametrize("name", ["success", "distance_surface", "error_map", "worst", "recall"])
def test_figures_decode_and_show_something(folder, name):
    image = cv2.imread(str(folder / f"{name}.png"))
    assert image is not None
    assert min(image.shape[:2]) > 300
    assert image.std() > 5


# --------------------------------------------------------------------------------- metrics, recomputed from the rows
@pytest.fixture(scope="module")
def grid_m():
    """The free nodes of the grid over 4 x 3 m, as the world describes itself."""
    nodes = [(x, y) for y in np.arange(-1.5, 1.51, STEP_M) for x in np.arange(-2, 2.01, STEP_M)]
    (x0, x1), (y0, y1) = CHEST_M
    return [(x, y) for x, y in nodes if not (x0 - 0.05 <= x <= x1 + 0.05 and y0 - 0.05 <= y <= y1 + 0.05)]


def test_one_row_a_query(queries, metrics):
    assert [int(row["query"]) for row in queries] == list(range(12))
    assert len({row["key"] for row in queries}) == 12
    assert metrics["queries"] == 12


def test_places_are_the_free_nodes_of_the_grid(grid_m, metrics, queries):
    assert metrics["places"] == len(grid_m)
    assert metrics["left_out"] == 9 * 7 - len(grid_m) > 0
    for row in queries:
        assert (float(row["answer_x_m"]), float(row["answer_y_m"])) == pytest.approx(grid_m[int(row["place"])])


def test_verdicts_and_rates_follow_from_the_positions(grid_m, metrics, queries):
    verdicts = []
    for row in queries:
        truth = float(row["truth_x_m"]), float(row["truth_y_m"])
        away = [math.dist(truth, node) for node in grid_m]
        rings = sorted({round(distance, 6) for distance in away})
        verdicts.append(COLORS[min(2, rings.index(round(away[int(row["place"])], 6)))])
    assert verdicts == [row["verdict"] for row in queries]
    for name in COLORS:
        assert metrics[f"{name}_rate"] == pytest.approx(Counter(verdicts)[name] / 12)
    assert len(set(verdicts)) > 1, "a run of which all answers are alike tests little"


def test_errors_follow_from_truth_and_answer(metrics, queries):
    errors = []
    for row in queries:
        truth, answer = ([float(row[f"{end}_{axis}_m"]) for axis in "xyz"] for end in ("truth", "answer"))
        errors.append(math.dist(truth, answer))
        assert float(row["error_m"]) == pytest.approx(errors[-1])
    check_statistics(metrics, "position_error", errors)


def test_heading_errors_follow_from_truth_and_answer(metrics, queries):
    errors = []
    for row in queries:
        turn = math.radians(float(row["answer_heading_deg"]) - float(row["truth_heading_deg"]))
        errors.append(math.degrees(abs(math.atan2(math.sin(turn), math.cos(turn)))))
        assert float(row["heading_error_deg"]) == pytest.approx(errors[-1], abs=1e-6)
    check_statistics(metrics, "heading_error", errors)


def check_statistics(metrics, name, values):
    assert metrics[f"{name}_median"] == pytest.approx(statistics.median(values))
    assert metrics[f"{name}_mean"] == pytest.approx(statistics.fmean(values))
    ordered, at = sorted(values), 0.95 * (len(values) - 1)
    low = ordered[int(at)]
    p95 = low + (at - int(at)) * (ordered[int(at) + 1] - low)
    assert metrics[f"{name}_p95"] == pytest.approx(p95)


def test_rank_is_one_where_the_nearest_place_was_answered(queries):
    for row in queries:
        assert (row["rank"] == "1") == (row["verdict"] == "nearest")
        assert int(row["rank"]) >= 1


def test_sharpness_and_bytes(metrics, queries):
    assert metrics["sharpness_mean"] == pytest.approx(
        statistics.fmean(float(row["sharpness"]) for row in queries), 1e-5
    )
    assert all(0 <= float(row["sharpness"]) <= 1 for row in queries)
    assert metrics["bytes_per_place"] == 4 * 48 * 60


def test_units(folder):
    units = {row["metric"]: row["unit"] for row in load_run(folder).table("metrics")}
    assert units["nearest_rate"] == units["places"] == "1"
    assert units["position_error_mean"] == "m"
    assert units["heading_error_p95"] == "deg"
    assert units["bytes_per_place"] == "B"


# ------------------------------------------------------------------------------------------- the logs agree with it
def test_the_mcap_holds_the_errors_of_the_rows(folder, queries):
    topics: dict[str, list[object]] = {}
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append(decoded)
    assert len(topics["/query/image"]) == len(topics["/query/panorama"]) == 4
    assert [m.value for m in topics["/error/position_m"]] == [float(row["error_m"]) for row in queries]
    assert [m.value for m in topics["/error/heading_deg"]] == [float(row["heading_error_deg"]) for row in queries]


def test_the_rrd_holds_the_errors_of_the_rows(folder, queries):
    found = {}
    for chunk in RrdReader(folder / "run.rrd").stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/error/position_m" and "step" in batch.schema.names:
            values = batch.column("Scalars:scalars").to_pylist()
            found |= dict(zip(batch.column("step").cast("int64").to_pylist(), values, strict=True))
    assert [found[i] for i in range(12)] == [[float(row["error_m"])] for row in queries]


def test_both_logs_say_which_run_it_is_and_how_it_ended(folder, metrics):
    manifest = json.loads((folder / "manifest.json").read_text())
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        *_, last = reader.iter_metadata()
        attached = {attachment.name: attachment.data for attachment in reader.iter_attachments()}
    assert last.metadata["id"] == manifest["id"]
    assert last.metadata["status"] == "done"
    assert {name: float(last.metadata[f"metrics.{name}"]) for name in metrics} == metrics
    assert attached == {n: (folder / n).read_bytes() for n in ("manifest.json", "config.yaml", "metrics.csv")}

    reader = RrdReader(folder / "run.rrd")
    assert [entry.recording_id for entry in reader.recordings()] == [f"{folder.name}-{manifest['id']}"]
    found = {}
    for chunk in reader.stream().filter(content="/__properties/**").to_chunks():
        found |= {name: values[-1] for name, values in chunk.to_record_batch().to_pydict().items()}
    assert {name: found[name] for name in metrics} == {name: [value] for name, value in metrics.items()}
    assert (found["status"], found["seed"], found["experiment"]) == (["done"], [5], ["quickstart"])
    assert found["overrides"] == manifest["overrides"]


def test_the_logs_begin_and_end_with_a_header(folder):
    with (folder / "run.mcap").open("rb") as stream:
        first, last = (message.data for _, _, message in make_reader(stream).iter_messages(topics=["/header"]))
    assert b"### quickstart: running" in first
    assert b"### quickstart: done" in last


def test_an_error_lies_at_its_image_in_both_logs(folder):
    times: dict[str, dict[int, int]] = {}
    with (folder / "run.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            assert message.publish_time == message.log_time
            times.setdefault(channel.topic, {})[message.sequence] = message.log_time
    images = times["/query/image"]
    assert images.items() <= times["/error/position_m"].items()
    assert len(set(images.values())) == len(images) == 4

    times = {}
    for chunk in RrdReader(folder / "run.rrd").stream().filter(has_timeline="step").to_chunks():
        batch = chunk.to_record_batch()
        steps, at = (batch.column(name).cast("int64").to_pylist() for name in ("step", "log_time"))
        times.setdefault(chunk.entity_path, {}).update(zip(steps, at, strict=True))
    images = times["/query/image"]
    assert images.items() <= times["/error/position_m"].items()
    assert len(set(images.values())) == len(images) == 4


# --------------------------------------------------------------------------------------------------- as a library
def test_without_hydra(tmp_path):
    parts = Parts(Mirror(str(WORLD), size=96, samples=1), Radon(48, 60), PocBand(), Nearest())
    study = Grid(step_m=1.5, query_count=7, show=0)
    report = study.run(parts, Recorder(), np.random.default_rng(0))
    found = {metric.name: metric.value for metric in report.metrics}
    assert found["queries"] == 7
    assert set(report.tables) == {"queries"}
    assert not list(tmp_path.iterdir())


def test_a_run_reads_back_as_a_library(folder, metrics):
    run = load_run(folder)
    assert run.metrics == metrics
    assert run.table("queries")[0]["verdict"] in COLORS
    assert run.config["study"]["step_m"] == STEP_M


# --------------------------------------------------------------------------------------------------- recorded images
class Replayed:
    """The virtual sensor at the recorded poses: a recording of a grid, without any file between."""

    def __init__(self, mirror: Mirror, T_world_camera: np.ndarray, on_grid: np.ndarray) -> None:
        self.mirror, self.T_world_camera, self.on_grid = mirror, T_world_camera, on_grid

    def plan(self, layout: PoseRequest) -> Plan:
        chosen = self.on_grid if isinstance(layout, GridPoses) else ~self.on_grid
        return self.mirror.plan(PathPoses(self.T_world_camera[chosen]))

    def frames(self, plan: Plan) -> Iterator[Frames]:
        return self.mirror.frames(plan)

    def scene(self) -> Mesh | None:
        return None


@pytest.mark.slow
def test_recorded_images_give_the_answers_of_the_virtual_sensor(tmp_path, omnilab_here):
    mirror = Mirror(str(WORLD), size=96, samples=1)
    free = mirror.plan(GridPoses(0.25)).T_world_camera[:, :3, 3]
    column, row = np.rint((free[:, :2] - free[:, :2].min(0)) / 0.25).astype(int).T
    on_grid = (column % 2 == 0) & (row % 2 == 0)
    heading = np.where(on_grid, 0.3, np.random.default_rng(3).uniform(-np.pi, np.pi, len(free)))
    poses = planar_poses(free, heading)

    study = Grid(step_m=None, every=2, queries=Queries.rest, show=0)
    parts = Parts(Replayed(mirror, poses, on_grid), Radon(48, 60), PocBand(), Nearest())
    expected = study.run(parts, Recorder(), np.random.default_rng(0))

    images = tmp_path / "images"
    write_recording(images, mirror, poses)
    ring = mirror.camera.circle
    result = omnilab_here(
        "experiment=recorded_grid", f"sensor.path={images}", f"sensor.circle_px=[{ring.cx},{ring.cy},{ring.radius}]",
        "study.show=3", *RADON,
    )  # fmt: skip
    assert result.rc == 0, result.stderr
    run = load_run(tmp_path / "logs" / "latest")
    assert run.metrics == pytest.approx({m.name: m.value for m in expected.metrics}, rel=1e-6)
    rows, table = run.table("queries"), expected.tables["queries"]
    assert [int(row["place"]) for row in rows] == list(table["place"])
    assert [row["verdict"] for row in rows] == list(table["verdict"])
    assert [float(row["answer_heading_deg"]) for row in rows] == pytest.approx(
        list(table["answer_heading_deg"]), abs=1e-4
    )
    assert rows[0]["key"].endswith(".png")
    assert run.metrics["wrong_rate"] < 0.5  # by chance it would be about 0.95
    assert run.metrics["heading_error_median"] < 20  # by chance 90


def write_recording(folder: Path, mirror: Mirror, T_world_camera: np.ndarray) -> None:
    folder.mkdir()
    lines = ["image,x_m,y_m,z_m,yaw_deg"]
    for frames in mirror.frames(mirror.plan(PathPoses(T_world_camera))):
        for image, index, T in zip(frames.images, frames.plan_index, frames.T_world_camera, strict=True):
            cv2.imwrite(str(folder / f"{index:03d}.png"), image)
            yaw = math.degrees(math.atan2(T[1, 0], T[0, 0]))
            lines.append(f"{index:03d}.png,{float(T[0, 3])!r},{float(T[1, 3])!r},{float(T[2, 3])!r},{yaw!r}")
    (folder / "positions.csv").write_text("\n".join(lines) + "\n")


@pytest.mark.slow
def test_the_recipe_of_the_published_forest(omnilab_here, tmp_path):
    data = Path(__file__).parents[3] / "shared/data/bearingnet_forest_grid"
    if not data.is_dir():
        pytest.skip(f"the forest's images are not at {data}")
    assert omnilab_here("experiment=recorded_forest", f"sensor.path={data}").rc == 0
    metrics = load_run(tmp_path / "logs/latest").metrics
    assert (metrics["places"], metrics["queries"], metrics["left_out"]) == (25, 75, 0)
    assert metrics["heading_error_median"] < 1  # all images have one heading
    assert metrics["nearest_rate"] > 0.5  # chance: 0.1
