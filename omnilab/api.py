"""What passes between components: the data, the records for the logs, and one Protocol per kind.

Shapes, units and frames are stated here and only here.

* metres, radians, nanoseconds (int64) everywhere; images are uint8, grey ``(H, W)`` or RGB ``(H, W, 3)``.
* world frame: z up. Camera frame: +z up along the mirror axis.
* image of an omnidirectional camera: u runs right, v runs down; image right is the camera's +x, image up is +y, so the
  azimuth of a pixel, counter-clockwise from +x as seen from above, is ``atan2(cy - v, u - cx)``. A sensor whose
  pictures are mirrored or turned puts that right before it hands them over.
* heading: the angle from the world's +x to the camera's +x, counter-clockwise.
* ``T_world_camera`` takes points of the camera frame to the world frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

__all__ = [
    "Altimeter",
    "Answers",
    "Arrangement",
    "Backend",
    "CalibratedCamera",
    "Camera",
    "Circle",
    "Closures",
    "Descriptor",
    "Distance",
    "DistanceField",
    "Disturbance",
    "Estimate",
    "Estimates",
    "Frames",
    "Graph",
    "GridPoses",
    "Growing",
    "Heights",
    "Image",
    "Layout",
    "Learner",
    "Learnt",
    "Localizer",
    "LoopClosure",
    "MapMaker",
    "Match",
    "Memory",
    "Mesh",
    "Metric",
    "Motion",
    "NamedPath",
    "Odometry",
    "OnlineBackend",
    "Optimized",
    "Panel",
    "Parts",
    "PathPoses",
    "PlaceMap",
    "Places",
    "Plan",
    "PointCloud",
    "Pose",
    "PoseGraph",
    "Progress",
    "RandomPoses",
    "Record",
    "RecordedPoses",
    "Recorder",
    "Report",
    "Sensor",
    "Series",
    "Signature",
    "Signatures",
    "Sink",
    "Study",
    "Text",
    "Tick",
    "Tracker",
    "Unusable",
    "ViewFilter",
    "ViewLayout",
    "ViewMap",
]

Floats = npt.NDArray[np.floating[Any]]
Ints = npt.NDArray[np.integer[Any]]
Bytes = npt.NDArray[np.uint8]
Bools = npt.NDArray[np.bool_]
T = TypeVar("T")


# ---------------------------------------------------------------------------------------------- what a sensor is asked
@dataclass(frozen=True)
class GridPoses:
    """A regular grid of positions, heading 0 (a recording: as it was). Give `step_m`, or `every` n-th row and column of a recording."""

    step_m: float | None = None
    every: int | None = None
    extent_m: tuple[float, float] | None = None  # x and y, around the world's origin; None: all the sensor covers
    height_m: float | None = None  # of the viewpoint above the floor; None: the sensor's own


@dataclass(frozen=True)
class RandomPoses:
    """`count` positions drawn uniformly, with headings drawn uniformly or from the multiples of `heading_step_rad`."""

    count: int
    seed: int
    heading_step_rad: float | None = None  # None: any heading
    extent_m: tuple[float, float] | None = None
    height_m: float | None = None


@dataclass(frozen=True)
class PathPoses:
    """Given poses in a given order: `T_world_camera` (N, 4, 4)."""

    T_world_camera: Floats


@dataclass(frozen=True)
class NamedPath:
    """A path that the sensor's world knows by name, in its order."""

    name: str
    height_m: float | None = None


@dataclass(frozen=True)
class RecordedPoses:
    """All that was recorded, less what another layout takes of it."""

    without: GridPoses | None = None


Layout = GridPoses | RandomPoses | PathPoses | NamedPath | RecordedPoses


@dataclass(frozen=True)
class Plan:
    """What a sensor will deliver for a layout: N frames in this order. No image is made or read yet."""

    keys: Sequence[str]  # (N,) what names each image's content: file, or digest of world, camera and pose
    T_world_camera: Floats | None  # (N, 4, 4) float64, None where the recording has no positions
    omitted: Sequence[str] = ()  # one entry per pose or file left out, with its reason

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, indices: Iterable[int]) -> Plan:
        """The same plan, reduced to some of its frames, in the order given."""
        chosen = [int(i) for i in indices]
        poses = None if self.T_world_camera is None else self.T_world_camera[chosen]
        return Plan([self.keys[i] for i in chosen], poses)


