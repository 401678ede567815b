"""Saved views: written as a data set, and known to another run from the start."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Camera, Floats, Frames, Parts, Plan, RecordedPoses, Recorder, Text
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab_studies.common.dataset_files import DataSet, component_settings, contents_of, default_settings
from omnilab_studies.common.frames import deliver

KNOWN = "known"  # the sensor of views from before


def check_sensors(parts: Parts) -> None:
    """ConfigError for sensors that the study does not use."""
    for name in parts.sensors:
        if name != KNOWN:
            raise ConfigError(f"sensors.{name} is not used; views from before come from sensors.{KNOWN}")


def known_views(parts: Parts, camera: Camera, record: Recorder) -> Iterator[Frames]:
    """Views from before, one by one with their poses; DataError if they have none, or are of another camera."""
    if KNOWN not in parts.sensors:
        return
    sensor = parts.sensors[KNOWN]
    plan = sensor.plan(RecordedPoses())
    if plan.T_world_camera is None:
        raise DataError(f"the images of sensors.{KNOWN} have no poses; give it some, or leave it out")
    for frames in deliver(replace(parts, sensor=sensor), plan, record, "known views"):
        if frames.camera != camera:
            raise DataError(
                f"the views of sensors.{KNOWN} were taken by another camera ({frames.camera}) than the images ({camera});"
                " give views of the same camera"
            )
        for i in range(len(frames)):
            yield frames.at(i)


class ViewWriter:
    """Writes a map's views as a data set, which the sensor `folder` reads: images as they come, poses at the end."""

    def __init__(self, folder: str, parts: Parts, plan: Plan, seed: int, settings: Mapping[str, Any]) -> None:
        used = {"odometry": parts.odometry, **parts.odometries, **parts.sensors, **parts.view_filters}
        components = {name: component_settings(part) for name, part in used.items()}
        self._contents = {**contents_of(parts, plan, seed), "seed": seed, "asked": components, "settings": settings}
        self._data = DataSet(Path(folder), "study.keep")
        defaults = {"asked": {name: default_settings(part) for name, part in used.items()}}
        self._data.open(self._contents, {"sensor": default_settings(parts.sensor), **defaults})
        self._keys, self._stamps_ns, self._heights_m = list[str](), list[int](), list[float]()

    def add(self, frame: Frames, record: Recorder) -> None:
        """One more view, a batch of one."""
        assert frame.T_world_camera is not None
        if not self._keys:
            record.log("log", Text(self._data.write_camera(frame.camera)))
        self._data.write(len(self._keys), frame.images[0], None)
        self._keys.append(frame.keys[0])
        self._stamps_ns.append(int(frame.stamps_ns[0]))
        self._heights_m.append(float(frame.T_world_camera[0, 2, 3]))

    def close(self, poses: Floats) -> None:
        """Write their poses (N, 3) in the map, at the heights that they were taken at."""
        plan = Plan(self._keys, planar_poses(np.column_stack([poses[:, :2], self._heights_m]), poses[:, 2]))
        self._data.write_poses(np.arange(len(plan)), plan, np.array(self._stamps_ns), None)
        self._data.close(self._contents, {"views": len(plan)})
