"""The layout of a recording, which changes in its place as more is known."""

from __future__ import annotations

from uuid import NAMESPACE_URL, UUID, uuid5

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings


class SentLayout:
    """Blueprints sent into a recording, each in place of the one before: under one id, with the same ids of the same parts.

    Mending a torn file, and a viewer that joins a live run, find this one.
    """

    def __init__(self, stream: rr.RecordingStream, application: str) -> None:
        self._stream = stream
        own = rerun_bindings.new_blueprint(
            application_id=application, make_default=False, make_thread_default=False, default_enabled=True
        )
        self._own = rr.RecordingStream._from_native(own)
        self._memory = self._own.memory_recording()
        self._views: set[str] = set()
        self._count = 0

    def send(self, blueprint: rrb.Blueprint) -> None:
        """Show the recording like this from now on."""
        views = _number(blueprint.root_container, uuid5(NAMESPACE_URL, "omnilab"))
        self._own.set_time("blueprint", sequence=self._count)
        for gone in self._views - views:
            self._own.log(gone, rr.Clear(recursive=True))
        blueprint._log_to_stream(self._own)
        rerun_bindings.send_blueprint(self._memory.storage, True, True, self._stream.to_native())
        self._views, self._count = views, self._count + 1

    def close(self) -> None:
        """Let its threads end."""
        self._own.disconnect()


def _number(part: rrb.Container | rrb.View, place: UUID) -> set[str]:
    """Give each container and view the id of its place and its class; the views' paths.

    What a viewer remembers of a view is kept under its id, and a view of another class cannot be drawn by it.
    """
    part.id = uuid5(place, type(part).__name__)
    if isinstance(part, rrb.View):
        return {part.blueprint_path()}
    return {path for i, child in enumerate(part.contents) for path in _number(child, uuid5(place, str(i)))}
