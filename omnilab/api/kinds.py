"""The kinds of components: one Protocol each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from omnilab.api.data import (
    Arrangement,
    Bools,
    Bytes,
    Camera,
    Closures,
    Estimates,
    Floats,
    Frames,
    Heights,
    Ints,
    Match,
    Motion,
    Optimized,
    Places,
    PoseGraph,
    Signatures,
)
from omnilab.api.poses import Layout, Plan
from omnilab.api.records import Mesh, Record, Tick
from omnilab.api.results import Recorder, Report


@runtime_checkable
class Sensor(Protocol):
    """Images of the world. Virtual ones image any pose; recorded ones say which of theirs a layout takes."""

    def plan(self, layout: Layout) -> Plan:
        """Which frames the sensor has for a layout; DataError in one sentence if it has none."""

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned frames, batch by batch, in the plan's order."""

    def scene(self) -> Mesh | None:
        """What the viewer shows of the world around the poses, where it is known."""


@runtime_checkable
class Disturbance(Protocol):
    """Spoils images. Studies let queries pass through every disturbance, in order, and never the places."""

    def apply(self, images: Bytes, camera: Camera, rngs: Sequence[np.random.Generator]) -> Bytes:
        """New images like the given ones, (N, H, W) or (N, H, W, 3), which stay as they are.

        Image i draws from `rngs[i]` alone, so that it comes out the same in any batch.
        """


@runtime_checkable
class Descriptor(Protocol):
    """Turns images into signatures. Declares four things about itself as class attributes.

    What an image's signature is depends on the image and the settings alone, bit for bit: the cache keeps signatures
    image by image. Where the rest of a batch or anything else plays a part, `cached = False` beside the four says so.
    """

    view: ClassVar[str]  # the picture it wants: "mirror" (square, as taken) or "panorama" (columns counter-clockwise)
    color: ClassVar[bool]  # RGB (True) or grey
    turned: ClassVar[
        str
    ]  # what a turn of the camera does to it: "shifts" the last axis, nothing ("same"), or "changes"
    default_distance: ClassVar[str]  # the distance it is compared with where none is named

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of images (N, H, W) or, with `color`, (N, H, W, 3)."""


@runtime_checkable
class Learnt(Descriptor, Protocol):
    """What a learner has learnt: a descriptor that can be saved with a map."""

    def state(self) -> Mapping[str, npt.NDArray[Any]]:
        """All that was learnt, as arrays of numbers."""


@runtime_checkable
class Learner(Protocol):
    """A descriptor that must see the map before it can describe."""

    def fit(self, images: Bytes) -> Learnt:
        """The descriptor that was learnt from the views (N, H, W[, 3]) of the map's images."""

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> Learnt:
        """The descriptor whose `state` that was; DataError if it is not one of this learner's, with these settings."""


@runtime_checkable
class Distance(Protocol):
    """Compares signatures and, where it can, tells the rotation between them."""

    def prepare(self, places: Signatures) -> Any:
        """What can be computed once per map. `match` takes it as `index`."""

    def match(self, queries: Signatures, index: Any) -> Match:
        """Every query against every place."""


@runtime_checkable
class Localizer(Protocol):
    """Answers where a query was taken."""

    def prepare(self, places: Places, distance: Distance) -> Any:
        """The map made ready. `locate` takes it as `index`."""

    def locate(self, queries: Signatures, index: Any) -> Estimates:
        """Where each query was taken."""


@runtime_checkable
class MapMaker(Protocol):
    """A localizer that makes a map of its own out of nothing but how unlike images are."""

    def arrange(self, distance: Floats, rng: np.random.Generator, steps: int = 0) -> Arrangement:
        """Place B sets of n points, from distances (B, n, n), several starts each where the method needs them: the best.

        With `steps`, about so many states on the way to the best are kept. Infinite distances do not count.
        """


@runtime_checkable
class Tracker(Protocol):
    """A localizer that remembers: its index follows one sequence of queries, in order."""

    def follow(self, queries: Signatures, index: Any, motion: Floats) -> Estimates:
        """As `locate`, knowing the motion (Q, 3) up to each query since the one before, in the camera's frame there.

        Metres forward (+x), metres to the left (+y), radians counter-clockwise; NaN where it is not known.
        """


@runtime_checkable
class Altimeter(Protocol):
    """Tells by how much two images of one column differ in height."""

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Heights of tests (N, H, W) over references (N, H, W), or over one reference (1, H, W), all of one camera."""


@runtime_checkable
class Odometry(Protocol):
    """Tells how the camera moved from one image to another, mostly to the next."""

    def look(self, frames: Frames) -> Sequence[Any]:
        """What it keeps of each image of a batch; an `Unusable` of one in which nothing can be made out."""

    def motion(self, before: Any, now: Any, rng: np.random.Generator) -> Motion:
        """The motion between two images, from what was kept of them; both are usable."""


@runtime_checkable
class Memory(Protocol):
    """The images of a robot's way, so far. They are numbered as they come, from 0: nodes."""

    def recall(self, frames: Frames, look: Any, step: float, rng: np.random.Generator) -> Closures:
        """Which earlier nodes show the place of the next image (a batch of one); it becomes a node itself.

        `look` is what the odometry kept of it, `step` the usual length of its steps so far.
        """


@runtime_checkable
class LoopClosure(Protocol):
    """Recognises places that the robot has been to before."""

    def begin(self) -> Memory:
        """A memory without images."""


