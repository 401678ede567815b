"""A study: whether the place that looks most alike is a neighbour."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from omnilab import (
    Bools,
    Bytes,
    DataError,
    Descriptor,
    Floats,
    GridPoses,
    Image,
    Ints,
    Metric,
    Panel,
    Parts,
    PlaceMap,
    Recorder,
    Report,
    Series,
    Signatures,
    Study,
    Tick,
    Trainable,
    ViewLayout,
    check_settings,
    setting,
)
from omnilab.image import view_of
from omnilab.limits import check_work

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAYOUT = ViewLayout(  # of the viewer: columns of panels, each with paths of records
    columns=(
        (Panel("map", "Places", ("room", "places")),),
        (
            Panel("image", "Image", ("image",)),
            Panel("plot", "Distance to the most alike", ("error/distance_m",)),
            Panel("text", "Result", ("summary",)),
        ),
    )
)


@dataclass
class MyStudy:
    """Describes places on a grid and asks of each which other place looks most alike.

    With a good descriptor that is one of its neighbours on the grid. Measured are the
    share of the places of which it is, and how far away it is. `places.csv` has a row for
    each place.
    """

    spacing_m: float = setting(0.5, above=0)  # of the grid

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance")
    metric_names: ClassVar[tuple[str, ...]] = (
        "neighbour_rate",
        "distance_median_m",
        "places",
    )

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the places, compare each with all others, measure."""
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        signatures, position_m, omitted = self._described(parts, record)
        record.log("places", PlaceMap(position_m))
        answer = self._most_alike(parts, record, signatures)
        distance_m = np.linalg.norm(position_m[answer] - position_m, axis=1)
        steps = np.arange(len(answer))
        record.log("error/distance_m", Series(distance_m, steps, steps, "m"))
        neighbour = distance_m < 1.5 * self.spacing_m  # diagonals included
        metrics = [
            Metric("neighbour_rate", float(neighbour.mean()), "1"),
            Metric("distance_median_m", float(np.median(distance_m)), "m"),
            Metric("places", len(answer), "1"),
        ]
        x_m, y_m, _ = position_m.T
        table = {"x_m": x_m, "y_m": y_m, "answer": answer, "distance_m": distance_m}
        figures = {"answers": _figure(position_m, answer, neighbour)}
        summary = f"{neighbour.mean():.0%} of the places look like a neighbour."
        return Report(metrics, {"places": table}, figures, None, {}, summary, omitted)

    def _described(
        self, parts: Parts, record: Recorder
    ) -> tuple[Signatures, Floats, list[str]]:
        """Signatures and positions (P, 3) of the places, and what was left out."""
        plan = parts.sensor.plan(GridPoses(self.spacing_m))
        views, positions, omitted = list[Bytes](), list[Floats](), list(plan.omitted)
        view, color = parts.descriptor.view, parts.descriptor.color
        for frames in record.track(parts.sensor.frames(plan), "places", len(plan)):
            if frames.T_world_camera is None:
                raise DataError("the images have no poses; give a sensor that has")
            views.append(view_of(frames.images, frames.camera, view, color))
            positions.append(frames.T_world_camera[:, :3, 3])
            omitted += frames.omitted
            step = int(frames.plan_index[0])
            tick = Tick(step, int(frames.stamps_ns[0]))
            record.log("image", Image(frames.images[0]), tick)
        if sum(map(len, views)) < 3:
            raise DataError(f"spacing_m={self.spacing_m} gives less than 3 places")
        images = np.concatenate(views)
        with record.timed("describe", len(images)):
            signatures = _trained(parts.descriptor, images).describe(images)
        return signatures, np.concatenate(positions), omitted

    def _most_alike(
        self, parts: Parts, record: Recorder, signatures: Signatures
    ) -> Ints:
        """For each place the other one of the smallest distance, (P,)."""
        count = len(signatures)
        pairs = 8 * count**2  # bytes
        check_work("distances of all pairs", "give a larger spacing_m", memory=pairs)
        with record.timed("match", count):
            index = parts.distance.prepare(signatures)
            distance = parts.distance.match(signatures, index).distance.copy()
        np.fill_diagonal(distance, np.inf)
        return np.asarray(distance.argmin(axis=1))


def _trained(descriptor: Descriptor | Trainable, images: Bytes) -> Descriptor:
    """The descriptor, trained on the images where it has to be."""
    return descriptor.fit(images) if isinstance(descriptor, Trainable) else descriptor


def _figure(position_m: Floats, answer: Ints, neighbour: Bools) -> "Figure":
    """The places, with a line from each to the one that it looks like."""
    from matplotlib.figure import Figure  # imported when it is needed: it takes time

    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.subplots()
    for right, color in ((True, "tab:green"), (False, "tab:red")):
        chosen = neighbour == right
        start, end = position_m[chosen], position_m[answer[chosen]]
        axes.plot([start[:, 0], end[:, 0]], [start[:, 1], end[:, 1]], color=color)
    axes.plot(*position_m[:, :2].T, "k.")
    title = "Each place and the one that looks most alike\n(green: a neighbour)"
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title, aspect="equal")
    return figure


# a type checker compares it with the contract:
_: type[Study] = MyStudy
