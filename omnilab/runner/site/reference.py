"""Pages of the reference: the modules of the contract, and every setting of every component."""

from __future__ import annotations

from collections.abc import Iterator

from omnilab.api import KINDS
from omnilab.runner.config import Settings
from omnilab.runner.registry import Registry
from omnilab.runner.site.components import path_of, title_of_kind
from omnilab.runner.site.texts import settings_of

MODULES = {  # page: title, modules
    "api": ("Data, records and kinds", ["omnilab.api.data", "omnilab.api.kinds", "omnilab.api.poses", "omnilab.api.records",
                                       "omnilab.api.results", "omnilab.api.settings"]),
    "hooks": ("Hooks", ["omnilab.hooks"]),
    "testing": ("Conformance checks", [f"omnilab.testing.{kind}" for kind in KINDS]),
    "cameras": ("Camera models", ["omnilab.cameras.base", "omnilab.cameras.mirrors", "omnilab.cameras.noncentral", "omnilab.cameras.lenses",
                                  "omnilab.cameras.kannala_brandt", "omnilab.cameras.brown_conrady", "omnilab.cameras.ocam",
                                  "omnilab.cameras.stereo", "omnilab.cameras.dual_fisheye", "omnilab.cameras.reproject",
                                  "omnilab.cameras.files"]),
    "image": ("Images", ["omnilab.image"]),
    "geometry": ("Geometry", ["omnilab.geometry"]),
    "metrics": ("Metrics", ["omnilab.metrics"]),
    "trajectory": ("Trajectories", ["omnilab.trajectory.evaluation", "omnilab.trajectory.files"]),
    "posegraph": ("Pose graphs", ["omnilab.posegraph.graph", "omnilab.posegraph.files"]),
    "errors": ("Errors and limits", ["omnilab.errors", "omnilab.limits"]),
    "client": ("The service from Python", ["omnilab.client.client", "omnilab.client.models"]),
    "runs": ("Runs from Python", ["omnilab.runner.run_folder.reading", "omnilab.runner.compare.comparison"]),
}  # fmt: skip


def reference_pages(registry: Registry) -> Iterator[tuple[str, str]]:
    """Path and text of each page; first those of modules, then those of settings."""
    for name, (title, modules) in MODULES.items():
        yield f"reference/{name}.md", f"# {title}\n\n" + "\n\n".join(f"::: {module}" for module in modules) + "\n"
    yield "reference/settings_run.md", f"# Settings of a run\n\n{settings_of(Settings)}"
    for kind in KINDS:
        parts = [f"# Settings of {title_of_kind(kind).lower()}\n"]
        for name in registry.names(kind):
            component = registry.get(kind, name)
            link = f"[{name}](../{path_of(component)})"
            parts += [f"## {link}\n", f"{component.summary}\n", settings_of(component.cls)]  # type: ignore[arg-type]  # a class is hashable
        yield f"reference/settings_{kind}.md", "\n".join(parts)


def reference_index() -> str:
    """The page before them."""
    modules = "\n".join(f"- [{title}]({name}.md)" for name, (title, _) in MODULES.items())
    kinds = "\n".join(f"- [{title_of_kind(kind)}](settings_{kind}.md)" for kind in KINDS)
    return (
        "# Reference\n\nWhat a plugin may import, and every setting there is.\n\n## Python\n\n"
        f"{modules}\n\n## Settings\n\nThe same as `omnilab plugins NAME` prints.\n\n- [of a run](settings_run.md)\n{kinds}\n"
    )
