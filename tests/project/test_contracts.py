"""Components that keep their contract beside their own tests: sinks, recorded images, distances of features, map studies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import Parts, RecordedPoses, Signatures
from omnilab.runner.console_sink import Console
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_distance, check_sensor, check_sink, check_study
from omnilab_appearance import Features, FeaturesTurned, Nearest, Poc, Sift, TinyImage
from omnilab_appearance.localizers.smacof import Smacof
from omnilab_mcap import McapSink
from omnilab_mirror import Mirror
from omnilab_recordings import Folder
from omnilab_rerun import RerunSink
from omnilab_studies import Changes, Localize, MapStudy, Room, Steps

WORLD = str(Path(__file__).parents[1] / "box_world.yaml")


@pytest.mark.parametrize("sink", [Console(), RerunSink(), McapSink()], ids=lambda sink: type(sink).__name__)
def test_a_sink_keeps_its_contract(sink, tmp_path):
    check_sink(sink, tmp_path)


def test_a_folder_keeps_the_contract_of_sensors(tmp_path):
    rng = np.random.default_rng(0)
    for i in range(5):
        cv2.imwrite(str(tmp_path / f"{i}.png"), rng.integers(0, 255, (24, 24), np.uint8))
    rows = "".join(f"{i}.png,{i / 2},0\n" for i in range(5))
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m\n{rows}")
    check_sensor(Folder(str(tmp_path), circle_px=[12, 12, 10]), RecordedPoses())


@pytest.mark.parametrize("distance", [Features(), FeaturesTurned()], ids=lambda distance: type(distance).__name__)
def test_distances_of_features_keep_their_contract(distance):
    noise = np.random.default_rng(2).integers(0, 255, (6, 96, 96), dtype=np.uint8)
    smooth = np.stack([cv2.GaussianBlur(image, (0, 0), 2) for image in noise])
    blobs = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)
    check_distance(distance, Signatures(Sift(features=40).describe(blobs).place), equivariant=False)


# --------------------------------------------------------------------------------------------------- studies of maps
@pytest.fixture(scope="module")
def parts() -> Parts:
    sensor = Mirror(world=WORLD, size=48, samples=1)
    return Parts(sensor=sensor, descriptor=TinyImage(), distance=Poc(), localizer=Nearest())


def test_the_study_map_keeps_its_contract(parts):
    check_study(MapStudy(step_m=1.0), parts)


def test_the_study_localize_keeps_its_contract(parts):
    report = MapStudy(step_m=1.0).run(parts, Recorder(), np.random.default_rng(0))
    check_study(Localize(query_count=5), replace(parts, map=report.map))


def test_the_study_steps_keeps_its_contract(parts):
    check_study(Steps(steps_m=[1.0, 1.5], query_count=5, heading_steps=32), parts)


def test_the_study_changes_keeps_its_contract(parts):
    check_study(Changes(conditions={"higher": {"height_m": 1.3}}, step_m=1.0, query_count=5), parts)


def test_the_study_room_keeps_its_contract(parts):
    study = Room(steps_m=[0.5], neighbours=[4], query_count=3, starts=2, side=3, center_m=[0.0, 0.0])
    check_study(study, replace(parts, localizers={"smacof": Smacof()}))
