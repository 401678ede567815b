"""The studies: code that drives components and measures."""

from omnilab.hooks import Register, hookimpl
from omnilab_studies.altitude import Altitude
from omnilab_studies.cost import Cost
from omnilab_studies.grid import Grid
from omnilab_studies.linearity import Linearity
from omnilab_studies.render import Render
from omnilab_studies.resolution import Resolution
from omnilab_studies.robustness import Robustness
from omnilab_studies.views import Views

__all__ = ["Altitude", "Cost", "Grid", "Linearity", "Render", "Resolution", "Robustness", "Views"]


@hookimpl
def register_studies(register: Register) -> None:
    register("grid", Grid)
    register("views", Views)
    register("render", Render)
    register("linearity", Linearity)
    register("cost", Cost)
    register("robustness", Robustness)
    register("resolution", Resolution)
    register("altitude", Altitude)
