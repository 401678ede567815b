"""The kinds of components: one Protocol each, the table of kinds, and what studies are given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from omnilab.api.data import (
    Bools,
    Bytes,
    Camera,
    Closures,
    Embedding,
    Estimates,
    Floats,
    Frames,
    Heights,
    ImageFeatures,
    Ints,
    Match,
    Motion,
    Optimized,
    Places,
    PoseGraph,
    Signatures,
    Unusable,
    Watch,
)
from omnilab.api.poses import Plan, PoseRequest
from omnilab.api.records import Mesh, Record, Tick
from omnilab.api.results import Recorder, Report
from omnilab.api.shards import Shards


@runtime_checkable
class Sensor(Protocol):
    """Images of the world. Virtual ones image any pose; recorded ones say which of theirs a layout takes.

    A virtual one may have `imaged_world` (name, digest), its class `shipped_worlds()`. `live = True`: the plan is the most that comes.
    """

    def plan(self, layout: PoseRequest) -> Plan:
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


class DescriptorDeclaration(Protocol):
    """What a descriptor declares about itself, before and after it was trained."""

    view: ClassVar[str]  # the image it wants: "mirror" (square, as taken), "panorama" (counter-clockwise) or "sphere"
    rotation: ClassVar[str]  # under a rotation of the camera its signatures are "equivariant" (the last axis shifts),
    # "invariant", or neither ("none")
    default_distance: ClassVar[str]  # the distance it is compared with where none is named

    @property
    def color(self) -> bool:
        """Whether it wants RGB images, or grey ones: a class attribute, or a setting."""


@runtime_checkable
class Descriptor(DescriptorDeclaration, Protocol):
    """Turns images into signatures, and declares `view`, `color`, `rotation` and `default_distance`.

    What an image's signature is depends on the image and the settings alone, bit for bit: the cache keeps signatures
    image by image. Where the rest of a batch or anything else plays a part, `cached = False` beside the four says so.
    """

    def describe(self, images: Bytes) -> Signatures:
        """Signatures of images (N, H, W) or, with `color`, (N, H, W, 3)."""


@runtime_checkable
class TrainedDescriptor(Descriptor, Protocol):
    """A descriptor that was trained on a map's images, and can be saved with the map."""

    def state(self) -> Mapping[str, npt.NDArray[Any]]:
        """All that was trained, as arrays of numbers."""


@runtime_checkable
class Trainable(DescriptorDeclaration, Protocol):
    """A descriptor that must be trained on the map's images before it can describe; it may fill a descriptor's slot."""

    def fit(self, images: Bytes) -> TrainedDescriptor:
        """The descriptor trained on the views (N, H, W[, 3]) of the map's images."""

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> TrainedDescriptor:
        """The descriptor whose `state` that was; DataError if it is of another class or of other settings."""


@runtime_checkable
class Distance(Protocol):
    """Compares signatures and, where it can, estimates the rotation between them."""

    def prepare(self, places: Signatures) -> Any:
        """What can be computed once per map. `match` takes it as `index`."""

    def match(self, queries: Signatures, index: Any) -> Match:
        """Every query against every place."""


@runtime_checkable
class Localizer(Protocol):
    """Estimates where a query was taken."""

    def prepare(self, places: Places, distance: Distance) -> Any:
        """The map made ready. `locate` takes it as `index`."""

    def locate(self, queries: Signatures, index: Any) -> Estimates:
        """Where each query was taken."""


@runtime_checkable
class Embedder(Protocol):
    """A localizer that makes a map of its own out of nothing but how unlike images are."""

    def embed(self, distance: Floats, rng: np.random.Generator, steps: int = 0) -> Embedding:
        """Place B sets of n points, from distances (B, n, n), several starts each where the method needs them: the best.

        With `steps`, about so many states on the way to the best are kept. Infinite distances do not count.
        """


@runtime_checkable
class SequenceLocalizer(Protocol):
    """A localizer that remembers: its index follows one sequence of queries, in order."""

    def track(self, queries: Signatures, index: Any, motion: Floats) -> Estimates:
        """As `locate`, knowing the motion (Q, 3) up to each query since the one before, in the camera's frame there.

        Metres forward (+x), metres to the left (+y), radians counter-clockwise; NaN where it is not known.
        """


