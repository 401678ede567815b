"""The studies: code that drives components and measures."""

from omnilab.hooks import Register, hookimpl
from omnilab_studies.changes import Changes
from omnilab_studies.cost import Cost
from omnilab_studies.grid import Grid
from omnilab_studies.linearity import Linearity
from omnilab_studies.localize import Localize
from omnilab_studies.make_map import MakeMap
from omnilab_studies.pose_graph import PoseGraphStudy
from omnilab_studies.render import Render
from omnilab_studies.resolution import Resolution
from omnilab_studies.robustness import Robustness
from omnilab_studies.steps import Steps
from omnilab_studies.views import Views

__all__ = [
    "Changes",
    "Cost",
    "Grid",
    "Linearity",
    "Localize",
    "MakeMap",
    "PoseGraphStudy",
    "Render",
    "Resolution",
    "Robustness",
    "Steps",
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
    register("robustness", Robustness)
    register("resolution", Resolution)
    register("pose_graph", PoseGraphStudy)
