"""From docstrings, comments and values to Markdown, and what the written pages say of a name."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from omnilab.runner.manual import settings_data

PICTURES = {  # of what no picture is named after: pictures/KIND_NAME.jpg is found without
    "descriptor radon": "pictures/descriptor_turn.jpg",
    "descriptor radon_gist": "pictures/descriptor_gist.jpg",
    "altimeter radon_compression": "pictures/descriptor_turn.jpg",
    "altimeter feature_altitude": "pictures/descriptor_features.jpg",
    "odometry planar_epipolar": "trajectory.jpg",
    "localizer spring": "topological_maps.jpg",
    "localizer smacof": "topological_maps.jpg",
    "localizer gower": "topological_rooms.jpg",
    "backend gtsam_batch": "graphs.jpg",
    "backend gtsam_gnc": "graphs.jpg",
    "view_filter view_ekf": "view_slam.png",
    "view_filter view_graph": "view_slam.png",
    "view_filter landmark_ekf": "landmark_cost.png",
}


def manual(text: str | None) -> str:
    """A docstring as Markdown."""
    text = inspect.cleandoc(text or "")
    parts = re.split(r"(`[^`\n]+`)", text.replace("``", "`"))
    escaped = "".join(part if part.startswith("`") else re.sub(r"([<*])", r"\\\1", part) for part in parts)
    return re.sub(r" ?::$", ":", escaped, flags=re.MULTILINE)


def cell(text: object) -> str:
    """Text of a cell of a table."""
    return str(text).replace("|", "\\|").replace("\n", " ")


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Rows as a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell(each) for each in line) + " |" for line in lines) + "\n"


@cache
def settings_of(cls: type[Any]) -> str:
    """The table of a component's settings."""
    return settings_table(settings_data(cls))


def settings_table(settings: Iterable[dict[str, Any]], prefix: str = "") -> str:
    """What `omnilab.runner.manual.settings_data` found, a row a setting, those of settings of their own among them."""
    rows = [row for each in settings for row in _rows(each, prefix)]
    return table(["setting", "default", "may be", "meaning"], rows) if rows else "It has no settings.\n"


def _rows(setting: dict[str, Any], prefix: str) -> list[list[object]]:
    name = prefix + setting["name"]
    default = "**to be given**" if setting["required"] else f"`{_value(setting['default'])}`"
    if inner := setting.get("settings"):
        return [[f"`{name}`", "", "", setting["comment"]], *(row for each in inner for row in _rows(each, f"{name}."))]
    return [[f"`{name}`", default, _allowed(setting), setting["comment"]]]


def _value(value: Any) -> Any:
    """As an override has it."""
    return json.dumps(value) if value is None or isinstance(value, bool) else value


def _allowed(setting: dict[str, Any]) -> str:
    if choices := setting.get("choices"):
        return ", ".join(f"`{choice}`" for choice in choices)
    allowed = setting["range"]["allowed"] if setting["range"] else f"`{setting['type']}`"
    return f"{allowed} ({setting['unit']})" if setting["unit"] else str(allowed)


@dataclass
class Sources:
    """The folder docs/: its pages and pictures."""

    folder: Path

    @cached_property
    def pages(self) -> dict[str, str]:
        """The written pages, by their path."""
        return {path.relative_to(self.folder).as_posix(): path.read_text("utf-8") for path in self.folder.rglob("*.md")}

    def picture(self, kind: str, name: str) -> str | None:
        """The path of a component's picture, if there is one; a study's is that of the gallery."""
        names = {"study": f"gallery/{name}", "sensor": f"pictures/camera_{name}"}
        for found in sorted(self.folder.glob(f"{names.get(kind, f'pictures/{kind}_{name}')}.[jp][pn]g")):
            return found.relative_to(self.folder).as_posix()
        return PICTURES.get(f"{kind} {name}")

    def figures(self, study: str) -> list[str]:
        """The paths of the figures that the gallery has of a study."""
        return [
            found.relative_to(self.folder).as_posix() for found in sorted(self.folder.glob(f"gallery/{study}-*.jpg"))
        ]

    def that_name(self, pattern: str, but: Sequence[str] = ()) -> list[str]:
        """Links to the written pages in which a pattern occurs, from a page in a folder."""
        return [
            f"[{title_of(text)}](../{path})"
            for path, text in sorted(self.pages.items())
            if path not in but and re.search(pattern, text)
        ]


def title_of(text: str) -> str:
    """The first heading of a page."""
    found = re.search(r"^# (.+)$", text, flags=re.MULTILINE)
    return found[1] if found else "omnilab"
