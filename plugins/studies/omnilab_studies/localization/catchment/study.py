"""Catchment areas and the visual compass, as insect navigation reports them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from omnilab.api import (
    DistanceField,
    Floats,
    Image,
    Ints,
    Parts,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Signatures,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.metrics import spacing
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.methods import Method, check_comparisons, fitted_all, methods_of
from omnilab_studies.common.plots import pixels_of
from omnilab_studies.common.pose_sources import Source, plan_of_trajectory
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.scores import check_apart
from omnilab_studies.common.tables import columns_of, markdown_table
from omnilab_studies.localization.catchment import figures
from omnilab_studies.localization.catchment.layout import LAYOUT
from omnilab_studies.localization.catchment.results import (
    Catchments,
    caught,
    compass_range,
    heading_off,
    metrics_of,
    neighbourhoods,
    rows_of,
)
from omnilab_studies.localization.route_localization.drives import DriveReader
from omnilab_studies.localization.route_localization.route import arc_length

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP_NS = 100_000_000  # between two references, in the logs
CURVES = 5  # rotational difference functions that are drawn


@dataclass
class Catchment:
    """How far around a place its image leads back to it, and tells the heading (Zeil, Hofmann & Chahl, 2003).

    The image difference of every place from each reference; its catchment is from where always going to the neighbour of the
    least difference ends at the reference: an area of a grid, a length of a path or a recorded drive (Philippides et al.,
    2011). The visual compass is the rotation of the least difference, its range the distance of the nearest place from which
    it is off by more than `limit_deg`. With `descriptor=tiny_image distance=rotational_difference` that is their rotational
    image difference function, on pixels; every other method may stand beside it.
    """

    images: Source = Source.grid  # grid, path or recorded: a drive in order
    step_m: float | None = setting(0.4, above=0)  # of a grid; null: take `every` n-th row and column of a recording
    every: int | None = setting(
        None, at_least=1
    )  # of a grid: 1 takes all rows and columns; of a drive: every n-th image
    extent_m: list[float] | None = setting(None, above=0, count=2)  # size of the grid; null: all that the sensor covers
    path: str = "round"  # of the world, or a file of poses, where images=path
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    references: int = setting(25, at_least=1)  # how many, evenly from all places; all, where there are fewer
    course_m: float | None = setting(
        None, above=0, at_most=1000
    )  # headings are the course of a drive, from so far before to so far after; null: as the sensor says
    limit_deg: float = setting(45.0, above=0, at_most=180)  # of the visual compass

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_catchment_median", "METHOD_catchment_share", "METHOD_compass_range_median", "METHOD_compass_error_median",
        "places", "map_step",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.images is Source.random:
            raise ConfigError("study.images=random has no neighbours to go to; give grid, path or recorded")
        if self.images is Source.grid:
            check_step_or_every(self.step_m, self.every)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:  # noqa: ARG002
        """Describe the places, compare all with each reference: `catchment.csv` has a row for each of these and each method."""
        start_logs(record, LAYOUT, parts.sensor)
        plan = self._plan(parts)
        parts = fitted_all(parts, plan, record)
        methods = methods_of(parts)
        drive = DriveReader(methods, record, self.course_m, 0).described(parts, plan, "places")
        step_m = spacing(drive.position_m)
        check_apart(drive.position_m, step_m)
        references = evenly(len(drive), self.references)
        check_comparisons(len(drive), len(references))
        record.log("places", PlaceMap(drive.position_m))

        neighbours = neighbourhoods(drive.position_m, step_m, self.images is not Source.grid)
        shares = self._shares(drive.position_m, step_m)
        found = [
            self._catchments(m, drive.signatures[m.descriptor_name], drive.position_m, drive.heading, references, neighbours, shares)
            for m in methods
        ]  # fmt: skip
        unit = "m2" if self.images is Source.grid else "m"
        drawn = {
            "differences": figures.difference_curves(found),
            "areas": figures.areas(found[0], drive.position_m, references, unit),
        }
        if any(own.off_deg is not None for own in found):
            drawn["compass"] = figures.compass_curves(found, self.limit_deg)
        if methods[0].descriptor.rotation == "equivariant":
            place = drive.signatures[methods[0].descriptor_name].place
            drawn["rotations"] = _rotations(place, found[0].away_m[:, 0], int(references[0]))
        _log(record, found, references, drive.position_m)
        for name in ("areas", "differences"):
            record.log(name, Image(pixels_of(drawn[name]), "png"))
        metrics = metrics_of(found, unit, len(drive), step_m)
        tables = {"catchment": columns_of(rows_of(found, drive.position_m, references, list(drive.keys)))}
        return Report(metrics, tables, drawn, summary=markdown_table(metrics, "Catchment areas"), omitted=drive.omitted)

    def _plan(self, parts: Parts) -> Plan:
        if self.images is Source.grid:
            plan = parts.sensor.plan(grid_poses(self.step_m, self.every, self.extent_m, self.height_m))
        else:
            plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
            plan = plan.at(np.arange(0, len(plan), self.every or 1))
        if len(plan) < 3:
            raise DataError(f"{len(plan)} places have no catchment; give more, by a smaller step or every")
        return plan

    def _shares(self, position_m: Floats, step_m: float) -> Floats:
        """What each place (N,) stands for: a cell of the grid in m2, or a stretch of the path in m."""
        if self.images is Source.grid:
            return np.full(len(position_m), step_m**2)
        return np.asarray(np.gradient(arc_length(position_m)))

    def _catchments(
        self, method: Method, signatures: Signatures, position_m: Floats, heading: Floats, references: Ints,
        neighbours: list[Ints], shares: Floats,
    ) -> Catchments:  # fmt: skip
        """One method's differences, catchments and headings."""
        match = method.distance.match(signatures, method.distance.prepare(signatures[references]))
        difference = match.distance.astype(float)
        away_m = np.linalg.norm(position_m[:, None] - position_m[references][None], axis=2)
        inside = np.stack([caught(difference[:, r], neighbours, int(i)) for r, i in enumerate(references)], axis=1)
        off, reach = None, None
        if match.rotation_rad is not None:
            off = heading_off(match.rotation_rad, heading, references)
            known = np.where(np.isfinite(off), off, 0.0)
            reach = np.array([compass_range(known[:, r], away_m[:, r], self.limit_deg) for r in range(len(references))])
            reach[~np.isfinite(heading[references])] = np.nan
        return Catchments(method.name, difference, away_m, inside, shares @ inside, off, reach)


def _rotations(place: Floats, away_m: Floats, reference: int) -> Figure:
    """The rotational difference functions of places at several distances from a reference."""
    chosen = np.argsort(away_m, kind="stable")[(np.linspace(0, 1, CURVES) ** 2 * (len(away_m) - 1)).astype(int)]
    images = place.reshape(len(place), -1, place.shape[-1]).astype(float)
    turned = [np.roll(images[reference], -k, axis=-1) for k in range(images.shape[-1])]
    curves = np.array([[np.sqrt(np.mean((images[i] - one) ** 2)) for one in turned] for i in chosen])
    return figures.rotations(curves, away_m[chosen])


def _log(record: Recorder, found: list[Catchments], references: Ints, position_m: Floats) -> None:
    """Catchments of all references by every method, and the first method's differences."""
    steps = np.arange(len(references))
    for own in found:
        record.log(f"catchment/{own.method.replace(' + ', '_')}", Series(own.size, steps, STEP_NS * steps, "m"))
    for r in steps:
        record.log(
            "distances",
            DistanceField(position_m, found[0].difference[:, r].astype(np.float32)),
            Tick(int(r), int(STEP_NS * r)),
        )
