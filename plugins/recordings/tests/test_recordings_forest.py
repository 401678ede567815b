"""A rendered forest, 10 x 10 images with known positions, where it is at hand."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import GridPoses, RecordedPoses
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import panorama
from omnilab_recordings import Folder

FOREST = Path(__file__).resolve().parents[4] / "shared" / "data" / "bearingnet_forest_grid"
pytestmark = pytest.mark.skipif(not FOREST.is_dir(), reason="the forest recording is not at hand")


def forest() -> Folder:
    return Folder(str(FOREST), circle_px=[512, 512, 455, 150], sky_inside=True, blank_outside=True, turned_deg=180.0)


def test_forest_is_a_grid_of_one_metre():
    sensor = forest()
    places, rest = sensor.plan(GridPoses(every=2)), sensor.plan(RecordedPoses(without=GridPoses(every=2)))
    assert (len(places), len(rest)) == (25, 75)
    assert places.keys == sensor.plan(GridPoses(step_m=2.0)).keys
    assert np.abs(wrap_angle(heading_of(places.T_world_camera) - np.pi)).max() < 1e-12


def test_the_drone_is_left_out():
    # its frame is the only thing that never changes, and is dark, outside the horizon
    sensor = forest()
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()).at(range(0, 100, 9)))
    spread = cv2.GaussianBlur(frames.images.std(0), (9, 9), 2)
    v, u = np.indices(spread.shape)
    distance = np.hypot(u - 512, v - 512)
    assert spread[(distance > 280) & (distance < 445)].min() > 8
    assert frames.images[:, distance > 457].max() == 0


@pytest.mark.parametrize("first", [22, 44, 57])
@pytest.mark.parametrize("step", [1, 10])
def test_pictures_flow_away_from_where_the_camera_moves(first, step):
    # what lies at bearing b drifts by sin(b - direction) times something positive
    sensor = forest()
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()).at([first, first + step]))
    before, after = (np.hstack([p[:, -64:], p, p[:, :64]]) for p in panorama(frames.images, frames.camera, (64, 512)))
    flow = cv2.DISOpticalFlow.create(2).calc(before, after, None)[:, 64:-64, 0]
    drift = np.median(flow, axis=0)
    bearing = 2 * np.pi * np.arange(512) / 512 + heading_of(frames.T_world_camera[0])
    seen = np.arctan2(-(drift * np.cos(bearing)).sum(), (drift * np.sin(bearing)).sum())
    moved = np.diff(frames.T_world_camera[:, :2, 3], axis=0)[0]
    assert abs(wrap_angle(seen - np.arctan2(moved[1], moved[0]))) < np.deg2rad(25)
