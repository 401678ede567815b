"""Relative altitude: altimeters on columns of images."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Altimeter,
    Frames,
    Image,
    Parts,
    PlaceMap,
    Plan,
    Pose,
    RecordedPoses,
    Recorder,
    Report,
    Series,
    Signature,
    Text,
    Tick,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import to_gray, view_of
from omnilab_studies.altitude import figures
from omnilab_studies.altitude.layout import layout_of
from omnilab_studies.altitude.results import Altimetry, Case, Told, markdown_of
from omnilab_studies.common.disturbance_levels import check_levels, levels_of
from omnilab_studies.common.frames import disturbed
from omnilab_studies.common.image_columns import Column, Reference, columns_in, free_columns
from omnilab_studies.common.tables import columns_of
from omnilab_studies.datasets.render.study import _is_position, _is_range

FRAME_NS = 100_000_000  # between two images, in the logs


@dataclass
class Altitude:
    """Study of relative altitude (Berenguer, thesis, 5.5): the heights that altimeters tell, against the true ones.

    Columns of images over random free spots, each camera turned at random, or those of a recording. Each image is
    compared with each reference of its column, clear and at every level of the run's disturbances; the references stay
    clear. Per reference: the rate of right signs of rises of 0.1 m or more; slope and r2 of the line fitted to each
    column within `range_m` of the reference (r2: the median over the columns); after one scale for all columns, from
    the clear answers, the root mean square error and the bias in metres; and the spread, the mean over the heights of
    the standard deviation over the columns of the estimate divided by its column's largest. The first column is shown
    as it rises, against the last reference.
    """

    recorded: bool = False  # the columns of a recording, all of them, rather than virtual ones
    positions_m: list[Any] | None = None  # [[x, y], ...] of virtual columns; null: random ones
    position_count: int = 7  # random columns; of the 14 in the thesis, half in each of its two worlds
    heights_m: list[float] = field(
        default_factory=lambda: [0.1, 2.0, 0.1]
    )  # [lowest, highest, step] of virtual columns
    turned: bool = True  # every virtual image has a heading of its own
    references_m: list[float] = field(default_factory=lambda: [0.1, 1.0])  # heights of the references
    references_h: list[int] | None = None  # or which image of a column, 1 the lowest; null: by references_m
    range_m: float = 1.0  # around the reference, where lines are fitted
    levels: dict[str, dict[str, list[Any]]] = field(default_factory=dict)  # of a disturbance: {setting: [values]}

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        if self.positions_m is not None and not (self.positions_m and all(map(_is_position, self.positions_m))):
            raise ConfigError(f"study.positions_m={self.positions_m} are no positions; give [[x, y], ...] in metres")
        if self.position_count < 1:
            raise ConfigError(f"study.position_count={self.position_count} are no columns; give 1 or more")
        if not _is_range(self.heights_m):
            raise ConfigError(f"study.heights_m={self.heights_m} is no range; give [lowest, highest, step] in metres")
        if not (self.references_m if self.references_h is None else self.references_h):
            raise ConfigError("study.references_m or study.references_h names no reference; give at least one")
        if len(set(self._references)) < len(self._references):
            raise ConfigError("study.references_m or study.references_h names a reference twice; leave one out")
        if self.references_h is not None and min(self.references_h) < 1:
            raise ConfigError(f"study.references_h={self.references_h} counts images from 1, the lowest; give such")
        if not self.range_m > 0:
            raise ConfigError(f"study.range_m={self.range_m:g} is no range; give metres above 0")
        check_levels(self.levels)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Image the columns, spoil the tests, ask every altimeter, compare."""
        altimeters = _altimeters(parts)
        levels = levels_of(self.levels, parts.disturbances, record)
        if scene := parts.sensor.scene():
            record.log("room", scene)

        plan = self._plan(parts, rng)
        columns = self._columns(plan, record)
        spots = np.array([[*column.position_m, column.height_m[0]] for column in columns])
        record.log("places", PlaceMap(spots))
        seed = int(rng.integers(2**32))

        found = Altimetry(levels, [str(reference) for reference in self._references], self.range_m)
        seconds = dict.fromkeys(altimeters, 0.0)
        count = sum(len(column.index) for column in columns)
        images = _images(parts, plan, columns)
        for number, frames in record.track(images, "images", count, lambda item: len(item[1])):
            column = columns[number]
            if number == 0:
                curves = _warm_up(altimeters, frames)
                record.log("", layout_of(curves, parts.descriptor is not None))
                _show_images(record, parts, frames)
            rows = {str(reference): reference.row(column) for reference in self._references}
            for level in levels:
                tests = disturbed(frames, level.applied, seed)
                for name, altimeter in altimeters.items():
                    for reference, row in rows.items():
                        start = time.perf_counter()
                        heights = altimeter.relative(frames.images[row : row + 1], tests.images, frames.camera)
                        seconds[name] += time.perf_counter() - start
                        told = _told(number, column, row, frames, heights)
                        found.take(Case(name, level.title, reference), told)

        # what it amounts to
        _show_estimates(record, found)
        scores = found.scores()
        record.log("summary", Text(markdown_of(scores), markdown=True))
        times = _times(found, seconds)
        tables = {"altitude": columns_of(scores), "signs": found.signs(), "times": columns_of(times)}
        return Report(found.metrics(), {**tables, "estimates": found.estimates()}, figures.all_of(found, times))

    @property
    def _references(self) -> list[Reference]:
        if self.references_h is not None:
            return [Reference(number=number) for number in self.references_h]
        return [Reference(height) for height in self.references_m]

    def _plan(self, parts: Parts, rng: np.random.Generator) -> Plan:
        if self.recorded:
            return parts.sensor.plan(RecordedPoses())
        return free_columns(parts.sensor, self.position_count, self.positions_m, self.heights_m, self.turned, rng)

    def _columns(self, plan: Plan, record: Recorder) -> list[Column]:
        """Those that have every reference; DataError if none has."""
        found = columns_in(plan)
        whole = [c for c in found if all(reference.is_in(c) for reference in self._references)]
        wanted = " and ".join(map(str, self._references))
        if not whole:
            raise DataError(
                f"the references {wanted} are not all in {found[0]}, nor in another;"
                " give study.references_m or study.references_h of images that there are"
            )
        if len(whole) < len(found):
            record.log("log", Text(f"left out: {len(found) - len(whole)} columns without the references {wanted}"))
        return whole


