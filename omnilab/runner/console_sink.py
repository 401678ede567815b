"""The console sink: how far each stage is, on standard error."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from omnilab.api import Progress, Record, Text, Tick
from omnilab.errors import visible
from omnilab.hooks import Register, hookimpl

if TYPE_CHECKING:
    from rich.console import Console as RichConsole
    from rich.console import RenderableType


@dataclass
class Console:
    """Progress bars on a terminal; one line per finished stage elsewhere."""

    bars: bool = True  # False: lines on a terminal too
    heading: ClassVar[str] = ""  # a line above the bars: how the sweep stands
    quiet: ClassVar[bool] = False  # whether a display of all jobs has the terminal

    def __post_init__(self) -> None:
        self._console: RichConsole | None = None
        self._progress: Any = None
        self._stages: dict[str, Any] = {}  # stage: bar on a terminal, start time elsewhere

    def open(self, folder: Path) -> None:  # noqa: ARG002  the contract of sinks; this one writes no file
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        class Bars(Progress):
            def get_renderables(self) -> Iterator[RenderableType]:
                if Console.heading:
                    yield Console.heading
                yield from super().get_renderables()

        self._console = RichConsole(stderr=True)
        if self.bars and self._console.is_terminal and not Console.quiet:
            columns = (
                TextColumn("{task.description:<22}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
            )
            self._progress = Bars(*columns, console=self._console)
            self._progress.start()

    def write(self, path: str, record: Record, tick: Tick | None) -> None:  # noqa: ARG002
        assert self._console is not None
        if isinstance(record, Progress):
            if not Console.quiet:
                self._show(record)
        elif isinstance(record, Text) and not record.markdown and record.level != "INFO":
            self._console.print(
                f"{record.level.lower()}: {visible(record.text)}", highlight=False, markup=False, soft_wrap=True
            )

    def _show(self, progress: Progress) -> None:
        assert self._console is not None
        if self._progress is not None:
            if progress.stage not in self._stages:
                self._stages[progress.stage] = self._progress.add_task(
                    visible(progress.stage), total=progress.total or None
                )
            self._progress.update(self._stages[progress.stage], completed=progress.done)
            return
        start = self._stages.setdefault(progress.stage, time.monotonic())
        if progress.done and progress.done == progress.total:
            seconds = time.monotonic() - start
            self._console.print(
                f"{visible(progress.stage):<22} {progress.done} in {seconds:.1f} s", highlight=False, markup=False
            )

    def flush(self) -> None:
        """Nothing is held back."""

    def leave_terminal(self) -> None:
        """Draw no more bars: what is printed next would be drawn over."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def close(self) -> None:
        self.leave_terminal()
        self.__post_init__()

    def repair(self, folder: Path) -> str | None:  # noqa: ARG002
        return None


@hookimpl
def register_sinks(register: Register) -> None:
    register("console", Console)
