"""The process that holds the plugins, and composes and builds configurations for the pages."""

from __future__ import annotations

from omnilab_serve.settings import ServeSettings


class Composer:
    """Starts that process when it is first needed, and ends it when nobody has asked for a while."""

    def __init__(self, settings: ServeSettings) -> None:
        self._settings = settings

    def stop(self) -> None:
        """End the process, if there is one."""
