"""The log of a run: its file, and its warnings on the terminal."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from omnilab.errors import visible
from omnilab.runner.run_folder.names import RUN_LOG


class RunLog:
    """Attached to Python's logging for as long as the run lasts."""

    def __init__(self, folder: Path) -> None:
        """OSError if the file cannot be made."""
        self._file, self._warnings = _LogFile(folder / RUN_LOG), _WarningPrinter()
        logging.getLogger().addHandler(self._file)
        logging.getLogger("omnilab").setLevel(logging.INFO)
        logging.getLogger("omnilab").addHandler(self._warnings)

    def close(self) -> None:
        logging.getLogger().removeHandler(self._file)
        self._file.close()
        logging.getLogger("omnilab").removeHandler(self._warnings)


class _LogFile(logging.FileHandler):
    """A log that a full disk ends, which is said once; the run goes on."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8", errors="backslashreplace")
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        self._full = False

    def emit(self, record: logging.LogRecord) -> None:
        if not self._full:
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exception()
        if not isinstance(error, OSError):
            super().handleError(record)
            return
        self._end(error)

    def close(self) -> None:
        try:
            super().close()
        except OSError as error:  # what waited to be written
            self._end(error)

    def _end(self, error: OSError) -> None:
        if not self._full:
            self._full = True
            _say(f"{self.baseFilename} ends here ({error.strerror}); make room there for the next run")


class _WarningPrinter(logging.Handler):
    """Prints warnings, which the log of a run keeps, each once. Errors are printed where they end the run."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._printed: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        try:
            sentence = record.getMessage()
            if record.levelno == logging.WARNING and sentence not in self._printed:
                self._printed.add(sentence)
                _say(sentence)
        except Exception:  # noqa: BLE001  as every handler of Python's
            self.handleError(record)


def _say(sentence: str) -> None:
    sys.stderr.write(f"omnilab: {visible(sentence)}\n")
