"""The studies: code that drives components and measures."""

from omnilab.hooks import Register, hookimpl
from omnilab_studies.altitude import Altitude
from omnilab_studies.changes import Changes
from omnilab_studies.cost import Cost
from omnilab_studies.grid import Grid
from omnilab_studies.joint import Joint
from omnilab_studies.large_map import LargeMap
from omnilab_studies.linearity import Linearity
from omnilab_studies.local_map import LocalMap
from omnilab_studies.localize import Localize
from omnilab_studies.make_map import MakeMap
from omnilab_studies.pose_graph import PoseGraphStudy
from omnilab_studies.render import Render
from omnilab_studies.resolution import Resolution
from omnilab_studies.robustness import Robustness
from omnilab_studies.room import Room
from omnilab_studies.steps import Steps
from omnilab_studies.topological_map import TopologicalMap
from omnilab_studies.trajectory import Trajectory
from omnilab_studies.view_count import ViewCount
from omnilab_studies.view_range import ViewRange
from omnilab_studies.view_slam import ViewSlam
from omnilab_studies.views import Views

__all__ = [
    "Altitude",
    "Changes",
    "Cost",
    "Grid",
    "Joint",
    "LargeMap",
    "Linearity",
    "LocalMap",
    "Localize",
    "MakeMap",
    "PoseGraphStudy",
    "Render",
    "Resolution",
    "Robustness",
    "Room",
    "Steps",
    "TopologicalMap",
    "Trajectory",
    "ViewCount",
    "ViewRange",
    "ViewSlam",
    "Views",
]


@hookimpl
def register_studies(register: Register) -> None:
    register("grid", Grid)
    register("map", MakeMap)
    register("localize", Localize)
    register("steps", Steps)
    register("changes", Changes)
    register("views", Views)
    register("render", Render)
    register("linearity", Linearity)
    register("cost", Cost)
    register("local_map", LocalMap)
    register("room", Room)
    register("topological_map", TopologicalMap)
    register("robustness", Robustness)
    register("resolution", Resolution)
    register("large_map", LargeMap)
    register("altitude", Altitude)
    register("joint", Joint)
    register("pose_graph", PoseGraphStudy)
    register("trajectory", Trajectory)
    register("view_range", ViewRange)
    register("view_count", ViewCount)
    register("view_slam", ViewSlam)
