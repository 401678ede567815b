"""Data types: frames, signatures, places, matches, motions, image features, pose graphs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]
Ints = npt.NDArray[np.integer[Any]]
Bytes = npt.NDArray[np.uint8]
Bools = npt.NDArray[np.bool_]
Array = npt.NDArray[Any]  # of any type
T = TypeVar("T")


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
    """N described images. `place` encodes where, `heading` (where it is an array of its own) the orientation."""

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
class Provenance:
    """What images are of, and were taken by: those of a map and its queries should be alike."""

    camera: str  # the name of its model
    width: int
    height: int
    elevations_deg: tuple[float, float] | None  # lowest and highest of its panoramas; None if it is not calibrated
    color: bool
    world: str | None = None  # a virtual one, where the sensor says which: its name
    world_digest: str | None = None  # of its content and its variant


@dataclass(frozen=True)
class Places:
    """The map: P described images, with their poses where these are known."""

    signatures: Signatures
    T_world_camera: Floats | None  # (P, 4, 4)
    keys: Sequence[str]
    descriptor_state: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)  # of a trained descriptor
    provenance: Provenance | None = None  # of their images; None: not known

    def __len__(self) -> int:
        return len(self.signatures)


@dataclass(frozen=True)
class Match:
    """Q queries against P places."""

    distance: Floats  # (Q, P) float32, smaller is more alike
    rotation_rad: Floats | None = None  # (Q, P) float32: query heading - place heading
    R_place_query: Floats | None = None  # (Q, P, 3, 3) takes directions of the query's camera frame to the place's


@dataclass(frozen=True)
class Estimates:
    """The estimates of a localizer for Q queries."""

    place: Ints  # (Q,) index of the best place
    distance: Floats  # (Q,) to that place
    position_m: Floats  # (Q, 3) world
    heading_rad: Floats | None = None  # (Q,)
    field: Floats | None = None  # (Q, P) all distances, where they were computed


@dataclass(frozen=True)
class Heights:
    """How much higher N tests were taken than their references, as an altimeter estimates from the images alone."""

    value: Floats  # (N,) in the altimeter's own unit, above 0 where the test is higher; NaN where there is no estimate
    unit: str  # "m", or what it counts
    confidence: Floats  # (N,) in [0, 1]
    rotation_rad: Floats  # (N,) test heading - reference heading
    curves: Mapping[str, Floats] = field(
        default_factory=dict
    )  # (N, M) by name: distances whose minimum is the estimate


@dataclass(frozen=True)
class Embedding:
    """B sets of n points, placed in a plane so that their distances resemble given ones, up to scale, turn and reflection."""

    position: Floats  # (B, n, 2) in the unit of the distances
    stress: Floats  # (B,) normalised: root of sum (|x_i - x_j| - d_ij)^2 / sum d_ij^2 over the pairs that count
    iterations: Ints  # (B,) until it settled
    steps: Floats | None = None  # (S, B, n, 2) on the way, where they were requested


@dataclass(frozen=True)
class Motion:
    """The planar motion of a camera between two images, as an odometry estimates it.

    `vector` is the second pose in the frame of the first: x and y in `unit`, heading; NaN where the estimate failed.
    `window_rad` is where, in the second camera's frame, the half of the panorama starts that won a half-window vote.
    """

    vector: Floats  # (3,)
    covariance: Floats  # (3, 3) of these
    unit: str  # "m", or what it counts: then lengths are right up to one unknown factor
    failed: str = ""  # why there is no estimate, in a few words
    matches: Floats | None = None  # (M, 2, 2): azimuth and level of `Camera.unwrap`, in the first panorama, the second
    agree: Bools | None = None  # (M,) which of the matches are inliers of the motion
    features: int = 0  # found in both images together, those without a match included
    window_rad: float | None = None


@dataclass(frozen=True)
class Unusable:
    """What an odometry extracts from an image in which nothing can be made out."""

    reason: str  # in a few words


@dataclass(frozen=True, eq=False)
class ImageFeatures:
    """F local features of an image on the unit sphere, strongest first.

    An odometry whose `extract` returns these shares them: a loop closure may match them instead of finding its own.
    """

    directions: Floats | None  # (F, 3) unit float32, in the camera's frame; None of an uncalibrated camera
    azimuth_level: Floats  # (F, 2) float32, on the panorama: azimuth in radians, level of `Camera.unwrap`
    vectors: npt.NDArray[Any]  # (F, D) feature descriptors: uint8 of SIFT, float16 of SURF; of any length


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
    """What a back end made of a pose graph. chi2 is that of `omnilab.posegraph.graph.chi2`, every edge in full, also robustly."""

    poses: Floats  # (N, k), the first where it was
    chi2_before: float  # of the poses it started from
    chi2: float
    iterations: int
    weights: Floats  # (E,) in [0, 1]: how much each edge still counts; 0: it was rejected
    covariances: Floats | None = None  # (N, d, d) of each pose, in its own frame, where they were requested
    warnings: Sequence[str] = ()  # in sentences
    notes: Sequence[str] = ()  # which start was kept, which edges were trusted: sentences of no problem
    trusted: Bools | None = None  # (E,) edges that could not be rejected, as known inliers; None: not said
    starts: Mapping[str, float] = field(default_factory=dict)  # cost by initial guess, the kept one first, if several

    @property
    def rejected(self) -> Bools:
        """Edges (E,) that count less than half."""
        return np.asarray(self.weights < 0.5)


Watch = Callable[[int, Any, Sequence[str]], None]  # a node's row, the IncrementalGraph with it, what went wrong