@runtime_checkable
class Altimeter(Protocol):
    """Estimates by how much two images of one column differ in height."""

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Heights of tests (N, H, W) over references (N, H, W), or over one reference (1, H, W), all of one camera."""


@runtime_checkable
class Odometry(Protocol):
    """Estimates how the camera moved from one image to another, mostly to the next."""

    def extract(self, frames: Frames) -> Sequence[Any]:
        """What `estimate` needs of each image of a batch; an `Unusable` of one in which nothing can be made out.

        What it extracts is its own business, but for `ImageFeatures`: these are handed to the loop closure, too.
        """

    def estimate(self, before: Any, now: Any, rng: np.random.Generator) -> Motion:
        """The motion between two images, from what was extracted of them; both are usable."""


@runtime_checkable
class PlaceDatabase(Protocol):
    """The images of a robot's trajectory, so far. They are numbered as they come, from 0: nodes."""

    def query(
        self, frames: Frames, features: ImageFeatures | Unusable | None, step: float, rng: np.random.Generator
    ) -> Closures:
        """Which earlier nodes show the place of the next image (a batch of one); it becomes a node itself.

        `features` are those that the odometry extracted from the image, or why it is unusable; None where the odometry
        extracts something else. `step` is the usual length of the odometry's steps so far.
        """


@runtime_checkable
class LoopClosure(Protocol):
    """Recognises places that the robot has been to before."""

    def begin(self) -> PlaceDatabase:
        """A database without images."""


@runtime_checkable
class Backend(Protocol):
    """Moves the poses of a graph to where they fit the measured motions best."""

    def optimize(self, graph: PoseGraph, covariances: bool = False) -> Optimized:
        """The graph's optimum, its first pose kept; DataError if the graph is unsound.

        A solver that diverges or fails costs no map: the last good poses come back, and what happened is a warning.
        """


@runtime_checkable
class IncrementalGraph(Protocol):
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
class IncrementalBackend(Protocol):
    """A back end that can take poses as they come."""

    def begin(self, first_pose: Floats) -> IncrementalGraph:
        """A map with one pose (k,), which stays."""

    def optimize(self, graph: PoseGraph, covariances: bool = False, watch: Watch | None = None) -> Optimized:
        """As `Backend`'s, pose by pose; `watch` is told each but the first: its row, the map so far, what went wrong."""


@runtime_checkable
class ViewMap(Protocol):
    """A robot's pose and those of the views it has taken, as they become known. Poses are planar: x, y, heading.

    Views are numbered as they come, from 0. Two angles show one: its bearing, atan2(y_i - y, x_i - x) - heading, and its
    relative orientation, heading_i - heading. A filter that declares `observes = "landmarks"` has points instead, x, y, z
    over the camera, by azimuth and elevation. What goes wrong is a warning, and costs no more than what it is about.
    """

    def predict(self, motion: Floats, covariance: Floats) -> Sequence[str]:
        """The robot moved by (3,), in its own frame, by odometry with covariance (3, 3)."""

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

    A study of what describing costs says `cached: ClassVar[bool] = False`: its descriptors describe each time. With its
    `metric_names: ClassVar[tuple[str, ...]]`, a misspelt `objective` is refused. With `shard_stages`, its work can be split.
    """

    needs: ClassVar[tuple[str, ...]]

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Do the work; log meanwhile; return the results."""


@runtime_checkable
class Sink(Protocol):
    """Writes records in its own format, those it has a form for. It may also have the method of `TakesResult`."""

    def open(self, folder: Path) -> None:
        """Start writing into the run folder, which a runner has given its `manifest.json` and `config.yaml`."""

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Take one record, whose arrays can only be read, and may change later. ValueError costs this record only."""

    def flush(self) -> None:
        """Make sure that what was taken survives the death of the process. Called every half second."""

    def close(self) -> None:
        """Complete the files. Like `flush`, it is called by a thread of the sink's own."""

    def repair(self, folder: Path) -> str | None:
        """Mend this sink's file of a run that was killed: what was done in a sentence, None if nothing was amiss."""


