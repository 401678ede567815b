"""The studies: code that drives components and measures."""

from typing import Any

from omnilab import renamed
from omnilab.hooks import Register, hookimpl
from omnilab_studies.altitude.joint.study import Joint
from omnilab_studies.altitude.study import Altitude
from omnilab_studies.datasets.render.study import Render
from omnilab_studies.datasets.views.study import Views
from omnilab_studies.descriptors.cost.study import Cost
from omnilab_studies.descriptors.linearity.study import Linearity
from omnilab_studies.descriptors.parameter_curves.study import ParameterCurves
from omnilab_studies.descriptors.resolution.study import Resolution
from omnilab_studies.descriptors.robustness.study import Robustness
from omnilab_studies.descriptors.rotations.study import Rotations
from omnilab_studies.local_maps.local_map.study import LocalMap
from omnilab_studies.local_maps.room.study import Room
from omnilab_studies.local_maps.topological_map.study import TopologicalMap
from omnilab_studies.localization.catchment.study import Catchment
from omnilab_studies.localization.changes.study import Changes
from omnilab_studies.localization.grid.study import Grid
from omnilab_studies.localization.large_map.study import LargeMap
from omnilab_studies.localization.lifelong_map.study import LifelongMap
from omnilab_studies.localization.live_localize.study import LiveLocalize
from omnilab_studies.localization.localize.study import Localize
from omnilab_studies.localization.map.study import MapStudy
from omnilab_studies.localization.route_localization.study import RouteLocalization
from omnilab_studies.localization.steps.study import Steps
from omnilab_studies.matching.study import Matching
from omnilab_studies.pose_graph.study import PoseGraphStudy
from omnilab_studies.trajectory.study import TrajectoryStudy
from omnilab_studies.view_slam.study import ViewSlam
from omnilab_studies.view_slam.view_count.study import ViewCount
from omnilab_studies.view_slam.view_density.study import ViewDensity
from omnilab_studies.view_slam.view_range.study import ViewRange

__all__ = [
    "Altitude",
    "Catchment",
    "Changes",
    "Cost",
    "Grid",
    "Joint",
    "LargeMap",
    "LifelongMap",
    "Linearity",
    "LiveLocalize",
    "LocalMap",
    "Localize",
    "MapStudy",
    "Matching",
    "ParameterCurves",
    "PoseGraphStudy",
    "Render",
    "Resolution",
    "Robustness",
    "Room",
    "Rotations",
    "RouteLocalization",
    "Steps",
    "TopologicalMap",
    "TrajectoryStudy",
    "ViewCount",
    "ViewDensity",
    "ViewRange",
    "ViewSlam",
    "Views",
]


@hookimpl
def register_studies(register: Register) -> None:
    register("grid", Grid)
    register("map", MapStudy)
    register("localize", Localize)
    register("live_localize", LiveLocalize)
    register("route_localization", RouteLocalization)
    register("catchment", Catchment)
    register("steps", Steps)
    register("changes", Changes)
    register("lifelong_map", LifelongMap)
    register("views", Views)
    register("render", Render)
    register("linearity", Linearity)
    register("cost", Cost)
    register("parameter_curves", ParameterCurves)
    register("local_map", LocalMap)
    register("room", Room)
    register("topological_map", TopologicalMap)
    register("robustness", Robustness)
    register("resolution", Resolution)
    register("rotations", Rotations)
    register("large_map", LargeMap)
    register("altitude", Altitude)
    register("joint", Joint)
    register("pose_graph", PoseGraphStudy)
    register("trajectory", TrajectoryStudy)
    register("view_density", ViewDensity)
    register("view_range", ViewRange)
    register("view_count", ViewCount)
    register("view_slam", ViewSlam)
    register("matching", Matching)


def __getattr__(name: str) -> Any:
    """Names of the version before."""
    return renamed.attribute(__name__, name, {"MakeMap": "MapStudy", "Trajectory": "TrajectoryStudy"})
