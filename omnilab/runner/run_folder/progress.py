"""How far a run has come, as `progress.json` in its folder says it while it goes on."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from omnilab.errors import visible
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder.names import PROGRESS

LARGEST_BYTES = 1 << 16
NUMBER, LEFT, TEXT = (int, float), (int, float, type(None)), (str,)
TYPES = {
    "stage": TEXT, "done": (int,), "total": (int,), "stage_left_s": LEFT, "finished": (list,), "run_s": NUMBER,
    "began": TEXT, "written": TEXT,
}  # fmt: skip


@dataclass(frozen=True)
class RunProgress:
    """The stage that a run is in, and when that was. Times are by the clock of the run's host, as ISO 8601."""

    stage: str = ""  # "": before the first
    done: int = 0  # items of it
    total: int = 0  # 0: not known
    stage_left_s: float | None = None  # by the pace of its items, at the time of writing; None: not known
    finished: tuple[str, ...] = ()  # the stages before, or the last of many
    run_s: float = 0.0  # how long the run has taken
    began: str = ""
    written: str = ""

    @property
    def fraction(self) -> float | None:
        """Of the stage, from 0 to 1; None where its items are not counted."""
        return min(1.0, self.done / self.total) if self.total > 0 else None

    @property
    def words(self) -> str:
        """As "43 % (queries 86 of 200)"; what is not known is left out."""
        if not self.stage:
            return ""
        if self.fraction is None:
            return f"({visible(self.stage)}{f' {self.done}' if self.done else ''})"
        return f"{math.floor(100 * self.fraction)} % ({visible(self.stage)} {self.done} of {self.total})"

    @property
    def left_s(self) -> float | None:
        """Time that the stage still takes. None: not known, also where it should long be over by what was written last."""
        if self.stage_left_s is None:
            return None
        try:
            age_s = (datetime.now(UTC) - datetime.fromisoformat(self.written)).total_seconds()
        except (TypeError, ValueError):  # no time, or one without a zone
            return None
        left_s = self.stage_left_s - max(0.0, age_s)  # a clock that is ahead of ours tells nothing
        return left_s if left_s >= 0 else None

    def to_json(self) -> str:
        return json.dumps(asdict(self)) + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> Self | None:
        """None where the text is nothing that a run writes."""
        try:
            content = json.loads(text)
        except (ValueError, RecursionError):
            return None
        if not isinstance(content, dict):
            return None
        found: dict[str, Any] = {field.name: content.get(field.name) for field in fields(cls)}
        if not all(type(found[name]) in types for name, types in TYPES.items()) or not _sensible(found):
            return None
        return cls(**found | {"finished": tuple(found["finished"])})


def _sensible(found: dict[str, Any]) -> bool:
    """Whether numbers are finite and not negative, and names are texts."""
    numbers = [found[name] for name in ("done", "total", "run_s", "stage_left_s") if found[name] is not None]
    return all(0 <= number < math.inf for number in numbers) and all(type(name) is str for name in found["finished"])


def read_progress(folder: Path) -> RunProgress | None:
    """How far the run in a folder has come; None where that is not known: it has only begun, or is one of before."""
    try:
        return RunProgress.from_json(content_of(folder / PROGRESS, LARGEST_BYTES))
    except OSError:
        return None