# --------------------------------------------------------------------------------------------------------- data
@dataclass(frozen=True)
class Circle:
    """The ring of an omnidirectional image that shows the world, in pixels (pixel centres are at whole numbers)."""

    cx: float
    cy: float
    radius: float
    inner: float = 0.0  # inside it the camera sees itself


@runtime_checkable
class Camera(Protocol):
    """Where an omnidirectional image looks."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def circle(self) -> Circle: ...
    def unwrap(self, azimuth_rad: Floats, level: Floats) -> Floats:
        """Pixels (..., 2) as (u, v) of a panorama's points: level 0 is its bottom edge and 1 its top.

        A calibrated camera spaces levels evenly in elevation, an uncalibrated one evenly in radius.
        """


@runtime_checkable
class CalibratedCamera(Camera, Protocol):
    """A camera that knows where each of its pixels looks."""

    def directions(self, pixels: Floats) -> Floats:
        """Unit directions (..., 3) in the camera frame of pixels (..., 2) = (u, v); NaN where they show no world."""

    def pixels(self, directions: Floats) -> Floats:
        """Pixels (..., 2) = (u, v), also beyond the frame, of directions (..., 3); NaN for those it cannot show."""


@dataclass(frozen=True)
class Frames:
    """A batch of N images of one camera."""

    images: Bytes  # (N, H, W) or (N, H, W, 3)
    keys: Sequence[str]  # (N,)
    stamps_ns: Ints  # (N,) int64, the sensor's clock
    camera: Camera
    plan_index: Ints  # (N,) which frames of the plan these are
    T_world_camera: Floats | None = None  # (N, 4, 4)
    omitted: Sequence[str] = ()  # frames of the plan that could not be delivered here, each with its reason
    depth_m: Floats | None = None  # (N, H, W) float32: along each pixel's ray; inf where it meets nothing

    def __len__(self) -> int:
        return len(self.images)

    def at(self, i: int) -> Frames:
        """One of the images, as a batch of one."""
        one = slice(i, i + 1)
        poses = None if self.T_world_camera is None else self.T_world_camera[one]
        depth = None if self.depth_m is None else self.depth_m[one]
        return Frames(
            self.images[one], self.keys[one], self.stamps_ns[one], self.camera, self.plan_index[one], poses, (), depth
        )


@dataclass(frozen=True)
class Signatures:
    """N described images. `place` says where, `heading` (where it is an array of its own) says which way."""

    place: Floats  # (N, ...) float32
    heading: Floats | None = None  # (N, ...) float32

    def __len__(self) -> int:
        return len(self.place)

    def __getitem__(self, which: slice | Ints) -> Signatures:
        return Signatures(self.place[which], None if self.heading is None else self.heading[which])

    @property
    def nbytes(self) -> int:
        return int(self.place.nbytes + (0 if self.heading is None else self.heading.nbytes))


@dataclass(frozen=True)
class Places:
    """The map: P described images, with their poses where these are known."""

    signatures: Signatures
    T_world_camera: Floats | None  # (P, 4, 4)
    keys: Sequence[str]
    learnt: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)  # by the descriptor, where it had to learn

    def __len__(self) -> int:
        return len(self.signatures)


@dataclass(frozen=True)
class Match:
    """Q queries against P places."""

    distance: Floats  # (Q, P) float32, smaller is more alike
    rotation_rad: Floats | None = None  # (Q, P) float32: query heading - place heading


@dataclass(frozen=True)
class Estimates:
    """What a localizer answers to Q queries."""

    place: Ints  # (Q,) index of the best place
    distance: Floats  # (Q,) to that place
    position_m: Floats  # (Q, 3) world
    heading_rad: Floats | None = None  # (Q,)
    field: Floats | None = None  # (Q, P) all distances, where they were computed


@dataclass(frozen=True)
class Heights:
    """How much higher N tests were taken than their references, as an altimeter tells from the images alone."""

    value: Floats  # (N,) in the altimeter's own unit, above 0 where the test is higher; NaN where it cannot tell
    unit: str  # "m", or what it counts
    confidence: Floats  # (N,) in [0, 1]
    rotation_rad: Floats  # (N,) test heading - reference heading
    curves: Mapping[str, Floats] = field(default_factory=dict)  # (N, M) by name: distances whose least tells the answer


@dataclass(frozen=True)
class Arrangement:
    """B sets of n points, placed in a plane so that their distances resemble given ones, up to scale, turn and reflection."""

    position: Floats  # (B, n, 2) in the unit of the distances
    stress: Floats  # (B,) normalised: root of sum (|x_i - x_j| - d_ij)^2 / sum d_ij^2 over the pairs that count
    iterations: Ints  # (B,) until it settled
    steps: Floats | None = None  # (S, B, n, 2) on the way, where they were asked for


@dataclass(frozen=True)
class Motion:
    """How a camera moved in the plane from one image to another, as an odometry tells."""

    vector: (
        Floats  # (3,) x and y in `unit`, heading: the second pose in the frame of the first; NaN where it cannot tell
    )
    covariance: Floats  # (3, 3) of these
    unit: str  # "m", or what it counts: then lengths are right up to one unknown factor
    failed: str = ""  # why it cannot tell, in a few words
    matches: Floats | None = (
        None  # (M, 2, 2): azimuth and level (of `Camera.unwrap`) in the first panorama, in the second
    )
    agree: Bools | None = None  # (M,) which of the matches the motion explains
    features: int = 0  # found in both images together, those without a match included
    window_rad: float | None = (
        None  # azimuth in the second camera's frame where the winning half of the panorama starts
    )


@dataclass(frozen=True)
class Unusable:
    """What an odometry keeps of an image in which nothing can be made out."""

    reason: str  # in a few words


@dataclass(frozen=True)
class Closures:
    """K earlier nodes whose places an image was recognised as."""

    nodes: Ints  # (K,)
    motions: Floats  # (K, 3): the new pose in the frame of each node, x and y in the odometry's unit
    covariances: Floats  # (K, 3, 3)
    distances: Floats  # (K,) between the images, smaller is more alike
    candidates: int  # how many nodes were looked at closely


@dataclass(frozen=True)
class PoseGraph:
    """N poses, and E motions measured between them: all planar (k = d = 3), or all spatial (k = 7, d = 6).

    A planar pose or motion is (x, y, heading), a spatial one (x, y, z, qx, qy, qz, qw), a unit quaternion: metres, radians.
    Poses are in the world's frame; a motion is `T_from_to`, the pose of its edge's second node in the frame of the first.
    """

    ids: Ints  # (N,) int64, ascending: how files name the nodes
    poses: Floats  # (N, k) float64, known or guessed
    edges: Ints  # (E, 2) int64, from and to, as rows of `poses`
    motions: Floats  # (E, k) float64
    information: Floats  # (E, d, d): inverse covariance of x, y, heading; or of x, y, z and a rotation vector

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def planar(self) -> bool:
        return bool(self.poses.shape[1] == 3)


@dataclass(frozen=True)
class Optimized:
    """What a back end made of a pose graph. chi2 is that of `omnilab.graphs.chi2`, every edge in full, also robustly."""

    poses: Floats  # (N, k), the first where it was
    chi2_before: float  # of the poses it started from
    chi2: float
    iterations: int
    weights: Floats  # (E,) in [0, 1]: how much each edge still counts; 0: it was rejected
    covariances: Floats | None = None  # (N, d, d) of each pose, in its own frame, where they were asked for
    said: Sequence[str] = ()  # what went wrong, in sentences


# --------------------------------------------------------------------------------------------------------- records
@dataclass(frozen=True)
class Tick:
    """When a record belongs: the study's step and the sensor's time. The run's own clock is the sink's business."""

    step: int
    stamp_ns: int


@dataclass(frozen=True)
class Image:
    """A picture. The recorder fills in `encoded` once for all sinks."""

    pixels: Bytes  # (H, W) or (H, W, 3)
    format: str = "jpeg"  # or "png", lossless
    encoded: bytes = b""


@dataclass(frozen=True)
class Signature:
    """A described image laid out as a matrix (rows, columns), float32."""

    values: Floats


@dataclass(frozen=True)
class PlaceMap:
    """The places of a map: positions (P, 3) and headings (P,)."""

    position_m: Floats
    heading_rad: Floats | None = None


@dataclass(frozen=True)
class DistanceField:
    """The distance of one query to every place: positions (P, 3), values (P,)."""

    position_m: Floats
    values: Floats


@dataclass(frozen=True)
class Estimate:
    """One query: where it was taken and what was answered, positions (3,), headings in radians."""

    truth_m: Floats
    answer_m: Floats
    verdict: str  # "nearest", "second" or "wrong"
    truth_heading_rad: float = 0.0
    answer_heading_rad: float | None = None


@dataclass(frozen=True)
class Answers:
    """All queries of a study at a glance: truth (Q, 3), answer (Q, 3), verdicts (Q,)."""

    truth_m: Floats
    answer_m: Floats
    verdict: Sequence[str]


@dataclass(frozen=True)
class Pose:
    """Where the camera is: `T_world_camera` (4, 4)."""

    T_world_camera: Floats


@dataclass(frozen=True)
class Mesh:
    """The world's surface: vertices (V, 3) in metres, triangles (T, 3), one RGB colour per vertex (V, 3) uint8."""

    vertices_m: Floats
    triangles: Ints
    colors: Bytes


