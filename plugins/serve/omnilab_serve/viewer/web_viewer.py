"""The web viewer that rerun-sdk's own program holds, unpacked once, into a cache of the user's."""

from __future__ import annotations

import gzip
import http.client
import os
import re
import secrets
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

from omnilab.errors import DataError

LOOPBACK = "127.0.0.1"
NOWHERE = "http://127.0.0.1:9"  # a recording that is not there, and a proxy through which nothing is reached
STARTS = re.compile(rf"Hosting a web-viewer at http://{LOOPBACK}:(\d+)")
TIMEOUT_S = 60.0
LEVEL = 6  # of gzip: 13.8 MB in 2 s, where the best needs 4 s for 13.7
LARGEST = 1 << 28  # bytes of a file
REINSTALL = "install rerun-sdk anew: pip install --force-reinstall rerun-sdk"


@dataclass(frozen=True)
class WebViewerFile:
    """A file of the viewer: how it begins, and what it is."""

    name: str
    begins: bytes
    media_type: str


FILES = {
    file.name: file
    for file in (
        WebViewerFile("re_viewer.js", b"let wasm_bindgen", "text/javascript"),
        WebViewerFile("re_viewer_bg.wasm", b"\0asm", "application/wasm"),
    )
}


def cache_folder() -> Path:
    """Where programs of this user keep what they can make again."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "omnilab"


class WebViewer:
    """The viewer's files, compressed by gzip, in a folder of their version."""

    def __init__(self, cache: Path | None = None) -> None:
        self._cache = cache
        self._lock = threading.Lock()

    @cached_property
    def version(self) -> str:
        """Of rerun-sdk, and thus of the recordings that it shows."""
        return version("rerun-sdk")

    @property
    def folder(self) -> Path:
        """Where the files are, or will be."""
        return (self._cache or cache_folder()) / f"rerun-viewer-{self.version}"

    def ready(self) -> None:
        """Unpack the files if that was not done yet; DataError, with the reason, where it is impossible."""
        with self._lock:
            if not self._is_whole():
                try:
                    self._unpack()
                except (OSError, http.client.HTTPException) as error:
                    raise DataError(f"the Rerun viewer could not be unpacked into {self.folder} ({error})") from error

    def file(self, name: str) -> tuple[WebViewerFile, Path]:
        """One of the files, and where it is, compressed; KeyError for a name that none has."""
        found = FILES[name]
        self.ready()
        return found, self.folder / f"{name}.gz"

    def _is_whole(self) -> bool:
        return all((self.folder / f"{name}.gz").is_file() for name in FILES)

    def _unpack(self) -> None:
        """All the files or none; who unpacks at the same time gets the same."""
        parent = self.folder.parent
        parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        part = parent / f"{self.folder.name}.{os.getpid()}-{secrets.token_hex(4)}.part"
        part.mkdir(mode=0o700)
        try:
            with _serving() as port:
                for file in FILES.values():
                    content = _content(port, file)
                    (part / f"{file.name}.gz").write_bytes(gzip.compress(content, LEVEL, mtime=0))
            if not self._is_whole():
                shutil.rmtree(self.folder, ignore_errors=True)  # somebody has tidied up in it
                part.rename(self.folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)


def program() -> Path:
    """Rerun's program itself, not the script of the same name, which would leave it running when it is ended."""
    import rerun_cli

    file = Path(rerun_cli.__file__).with_name("rerun.exe" if os.name == "nt" else "rerun")
    if not file.is_file():
        raise DataError(f"rerun-sdk lacks its program rerun, which holds the viewer; {REINSTALL}")
    return file


@contextmanager
def _serving() -> Iterator[int]:
    """The port at which Rerun's program serves the viewer on loopback, for as long as that is needed.

    It is the program that names the port, so that it is no other's; it asks nobody for updates, and tells nobody.
    """
    call = [str(program()), "--serve-web", NOWHERE, "--bind", LOOPBACK, "--web-viewer-port", "0"]
    quiet = os.environ | {
        "CI": "1", "RERUN_ANALYTICS": "0", "TELEMETRY_ENABLED": "false", "HTTPS_PROXY": NOWHERE, "NO_COLOR": "1",
        "RUST_LOG": "info", "BROWSER": shutil.which("true") or sys.executable,
    }  # fmt: skip
    process = subprocess.Popen(
        call, env=quiet, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        errors="replace",
    )  # fmt: skip
    watch = threading.Timer(TIMEOUT_S, process.kill)
    watch.start()
    try:
        yield _port(process)
    finally:
        watch.cancel()
        process.kill()
        process.communicate()


def _port(process: subprocess.Popen[str]) -> int:
    """The port that the program says it serves at."""
    line = ""
    for line in process.stderr or ():
        if found := STARTS.search(line):
            return int(found[1])
    raise DataError(f"Rerun's program did not serve its viewer ({line.strip() or 'it says nothing'}); {REINSTALL}")


def _content(port: int, file: WebViewerFile) -> bytes:
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=TIMEOUT_S)
    try:
        connection.request("GET", f"/{file.name}")
        answer = connection.getresponse()
        content = answer.read(LARGEST)
    finally:
        connection.close()
    if answer.status != 200 or not content.startswith(file.begins):
        raise DataError(
            f"Rerun's program serves no {file.name} that is known here (status {answer.status}); {REINSTALL}"
        )
    return content
