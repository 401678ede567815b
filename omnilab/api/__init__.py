"""The contract between components, studies and the runner: data, records for the logs, one Protocol per kind.

Shapes, units and frames are stated here and only here.

* metres, radians, nanoseconds (int64) everywhere; images are uint8, grey ``(H, W)`` or RGB ``(H, W, 3)``.
* world frame: z up. Camera frame: +z up along the mirror axis.
* image of an omnidirectional camera: u runs right, v runs down; image right is the camera's +x, image up is +y, so the
  azimuth of a pixel, counter-clockwise from +x as seen from above, is ``atan2(cy - v, u - cx)``. A sensor whose
  pictures are mirrored or turned puts that right before it hands them over.
* heading: the angle from the world's +x to the camera's +x, counter-clockwise.
* ``T_world_camera`` takes points of the camera frame to the world frame.
"""

from typing import Any

from omnilab import renamed
from omnilab.api.contract import CONTRACT_VERSION
from omnilab.api.data import (
    Array,
    Bools,
    Bytes,
    CalibratedCamera,
    Camera,
    Circle,
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
    Provenance,
    Signatures,
    Unusable,
    Watch,
)
from omnilab.api.kinds import (
    KINDS,
    Altimeter,
    Backend,
    Descriptor,
    Distance,
    Disturbance,
    Embedder,
    IncrementalBackend,
    IncrementalGraph,
    Kind,
    Localizer,
    LoopClosure,
    Odometry,
    Parts,
    PlaceDatabase,
    Sensor,
    SequenceLocalizer,
    Sink,
    Study,
    Trainable,
    TrainedDescriptor,
    ViewFilter,
    ViewMap,
    is_cached,
)
from omnilab.api.poses import GridPoses, NamedPath, PathPoses, Plan, PoseRequest, RandomPoses, RecordedPoses
from omnilab.api.records import (
    Answers,
    DistanceField,
    Estimate,
    Graph,
    Image,
    Mesh,
    Panel,
    PlaceMap,
    PointCloud,
    Pose,
    Progress,
    Record,
    Series,
    Signature,
    Text,
    Tick,
    ViewLayout,
)
from omnilab.api.rendering import Renderer, Rendering
from omnilab.api.results import Metric, Recorder, Report, RunResult, TakesResult
from omnilab.api.settings import check_settings, setting
from omnilab.api.shards import Batch, Shards

__all__ = [
    "CONTRACT_VERSION",
    "KINDS",
    "Altimeter",
    "Answers",
    "Array",
    "Backend",
    "Batch",
    "Bools",
    "Bytes",
    "CalibratedCamera",
    "Camera",
    "Circle",
    "Closures",
    "Descriptor",
    "Distance",
    "DistanceField",
    "Disturbance",
    "Embedder",
    "Embedding",
    "Estimate",
    "Estimates",
    "Floats",
    "Frames",
    "Graph",
    "GridPoses",
    "Heights",
    "Image",
    "ImageFeatures",
    "IncrementalBackend",
    "IncrementalGraph",
    "Ints",
    "Kind",
    "Localizer",
    "LoopClosure",
    "Match",
    "Mesh",
    "Metric",
    "Motion",
    "NamedPath",
    "Odometry",
    "Optimized",
    "Panel",
    "Parts",
    "PathPoses",
    "PlaceDatabase",
    "PlaceMap",
    "Places",
    "Plan",
    "PointCloud",
    "Pose",
    "PoseGraph",
    "PoseRequest",
    "Progress",
    "Provenance",
    "RandomPoses",
    "Record",
    "RecordedPoses",
    "Recorder",
    "Renderer",
    "Rendering",
    "Report",
    "RunResult",
    "Sensor",
    "SequenceLocalizer",
    "Series",
    "Shards",
    "Signature",
    "Signatures",
    "Sink",
    "Study",
    "TakesResult",
    "Text",
    "Tick",
    "Trainable",
    "TrainedDescriptor",
    "Unusable",
    "ViewFilter",
    "ViewLayout",
    "ViewMap",
    "Watch",
    "check_settings",
    "is_cached",
    "setting",
]

renamed.accept(Optimized, {"said": "warnings"})
renamed.accept(Places, {"learnt": "descriptor_state"})


def __getattr__(name: str) -> Any:
    """Names of the version before."""
    return renamed.attribute(__name__, name, renamed.API)