@dataclass(frozen=True)
class PointCloud:
    """Points (P, 3) of the world, in metres, each in its RGB colour (P, 3) uint8."""

    points_m: Floats
    colors: Bytes


@dataclass(frozen=True)
class Graph:
    """Points (N, 3) and edges (E, 2) between them, each edge in its RGB colour (E, 3) uint8."""

    position_m: Floats
    edges: Ints
    colors: Bytes | None = None  # None: all alike


@dataclass(frozen=True)
class Series:
    """A stretch of one curve: values (n,) at the study's steps (n,) and the sensor's times (n,)."""

    values: Floats
    steps: Ints
    stamps_ns: Ints
    unit: str
    color: tuple[int, int, int] | None = None  # RGB; None: the viewer chooses


@dataclass(frozen=True)
class Text:
    """A line of the run's log, or a document in Markdown."""

    text: str
    level: str = "INFO"  # INFO, WARN, ERROR
    markdown: bool = False


@dataclass(frozen=True)
class Progress:
    """How far a stage has come: `done` of `total` items (0: not known)."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Panel:
    """One view of a layout. `kind`: map (3-D), image, plot, text or log; `contents`: paths of the records it shows."""

    kind: str
    title: str
    contents: Sequence[str]


@dataclass(frozen=True)
class ViewLayout:
    """How a run should look in a viewer: columns of panels, from left to right, each from top to bottom."""

    columns: Sequence[Sequence[Panel]]
    widths: Sequence[float] = ()


Record = (
    Image
    | Signature
    | PlaceMap
    | DistanceField
    | Estimate
    | Answers
    | Pose
    | Mesh
    | PointCloud
    | Graph
    | Series
    | Text
    | Progress
    | ViewLayout
)


# --------------------------------------------------------------------------------------------------------- results
@dataclass(frozen=True)
class Metric:
    """One measured figure. Nothing in it may depend on the clock."""

    name: str
    value: float
    unit: str  # "1" for ratios and counts
    interval: tuple[float, float] | None = None  # 95 % confidence, where it was estimated


@dataclass(frozen=True)
class Report:
    """What a study found. The first three metrics are the ones that tables of runs show."""

    metrics: Sequence[Metric]
    tables: Mapping[str, Mapping[str, Sequence[Any] | npt.NDArray[Any]]] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)  # matplotlib figures, by file name without ending
    map: Places | None = None  # to be kept, so that other runs can localise in it
    files: Mapping[str, str] = field(
        default_factory=dict
    )  # texts for the run's folder, by file name: trajectories, graphs


class Recorder(Protocol):
    """What a study gets to tell the world how it goes."""

    def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
        """Hand one record to every sink. Without a tick it holds for the whole run."""

    def track(self, items: Iterable[T], stage: str, total: int, size: Any = len) -> Iterator[T]:
        """Pass `items` on, telling the sinks after each how far the stage is (`size` of an item counts its parts)."""

    def timed(self, stage: str, count: int = 1) -> AbstractContextManager[None]:
        """Measure the wall time of a stage over `count` items; the sums land in the run's cost table."""


# --------------------------------------------------------------------------------------------------------- kinds
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
