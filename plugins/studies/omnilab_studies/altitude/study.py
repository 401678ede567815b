"""Relative altitude: altimeters on columns of images."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Altimeter,
    Frames,
    Heights,
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
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import to_gray, view_of
from omnilab_studies.altitude import figures
from omnilab_studies.altitude.layout import layout_of
from omnilab_studies.altitude.results import AltitudeCase, AltitudeResults, HeightEstimates, markdown_of
from omnilab_studies.common.describing import check_views
from omnilab_studies.common.disturbance_levels import check_levels, levels_of
from omnilab_studies.common.frames import disturbed
from omnilab_studies.common.image_columns import (
    Column,
    Reference,
    check_heights,
    check_positions,
    columns_in,
    free_columns,
)
from omnilab_studies.common.tables import columns_of

FRAME_NS = 100_000_000  # between two images, in the logs


@dataclass
class Altitude:
    """Study of relative altitude (Berenguer, thesis, 5.5): the heights that altimeters estimate, against the true ones.

    Columns of images over random free positions, each camera at a random heading, or those of a recording. Each image is
    compared with each reference of its column, clear and at every level of the run's disturbances; the references stay
    clear. Per reference: the rate of right signs of rises of 0.1 m or more; slope and r2 of the line fitted to each
    column within `range_m` of the reference (r2: the median over the columns); after one scale for all columns, from
    the clear estimates, the root mean square error and the bias in metres; and the spread, the mean over the heights of
    the standard deviation over the columns of the estimate divided by its column's largest. The first column is shown
    as it rises, against the last reference.
    """

    recorded: bool = False  # the columns of a recording, all of them, rather than virtual ones
    positions_m: list[Any] | None = setting(None)  # [[x, y], ...] of virtual columns; null: random ones
    position_count: int = setting(
        7, at_least=1, at_most=1_000_000
    )  # random columns; of the 14 in the thesis, half in each of its two worlds
    heights_m: list[float] = setting([0.1, 2.0, 0.1], count=3)  # [lowest, highest, step] of virtual columns
    turned: bool = True  # every virtual image has a heading of its own
    references_m: list[float] = setting([0.1, 1.0])  # heights of the references
    references_h: list[int] | None = setting(
        None, at_least=1
    )  # or which image of a column, 1 the lowest; null: by references_m
    range_m: float = setting(1.0, above=0)  # around the reference, where lines are fitted
    levels: dict[str, dict[str, list[Any]]] = setting({})  # of a disturbance: {setting: [values]}
    corrections: list[str] = setting([])  # disturbances that follow each level, such as upright_adjustment

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "ALTIMETER_sign_clear", "ALTIMETER_sign_rate_LEVEL_REFERENCE", "ALTIMETER_r2_median_LEVEL_REFERENCE",
        "ALTIMETER_rms_m_LEVEL_REFERENCE", "ALTIMETER_rms_near_m_LEVEL_REFERENCE", "ALTIMETER_bias_m_LEVEL_REFERENCE",
        "ALTIMETER_spread_LEVEL_REFERENCE", "ALTIMETER_slope_LEVEL_REFERENCE",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_positions(self.positions_m)
        check_heights(self.heights_m)
        if not (self.references_m if self.references_h is None else self.references_h):
            raise ConfigError("study.references_m or study.references_h names no reference; give at least one")
        if len(set(self._references)) < len(self._references):
            raise ConfigError("study.references_m or study.references_h names a reference twice; leave one out")
        check_levels(self.levels)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Image the columns, disturb the tests, estimate their heights with every altimeter, score."""
        altimeters = _altimeters(parts)
        levels = levels_of(self.levels, parts.disturbances, record, self.corrections)
        if scene := parts.sensor.scene():
            record.log("room", scene)

        plan = self._plan(parts, rng)
        columns, omitted = self._columns(plan)
        record.log("places", PlaceMap(np.array([[*column.position_m, column.height_m[0]] for column in columns])))
        seed = int(rng.integers(2**32))

        results = AltitudeResults(levels, [str(reference) for reference in self._references], self.range_m)
        seconds = dict.fromkeys(altimeters, 0.0)
        count = sum(len(column.index) for column in columns)
        images = _images(parts, plan, columns)
        for number, frames in record.track(images, "images", count, lambda item: len(item[1])):
            if number == 0:
                curves = _warm_up(altimeters, frames)
                record.log("", layout_of(curves, parts.descriptor is not None))
                _show_images(record, parts, frames)
            self._estimate(altimeters, number, columns[number], frames, seed, results, seconds)

        _show_estimates(record, results)
        return _report(results, _times(results, seconds), omitted)

    def _estimate(
        self, altimeters: Mapping[str, Altimeter], number: int, column: Column, frames: Frames, seed: int,
        results: AltitudeResults, seconds: dict[str, float],
    ) -> None:  # fmt: skip
        """Add the estimates of one column, at every level, by every altimeter, against every reference; and their time."""
        rows = {str(reference): reference.row(column) for reference in self._references}
        for level in results.levels:
            tests = disturbed(frames, level.applied, seed)
            for name, altimeter in altimeters.items():
                for reference, row in rows.items():
                    start = time.perf_counter()
                    heights = altimeter.relative(frames.images[row : row + 1], tests.images, frames.camera)
                    seconds[name] += time.perf_counter() - start
                    estimates = _beside_truth(number, column, row, frames, heights)
                    results.add(AltitudeCase(name, level.title, reference), estimates)

    @property
    def _references(self) -> list[Reference]:
        if self.references_h is not None:
            return [Reference(number=number) for number in self.references_h]
        return [Reference(height) for height in self.references_m]

    def _plan(self, parts: Parts, rng: np.random.Generator) -> Plan:
        if self.recorded:
            return parts.sensor.plan(RecordedPoses())
        return free_columns(parts.sensor, self.position_count, self.positions_m, self.heights_m, self.turned, rng)

    def _columns(self, plan: Plan) -> tuple[list[Column], list[str]]:
        """The columns that have every reference, and what is omitted; DataError if none has."""
        found = columns_in(plan)
        whole = [c for c in found if all(reference.is_in(c) for reference in self._references)]
        wanted = " and ".join(map(str, self._references))
        if not whole:
            raise DataError(
                f"the references {wanted} are not all in {found[0]}, nor in another;"
                " give study.references_m or study.references_h of images that there are"
            )
        lacking = len(found) - len(whole)
        return whole, [f"{lacking} columns without the references {wanted}"] if lacking else []


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
        batches: list[Frames] = []
        for frames in parts.sensor.frames(plan.at(column.index)):
            batches.append(frames)
            if len(batches) == 1:
                check_views(frames.images, len(column.index))
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


