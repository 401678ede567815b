"""Disturbances in whole runs: queries only, the same alone, in a sweep and in any batch, nothing at level 0."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from omnilab.api import Parts, PathPoses, RandomPoses
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab_appearance import GaussianNoise, Light, Nearest, PocBand, Radon, Tilt
from omnilab_mirror import Mirror
from omnilab_studies import Grid

pytestmark = pytest.mark.slow  # whole runs, each in a process of its own

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = (
    "experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1", "descriptor.offsets=48",
    "descriptor.angles=60", "study.step_m=0.5", "study.query_count=20", "study.show=2",
)  # fmt: skip
NO_LOGS = ("~sinks.rerun", "~sinks.mcap")
NOISE = "disturbance=uniform_noise"


def cells_of(table):
    return [cell for line in table.decode().splitlines() for cell in line.split(",")]


def check_alike(found, expected):
    """Two CSVs cell by cell: on some processors, products of matrices of other shapes round otherwise."""
    for one, other in zip(cells_of(found), cells_of(expected), strict=True):
        if one != other:
            assert float(one) == pytest.approx(float(other), rel=1e-4, abs=1e-6)


def bytes_of(folder):
    return [(folder / name).read_bytes() for name in ("metrics.csv", "queries.csv")]


@pytest.fixture
def run(omnilab_here, tmp_path):
    """`run(*overrides)`: a small study without logs; metrics and rows as bytes."""

    def run(*overrides):
        result = omnilab_here(*SMALL, *NO_LOGS, *overrides)
        assert result.rc == 0, result.stderr
        return bytes_of((tmp_path / "logs/latest").resolve())

    return run


def test_level_0_gives_the_bytes_of_no_disturbance_and_another_level_does_not(run):
    clear = run()
    assert run(NOISE, "disturbances.uniform_noise.level=0") == clear
    noisy = run(NOISE, "disturbances.uniform_noise.level=0.4")
    poses = [[row["truth_x_m"] for row in rows(table)] for _, table in (clear, noisy)]
    assert poses[0] == poses[1], "disturbed or not, the same queries are asked"
    assert noisy != clear


def rows(table):
    return list(csv.DictReader(io.StringIO(table.decode())))


def test_the_same_bytes_alone_in_a_sweep_in_other_batches_and_repeated(run, omnilab_here, tmp_path):
    alone = run(NOISE, "disturbances.uniform_noise.level=0.4")
    folder = (tmp_path / "logs/latest").resolve()
    repeated = omnilab_here("repeat", str(folder))
    assert repeated.rc == 0
    assert "the metrics are the same" in repeated.stderr
    batches = run(NOISE, "disturbances.uniform_noise.level=0.4", "sensor.batch=3")
    for found, expected in zip(batches, alone, strict=True):
        check_alike(found, expected)
    swept = omnilab_here("-m", *SMALL, *NO_LOGS, NOISE, "disturbances.uniform_noise.level=0,0.4", "logs=swept")
    assert swept.rc == 0, swept.stderr
    (job,) = (tmp_path / "swept").glob("quickstart/*/1")
    assert bytes_of(job) == alone
    assert run(NOISE, "disturbances.uniform_noise.level=0.4", "seed=1") != alone


def test_several_apply_in_order_and_the_run_folder_names_them(run, tmp_path):
    both = run("disturbance=[light,uniform_noise]", "disturbances.light.gain=0.1")
    folder = (tmp_path / "logs/latest").resolve()
    components = json.loads((folder / "manifest.json").read_text())["components"]
    assert components["disturbances.light"]["class"] == "omnilab_appearance.disturbances.light.Light"
    assert components["disturbances.uniform_noise"]["name"] == "uniform_noise"
    assert "disturb," in (folder / "cost.csv").read_text()
    assert run("disturbance=[uniform_noise,light]", "disturbances.light.gain=0.1") != both


def test_one_can_be_named_and_is_then_another_draw(run):
    named = run("+disturbance@disturbances.dust=uniform_noise", "disturbances.dust.level=0.4")
    assert run(NOISE, "disturbances.uniform_noise.level=0.4") != named


def test_the_recipe_and_what_leaves_its_noise_out(run):
    clear = run()
    assert run("experiment=noise") == run(NOISE) != clear
    assert run("experiment=noise", "~disturbance") == clear
    assert run("experiment=noise", "disturbances.uniform_noise=null") == clear


def test_the_logs_show_the_disturbed_queries(omnilab_here, tmp_path):
    result = omnilab_here(*SMALL, "~sinks.rerun", "disturbance=light", "disturbances.light.gain=0")
    assert result.rc == 0, result.stderr
    with (tmp_path / "logs/latest/run.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        shown = [m.data for _, _, _, m in reader.iter_decoded_messages(topics=["/query/image", "/query/panorama"])]
    assert len(shown) == 4
    assert all(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE).max() == 0 for data in shown)


def test_recorded_images_are_disturbed_too(omnilab_here, tmp_path):
    mirror = Mirror(str(WORLD), size=96, samples=1)
    images = tmp_path / "images"
    images.mkdir()
    lines = ["image,x_m,y_m"]
    position_m = np.array([(x, y, 1.0) for y in (-1.2, -0.9, -0.6) for x in (-1.5, -1.2, -0.9)])
    for frames in mirror.frames(mirror.plan(PathPoses(planar_poses(position_m)))):
        for image, index, (x, y, _) in zip(frames.images, frames.plan_index, position_m, strict=True):
            cv2.imwrite(str(images / f"{index}.png"), image)
            lines.append(f"{index}.png,{x},{y}")
    (images / "positions.csv").write_text("\n".join(lines) + "\n")
    common = (
        "experiment=recorded_grid", f"sensor.path={images}", "sensor.circle_px=[47.5,47.5,48]", "descriptor.offsets=48",
        "descriptor.angles=60", *NO_LOGS,
    )  # fmt: skip
    found = []
    for more in ((), ("disturbance=occlusion",), ("disturbance=occlusion", "disturbances.occlusion.fraction=0")):
        result = omnilab_here(*common, *more)
        assert result.rc == 0, result.stderr
        found.append(bytes_of((tmp_path / "logs/latest").resolve()))
    assert found[0] == found[2] != found[1]
    refused = omnilab_here(*common, "disturbance=tilt")
    assert refused.rc == 2
    assert "which ImageCircle does not" in refused.stderr
    grey = omnilab_here(*common, "disturbance=color_shift")
    assert grey.rc == 2
    assert "sensor.color=true" in grey.stderr
    assert omnilab_here(*common, "disturbance=color_shift", "sensor.color=true").rc == 0


# --------------------------------------------------------------------------------------------------- as a library
@dataclass
class Watched(Radon):
    """Keeps the means of what it describes."""

    def __post_init__(self):
        super().__post_init__()
        self.means = []

    def describe(self, images):
        self.means += list(images.mean((1, 2)))
        return super().describe(images)


def test_places_stay_clear_and_figures_show_the_disturbed():
    sensor = Mirror(str(WORLD), size=64, samples=1)
    parts = Parts(sensor, Watched(32, 36), PocBand(), Nearest(), disturbances={"dark": Light(gain=0)})
    report = Grid(step_m=1.0, query_count=9, show=0).run(parts, Recorder(), np.random.default_rng(0))
    places = len(parts.descriptor.means) - 9
    assert min(parts.descriptor.means[:places]) > 0
    assert max(parts.descriptor.means[places:]) == 0
    shown = [axes.images[0].get_array() for axes in report.figures["worst"].axes if axes.images]
    assert sum(not image.any() for image in shown) == len(shown) / 2 > 0


def test_tilting_an_image_is_tilting_the_camera():
    mirror = Mirror(str(WORLD), size=160, samples=9)
    plan = mirror.plan(RandomPoses(4, seed=2))
    axis, angle = np.deg2rad(50), np.deg2rad(8)
    R = cv2.Rodrigues(angle * np.array([np.cos(axis), np.sin(axis), 0]))[0]
    leaning = plan.T_world_camera.copy()
    leaning[:, :3, :3] = leaning[:, :3, :3] @ R
    (frames,) = mirror.frames(plan)
    (expected,) = mirror.frames(mirror.plan(PathPoses(leaning)))
    rngs = [np.random.default_rng(0)] * 4
    tilted = Tilt(8, 50).apply(frames.images, frames.camera, rngs).astype(int)
    v, u = np.mgrid[:160, :160] - 79.5
    inner = np.hypot(u, v) < 60  # further out the upright image may end
    apart = np.abs(tilted - expected.images)[:, inner].mean()
    upright = np.abs(frames.images.astype(int) - expected.images)[:, inner].mean()
    other = np.abs(Tilt(-8, 50).apply(frames.images, frames.camera, rngs).astype(int) - expected.images)
    assert apart < 2.5
    assert apart < 0.3 * upright < 0.3 * other[:, inner].mean()


def test_one_disturbance_does_not_change_what_another_draws():
    from omnilab_studies.common.frames import disturbed

    mirror = Mirror(str(WORLD), size=64, samples=1)
    (frames,) = mirror.frames(mirror.plan(RandomPoses(3, seed=1)))
    flat = replace(frames, images=np.full_like(frames.images, 128))
    alone = disturbed(flat, {"b": GaussianNoise()}, 7)
    beside = disturbed(flat, {"a": Light(1.0), "b": GaussianNoise()}, 7)
    assert np.array_equal(alone.images, beside.images)
    assert not np.array_equal(alone.images, disturbed(flat, {"b": GaussianNoise()}, 8).images)