# --------------------------------------------------------------------------------------------------------- the table
@dataclass(frozen=True)
class Kind:
    """One kind of component. What a run, a study's parts and the hooks are made of is derived from these."""

    name: str  # the slot of a run that holds one, and the config group
    plural: str  # the setting of a run that holds any number, by name
    protocol: type[Any]
    summary: str
    slot: bool = True  # a run has a slot for one: `descriptor=radon`
    many: bool = True  # a run may have any number: `+descriptor@descriptors.a=radon`
    part: bool = True  # studies are given it

    @property
    def hook(self) -> str:
        """The name of the hook by which plugins register components of this kind."""
        return f"register_{self.plural}"


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("sensor", "sensors", Sensor, "Sources of images: virtual worlds, folders of images, logs played back."),
        Kind("disturbance", "disturbances", Disturbance, "From images to disturbed ones: noise, occlusion, blur, another light.", slot=False),
        Kind("descriptor", "descriptors", Descriptor, "From images to signatures."),
        Kind("distance", "distances", Distance, "From pairs of signatures to how unlike they are, and the rotation between them."),
        Kind("localizer", "localizers", Localizer, "From a query and a map to a pose."),
        Kind("altimeter", "altimeters", Altimeter, "From two images to the difference of their heights."),
        Kind("odometry", "odometries", Odometry, "From two images to the motion between them."),
        Kind("loop_closure", "loop_closures", LoopClosure, "From an image to the places on the robot's trajectory that it shows again.", many=False),
        Kind("backend", "backends", Backend, "From a pose graph to its optimum."),
        Kind("view_filter", "view_filters", ViewFilter, "From odometry and views seen again to a map of views."),
        Kind("study", "studies", Study, "The code of experiments: drives the components and measures.", many=False, part=False),
        Kind("sink", "sinks", Sink, "Where the records of a run go.", slot=False, part=False),
    )
}  # fmt: skip


def is_cached(component: Any) -> bool:
    """Whether descriptions may come from the cache: `cached` of a descriptor or a study, True where it says nothing."""
    return bool(getattr(component, "cached", True))


if TYPE_CHECKING:
    _GIVEN: Any = None  # by the runner, where a run has it

    @dataclass(frozen=True)
    class Parts:
        """The components a study may use, as `KINDS` has them. The runner checks that those it needs are there."""

        sensor: Sensor = _GIVEN
        descriptor: Descriptor = _GIVEN
        distance: Distance = _GIVEN
        localizer: Localizer = _GIVEN
        altimeter: Altimeter = _GIVEN
        odometry: Odometry = _GIVEN
        loop_closure: LoopClosure = _GIVEN
        backend: Backend = _GIVEN
        view_filter: ViewFilter = _GIVEN
        sensors: Mapping[str, Sensor] = _GIVEN  # that the study uses beside the run's own
        disturbances: Mapping[str, Disturbance] = _GIVEN  # of the queries, in the order they apply
        descriptors: Mapping[str, Descriptor] = _GIVEN  # that the study compares, by name
        distances: Mapping[str, Distance] = _GIVEN  # that it compares them with
        localizers: Mapping[str, Localizer] = _GIVEN
        altimeters: Mapping[str, Altimeter] = _GIVEN
        odometries: Mapping[str, Odometry] = _GIVEN  # that join the run's own
        backends: Mapping[str, Backend] = _GIVEN
        view_filters: Mapping[str, ViewFilter] = _GIVEN
        map: Places = _GIVEN  # a saved one
        shards: Shards = _GIVEN  # what of the work is done here: all, unless the run is one shard of many
        default_distances: Mapping[str, Distance] = _GIVEN  # of each of `descriptors`, its own

else:
    Parts = make_dataclass(
        "Parts",
        [
            *((kind.name, Any, None) for kind in KINDS.values() if kind.part and kind.slot),
            *((kind.plural, Any, field(default_factory=dict)) for kind in KINDS.values() if kind.part and kind.many),
            *[("map", Any, None), ("shards", Any, Shards())],
            ("default_distances", Any, field(default_factory=dict)),
        ],
        frozen=True,
        namespace={"__doc__": "The components a study may use, as `KINDS` has them; see above for their types."},
    )
    Parts.__module__ = __name__