@runtime_checkable
class Backend(Protocol):
    """Moves the poses of a graph to where they fit the measured motions best."""

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """The graph's optimum, its first pose kept; DataError if the graph is unsound.

        A solver that diverges or fails costs no map: the last good poses come back, and what happened is said.
        """


@runtime_checkable
class Growing(Protocol):
    """A map to which one pose after the other is added. Poses are numbered as they come, from 0."""

    def add(self, pose: Floats, edges: Ints, motions: Floats, information: Floats) -> Sequence[str]:
        """Add pose (k,), a guess, with its edges (e, 2) to or from poses that are there: what went wrong, in sentences.

        Motions are (e, k), information (e, d, d), as in `PoseGraph`. An update that fails costs no map: the new pose
        stays where it was guessed, tied loosely to the one before it.
        """

    def pose(self, number: int) -> Floats:
        """One pose (k,), as it is now; quick, however many there are."""

    def poses(self) -> Floats:
        """All poses (n, k), as they are now."""


@runtime_checkable
class OnlineBackend(Protocol):
    """A back end that can take poses as they come."""

    def begin(self, first_pose: Floats) -> Growing:
        """A map with one pose (k,), which stays."""


@runtime_checkable
class ViewMap(Protocol):
    """A robot's pose and those of the views it has taken, as they become known. Poses are planar: x, y, heading.

    Views are numbered as they come, from 0. A view is observed by two angles: its bearing in the robot's frame,
    atan2(y_i - y, x_i - x) - heading, and its relative orientation, heading_i - heading. What goes wrong is said in
    sentences, and costs no more than the step or the observation it is about.
    """

    def predict(self, motion: Floats, covariance: Floats) -> Sequence[str]:
        """The robot moved by (3,), in its own frame, as odometry tells with covariance (3, 3)."""

    def observe(self, views: Ints, angles_rad: Floats, covariances: Floats) -> tuple[Bools, Sequence[str]]:
        """It sees views (K,) at bearings and relative orientations (K, 2), covariances (K, 2, 2): which (K,) it believes."""

    def add_view(self) -> int:
        """The robot takes a view where it is: the number of that."""

    def know_view(self, pose: Floats, covariance: Floats) -> int:
        """A view that was taken before, at a pose (3,) known with covariance (3, 3), by itself: the number of that."""

    def pose(self) -> tuple[Floats, Floats]:
        """The robot's pose (3,) and its covariance (3, 3), of x, y and heading in the world's frame."""

    def views(self) -> Floats:
        """The poses (N, 3) of the views."""

    def view_covariances(self) -> Floats:
        """Their covariances (N, 3, 3), of x, y and heading in the world's frame."""

    def finish(self) -> Floats:
        """All has been seen: the robot's poses (T, 3), the first and one after each prediction, as well as they can be known."""


@runtime_checkable
class ViewFilter(Protocol):
    """Builds a map of views out of odometry and the directions in which the views are seen again."""

    def begin(self, pose: Floats, covariance: Floats) -> ViewMap:
        """A map without views, the robot being at a pose (3,) with covariance (3, 3)."""


@runtime_checkable
class Study(Protocol):
    """Drives components and measures. `needs` names the parts without which it cannot run.

    A study of what describing costs says `cached: ClassVar[bool] = False` beside it: its descriptors describe each time,
    whereas others may get theirs from the cache.
    """

    needs: ClassVar[tuple[str, ...]]

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Do the work; log on the way; return what was found."""


@runtime_checkable
class Sink(Protocol):
    """Writes records in its own format. A sink skips the kinds of record it has no form for."""

    def open(self, folder: Path) -> None:
        """Start writing into the run folder."""

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Take one record."""

    def flush(self) -> None:
        """Make sure that what was taken survives the death of the process. Called every second."""

    def close(self) -> None:
        """Complete the files."""

    def repair(self, folder: Path) -> str | None:
        """Mend this sink's file of a run that was killed: what was done in a sentence, None if nothing was amiss."""


@dataclass(frozen=True)
class Parts:
    """The components a study may use. The runner checks that those it needs are there."""

    sensor: Sensor = None  # type: ignore[assignment]
    descriptor: Descriptor = None  # type: ignore[assignment]
    distance: Distance = None  # type: ignore[assignment]
    localizer: Localizer = None  # type: ignore[assignment]
    altimeter: Altimeter = None  # type: ignore[assignment]
    odometry: Odometry = None  # type: ignore[assignment]
    loop_closure: LoopClosure = None  # type: ignore[assignment]
    backend: Backend = None  # type: ignore[assignment]
    view_filter: ViewFilter = None  # type: ignore[assignment]
    map: Places = None  # type: ignore[assignment]  # a saved one
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # that the study uses beside the run's own
    disturbances: Mapping[str, Disturbance] = field(default_factory=dict)  # of the queries, in the order they apply
    descriptors: Mapping[str, Descriptor] = field(default_factory=dict)  # that the study compares, by name
    distances: Mapping[str, Distance] = field(default_factory=dict)  # that it compares them with
    localizers: Mapping[str, Localizer] = field(default_factory=dict)  # that the study compares
    altimeters: Mapping[str, Altimeter] = field(default_factory=dict)  # that the study compares
    odometries: Mapping[str, Odometry] = field(default_factory=dict)  # that join the run's own
    backends: Mapping[str, Backend] = field(default_factory=dict)  # that the study compares
    view_filters: Mapping[str, ViewFilter] = field(default_factory=dict)  # that the study compares
    default_distances: Mapping[str, Distance] = field(default_factory=dict)  # of each of `descriptors`, its own