def _altimeters(parts: Parts) -> Mapping[str, Altimeter]:
    """Those to compare, or the run's one."""
    if parts.altimeters:
        return parts.altimeters
    if parts.altimeter is None:
        raise ConfigError(
            "the study compares altimeters, and none is chosen; give altimeter=NAME, or several with"
            " +altimeter@altimeters.ANY=NAME"
        )
    return {"altimeter": parts.altimeter}


def _images(parts: Parts, plan: Plan, columns: Sequence[Column]) -> Iterator[tuple[int, Frames]]:
    """Every column's number and its images in grey, from the lowest; DataError if one is missing."""
    for number, column in enumerate(columns):
        batches = list(parts.sensor.frames(plan.at(column.index)))
        if omitted := [sentence for frames in batches for sentence in frames.omitted]:
            raise DataError(f"{column} lacks an image: {omitted[0]}; replace it, or leave the column out")
        first = batches[0]
        for frames in batches:
            if frames.images.shape[1:3] != first.images.shape[1:3]:
                raise DataError(
                    f"{column} has images of {first.images.shape[2]} x {first.images.shape[1]} and of"
                    f" {frames.images.shape[2]} x {frames.images.shape[1]} pixels; give images of one size"
                )
        T = [frames.T_world_camera for frames in batches if frames.T_world_camera is not None]
        yield (
            number,
            replace(
                first,
                images=to_gray(np.concatenate([frames.images for frames in batches])),
                keys=[key for frames in batches for key in frames.keys],
                stamps_ns=np.concatenate([frames.stamps_ns for frames in batches]),
                plan_index=column.index,
                T_world_camera=np.concatenate(T),
            ),
        )


def _told(number: int, column: Column, row: int, frames: Frames, heights: Any) -> Told:
    assert frames.T_world_camera is not None
    heading = heading_of(frames.T_world_camera)
    error = np.abs(wrap_angle(heights.rotation_rad - (heading - heading[row])))
    return Told(number, column.height_m, column.height_m - column.height_m[row], heights, error)


def _warm_up(altimeters: Mapping[str, Altimeter], frames: Frames) -> list[str]:
    """The first call may compile. Returns the names of those that show what they read their answers off."""
    one = frames.images[:1]
    return [name for name, altimeter in altimeters.items() if altimeter.relative(one, one, frames.camera).curves]


def _times(found: Altimetry, seconds: Mapping[str, float]) -> list[dict[str, Any]]:
    """Milliseconds of an estimate, both images described each time, beside the clear spread against each reference."""
    rows = []
    for score in found.scores():
        if score["level"] == found.levels[0].title:
            name = score["altimeter"]
            estimates = sum(len(told.value) for told in found.of(name))
            milliseconds = 1e3 * seconds[name] / estimates
            rows.append({
                "altimeter": name, "reference": score["reference"], "estimate_ms": milliseconds,
                "spread": score["spread"], "sign_rate": score["sign_rate"],
            })  # fmt: skip
    return rows


def _show_images(record: Recorder, parts: Parts, frames: Frames) -> None:
    """The first column as it rises: picture, what the run's descriptor makes of it, pose."""
    described = None
    if (descriptor := parts.descriptor) is not None:
        described = descriptor.describe(view_of(frames.images, frames.camera, descriptor.view, descriptor.color)).place
    for i, image in enumerate(frames.images):
        tick = Tick(i, FRAME_NS * i)
        record.log("query/image", Image(image), tick)
        if described is not None:
            record.log("query/signature", Signature(described[i].reshape(len(described[i]), -1)), tick)
        if frames.T_world_camera is not None:
            record.log("camera", Pose(frames.T_world_camera[i]), tick)


def _show_estimates(record: Recorder, found: Altimetry) -> None:
    """The first column's clear answers against the last reference, in metres, and what they were read off."""
    clear, reference = found.levels[0].title, found.references[-1]
    for name in found.altimeters:
        told = found.of(name, clear, reference)[0]
        steps = np.arange(len(told.value))
        estimate = found.scale(name, reference) * told.value
        record.log(f"rise/{name}", Series(estimate, steps, FRAME_NS * steps, "m"))
        if told.heights.curves:
            for i in range(len(steps)):
                record.log(f"curves/{name}", Image(figures.curve_picture(told, i), "png"), Tick(i, FRAME_NS * i))
    record.log("rise/truth", Series(told.rise_m, steps, FRAME_NS * steps, "m"))
