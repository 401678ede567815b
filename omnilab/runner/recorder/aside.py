"""What is logged in a thread of its own, in order, while the study goes on."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

Action = Callable[[], object]

MOST = 2  # actions that wait; the study waits with a third
LOOK_S = 0.02  # how often a study that waits hears Ctrl-C


class Aside:
    """Runs actions one after the other in its thread; what one raises, the study's thread raises with its next one."""

    def __init__(self) -> None:
        self._waiting: queue.Queue[Action | None] = queue.Queue(MOST)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="omnilab-aside", daemon=True)
        self._thread.start()

    def __call__(self, action: Action) -> None:
        """Have something done soon; waits while too much does."""
        self._raise()
        self._put(action)

    def end(self, patience_s: float | None = None) -> bool:
        """Wait until all is done, and raise what was raised; False if it takes longer than that (None: for ever)."""
        end = None if patience_s is None else time.monotonic() + patience_s
        try:
            self._put(None, end)
        except queue.Full:
            return False
        while self._thread.is_alive():
            if end is not None and time.monotonic() > end:
                return False
            self._thread.join(LOOK_S)
        self._raise()
        return True

    def _put(self, action: Action | None, end: float | None = None) -> None:
        while True:
            try:
                return self._waiting.put(action, timeout=LOOK_S)
            except queue.Full:
                if end is not None and time.monotonic() > end:
                    raise

    def _work(self) -> None:
        while (action := self._waiting.get()) is not None:
            if self._error is None:
                try:
                    action()
                except BaseException as error:  # noqa: BLE001  the study's thread raises it
                    self._error = error

    def _raise(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