def _beside_truth(number: int, column: Column, row: int, frames: Frames, heights: Heights) -> HeightEstimates:
    """An altimeter's heights of a column over its image `row`, with the true ones."""
    assert frames.T_world_camera is not None
    heading = heading_of(frames.T_world_camera)
    error = np.abs(wrap_angle(heights.rotation_rad - (heading - heading[row])))
    return HeightEstimates(number, column.height_m, column.height_m - column.height_m[row], heights, error)


def _warm_up(altimeters: Mapping[str, Altimeter], frames: Frames) -> list[str]:
    """Call each altimeter once, which may compile; the names of those that return curves."""
    one = frames.images[:1]
    return [name for name, altimeter in altimeters.items() if altimeter.relative(one, one, frames.camera).curves]


def _times(results: AltitudeResults, seconds: Mapping[str, float]) -> list[dict[str, Any]]:
    """Milliseconds of an estimate, both images described each time, beside the clear spread against each reference."""
    rows = []
    for score in results.scores():
        if score["level"] == results.levels[0].title:
            name = score["altimeter"]
            estimates = sum(len(part.value) for part in results.of(name))
            milliseconds = 1e3 * seconds[name] / estimates
            rows.append({
                "altimeter": name, "reference": score["reference"], "estimate_ms": milliseconds,
                "spread": score["spread"], "sign_rate": score["sign_rate"],
            })  # fmt: skip
    return rows


def _show_images(record: Recorder, parts: Parts, frames: Frames) -> None:
    """Log the first column as it rises: image, signature by the run's descriptor, pose."""
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


def _show_estimates(record: Recorder, results: AltitudeResults) -> None:
    """Log the first column's clear estimates against the last reference, in metres, and the curves they come from."""
    clear, reference = results.levels[0].title, results.references[-1]
    for name in results.altimeters:
        estimates = results.of(name, clear, reference)[0]
        steps = np.arange(len(estimates.value))
        rise_m = results.scale(name, reference) * estimates.value
        record.log(f"rise/{name}", Series(rise_m, steps, FRAME_NS * steps, "m"))
        if estimates.heights.curves:
            for i in range(len(steps)):
                record.log(f"curves/{name}", Image(figures.curve_picture(estimates, i), "png"), Tick(i, FRAME_NS * i))
    record.log("rise/truth", Series(estimates.rise_m, steps, FRAME_NS * steps, "m"))


def _report(results: AltitudeResults, times: Sequence[Mapping[str, Any]], omitted: Sequence[str]) -> Report:
    scores = results.scores()
    tables = {"altitude": columns_of(scores), "signs": results.sign_table(), "times": columns_of(times)}
    return Report(
        results.metrics(),
        {**tables, "estimates": results.estimate_table()},
        figures.altitude_figures(results, times),
        summary=markdown_of(scores),
        omitted=omitted,
    )
