"""Inputs that are named by URLs: fetched once, never stale, the run of a local file otherwise; what is refused says why."""

from __future__ import annotations

import hashlib
import json
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import fsspec
import pytest
import yaml
from fsspec.implementations.memory import MemoryFileSystem

from omnilab.errors import ConfigError, DataError
from omnilab.runner.build import build
from omnilab.runner.input_files import unknown_inputs
from omnilab.runner.overrides.composition import compose
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import load_run
from omnilab.runner.storage import fetching
from omnilab.runner.storage.inputs import urls_of
from omnilab.runner.storage.listing import listing
from omnilab.runner.storage.urls import check, local_path

READS = ("~experiment", "study=reads", "~sinks.rerun", "~sinks.mcap")
FETCHED = "are fetched into"
SECRET = "hunter2"


@pytest.fixture
def memory(monkeypatch) -> Iterator[MemoryFileSystem]:
    """A store in memory, with b/n.txt and the folder b/many."""
    monkeypatch.setenv("OMNILAB_STORAGE", "memory")
    store = fsspec.filesystem("memory")
    store.pipe({"/b/n.txt": b"41", "/b/many/1.txt": b"1", "/b/many/in/2.txt": b"20"})
    yield store
    store.store.clear()
    store.pseudo_dirs[:] = [""]


@pytest.fixture
def reads(omnilab_here, monkeypatch):
    """`reads(folder, *words)`: the study of omnilab_reads.py in this process; its run's folder in tmp_path."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(Path(__file__).with_name("omnilab_reads.py")))
    return lambda folder, *words: omnilab_here(*READS, f"hydra.run.dir={folder}", *words)


def total(folder: str) -> float:
    return load_run(Path(folder)).metrics["total"]


def copies() -> list[Path]:
    return sorted(path for path in Path("logs/cache/fetched").glob("*/*") if path.suffix not in {".json", ""})


def test_a_run_is_that_of_the_local_file_and_says_the_url(memory, reads):
    Path("n.txt").write_text("41")
    assert reads("local", "study.path=n.txt").rc == 0
    result = reads("remote", "study.path=memory://b/n.txt")
    assert result.rc == 0, result.stderr
    assert f"study.path: 2e-06 MB in 1 file of memory://b/n.txt {FETCHED}" in result.stderr
    assert Path("remote/metrics.csv").read_bytes() == Path("local/metrics.csv").read_bytes()
    assert yaml.safe_load(Path("remote/config.yaml").read_text())["study"]["path"] == "memory://b/n.txt"
    local, remote = (json.loads(Path(name, "manifest.json").read_text()) for name in ("local", "remote"))
    assert remote["files"] == {"study.path": hashlib.sha256(b"41").hexdigest()} == local["files"]
    assert remote["identity"] == local["identity"]


@pytest.mark.slow
def test_what_is_there_is_not_fetched_again_and_what_changed_is(memory, reads):
    assert FETCHED in reads("a", "study.path=memory://b/n.txt").stderr
    assert FETCHED not in reads("b", "study.path=memory://b/n.txt").stderr
    memory.pipe("/b/n.txt", b"42")  # as long as before
    assert FETCHED in reads("c", "study.path=memory://b/n.txt").stderr
    assert [total(folder) for folder in "abc"] == [41, 41, 42]


@pytest.mark.slow
def test_a_folder_is_fetched_whole_and_what_was_cut_off_again(memory, reads):
    assert reads("a", "study.path=memory://b/many", "study.others=[memory://b/n.txt]").rc == 0
    assert total("a") == 62
    assert yaml.safe_load(Path("a/config.yaml").read_text())["study"]["others"] == ["memory://b/n.txt"]
    (half,) = Path("logs/cache/fetched").glob("*/many/in/2.txt")
    (whole,) = Path("logs/cache/fetched").glob("*/many/1.txt")
    before = whole.stat().st_mtime_ns
    half.write_text("2")
    result = reads("b", "study.path=memory://b/many")
    assert "2e-06 MB in 1 file of memory://b/many" in result.stderr
    assert (total("b"), whole.stat().st_mtime_ns) == (21, before)


@pytest.mark.slow
def test_a_sweep_goes_on_with_what_it_read(memory, omnilab_here, monkeypatch):
    monkeypatch.setenv("OMNILAB_PLUGINS", str(Path(__file__).with_name("omnilab_reads.py")))
    words = ("-m", *READS, "hydra.sweep.dir=s", "study.path=memory://b/n.txt,memory://b/many/1.txt")
    assert omnilab_here(*words).rc == 0
    memory.pipe("/b/n.txt", b"43")
    result = omnilab_here("sweep", "resume", "s")
    assert result.rc == 0, result.stderr
    assert [total(f"s/{job}") for job in (0, 1)] == [43, 1], "the job whose object changed was run again"


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("ftp://b/n.txt", "has the protocol ftp, and s3, gs, https, file, memory are taken"),
        ("memory://b/..", "names no file or folder"),
        ("memory://b/n.txt::memory://c", "names no file or folder"),
        (f"s3://me:{SECRET}@b/n.txt", "study.path=s3://b/n.txt came with a user or a password"),
        (f"https://b/n.txt?X-Amz-Signature={SECRET}", "study.path=https://b/n.txt came with a query"),
    ],
)
def test_what_is_not_taken_says_why(url, sentence, memory):
    with pytest.raises(ConfigError) as refused:
        check("study.path", url)
    assert sentence in str(refused.value)
    assert SECRET not in str(refused.value)


def test_what_is_not_there_says_so(memory, tmp_path):
    with pytest.raises(DataError, match=r"x=memory://b/none\.txt: there is nothing of this name; correct it"):
        fetching.fetched("x", "memory://b/none.txt", tmp_path / "c", fetching.Limits(1, True))
    with pytest.raises(ConfigError, match="names the machine elsewhere; give file:///FOLDER"):
        local_path("file://elsewhere/n.txt")
    assert not list(tmp_path.iterdir())
    (tmp_path / "c").write_text("a file")
    with pytest.raises(DataError, match=r"cannot be written .*; mend that, or give another cache=DIR"):
        fetching.fetched("x", "memory://b/n.txt", tmp_path / "c", fetching.Limits(1, True))


@pytest.mark.slow
def test_no_secret_is_written_down(memory, reads, omnilab_here):
    word = f"study.path=memory://b/n.txt,s3://me:{SECRET}@b/n.txt"
    assert omnilab_here("-m", *READS, "hydra.sweep.dir=s", word).rc == 2
    recipe = Path("mine/experiment/r.yaml")
    recipe.parent.mkdir(parents=True)
    recipe.write_text(f"# @package _global_\nstudy:\n  path: s3://me:{SECRET}@b/n.txt\n")
    result = omnilab_here("--config-dir", "mine", "+experiment=r", "study=reads", "~sinks.rerun", "hydra.run.dir=r")
    assert result.rc == 2
    recipe.unlink()
    assert not [path for path in Path().rglob("*") if path.is_file() and SECRET.encode() in path.read_bytes()]


@pytest.mark.slow
def test_cache_limits_and_a_missing_library_say_what_to_do(memory, reads, monkeypatch):
    result = reads("r", "study.path=memory://b/n.txt", "cache=off")
    assert (result.rc, "and cache=off; give cache=DIR, or a local path" in result.stderr) == (2, True)
    result = reads("r", "study.path=memory://b/n.txt", "cache_gb=1e-9")
    assert (result.rc, "has 2e-06 MB in 1 file, and cache_gb=1e-09 is the most; give cache_gb=1" in result.stderr) == (
        2,
        True,
    )
    assert not Path("logs/cache/fetched").exists()
    monkeypatch.delitem(sys.modules, "omnilab.runner.storage.fetching")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    result = reads("r", "study.path=memory://b/n.txt")
    assert (result.rc, "fsspec, which is not installed: pip install 'omnilab[storage]'" in result.stderr) == (2, True)


@pytest.mark.slow
def test_a_file_url_is_its_path(reads, tmp_path):
    (tmp_path / "a n.txt").write_text("5")
    result = reads("r", f"study.path=file://{tmp_path}/a%20n.txt", "cache=off")
    assert result.rc == 0, result.stderr
    assert total("r") == 5


@pytest.mark.slow
def test_a_saved_run_is_no_reason_to_fetch(memory, reads, omnilab_here):
    assert reads("a", "study.path=memory://b/n.txt").rc == 0
    result = omnilab_here("repeat", "a")
    assert result.rc == 2
    assert "the run names study.path=memory://b/n.txt" in result.stderr
    assert "--trust" in result.stderr
    assert omnilab_here("repeat", "a", "--trust").rc == 0
    assert unknown_inputs("descriptor", {"model": "s3://b/net.onnx"}, {"descriptor.model": "0" * 64}) != []


@pytest.mark.slow
def test_addresses_of_live_cameras_and_of_sinks_are_no_inputs():
    words = ["experiment=quickstart", "sensor=camera", "sensor.path=https://127.0.0.1/video"]
    registry = discover()
    config = compose(words, registry).config
    assert urls_of(config) == {}
    assert build(config, registry).sensor.path == "https://127.0.0.1/video"


class Listed:
    """A store whose names are a stranger's."""

    def __init__(self, names: list[str]) -> None:
        self.names = names

    def info(self, path):
        return {"name": path, "type": "directory"}

    def walk(self, path, detail, on_error):
        yield path, {}, {str(i): {"name": name, "size": 1, "ETag": "1"} for i, name in enumerate(self.names)}


@pytest.mark.parametrize(
    "name", ["b/../x", "b/./x", "b//x", "c/x", "/etc/passwd", "b/..\\x", "b/x\0", f"b/{'x' * 256}", "bx"]
)
def test_names_that_lead_elsewhere_are_not_written(name):
    with pytest.raises(DataError, match="which is no name of a file below it"):
        listing(Listed(["b/fine", name]), "b", "s3://b")


def test_there_is_a_most_of_files(monkeypatch):
    monkeypatch.setattr("omnilab.runner.storage.listing.MOST_FILES", 2)
    with pytest.raises(DataError, match="holds more than 2 files; name a folder within it"):
        listing(Listed(["b/1", "b/2", "b/3"]), "b", "s3://b")


@pytest.mark.slow
def test_what_changes_meanwhile_is_not_used(memory, reads, monkeypatch):
    run = fetching.Fetching.run
    monkeypatch.setattr(fetching.Fetching, "run", lambda own: (run(own), memory.pipe("/b/n.txt", b"42")))
    result = reads("r", "study.path=memory://b/n.txt")
    assert (result.rc, "memory://b/n.txt changed while it was fetched; run it again" in result.stderr) == (2, True)


class Server(BaseHTTPRequestHandler):
    """Serves one file; headers and body as the test has them."""

    headers_, body = dict[str, str](), b"7"

    def do_GET(self):
        self.send_response(200 if self.path == "/n.txt" else 404)
        for name, value in {"Content-Length": str(len(self.body)), **self.headers_}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(self.body)

    do_HEAD = do_GET

    def log_message(self, *_):
        """Nothing on the terminal."""


@pytest.fixture
def server(monkeypatch) -> Iterator[str]:
    monkeypatch.setenv("OMNILAB_STORAGE", "http")
    with ThreadingHTTPServer(("127.0.0.1", 0), Server) as http:
        thread = threading.Thread(target=http.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{http.server_port}"
        http.shutdown()
        thread.join()


@pytest.mark.slow
def test_a_web_server_says_which_version_it_has(server, reads, monkeypatch):
    result = reads("r", f"study.path={server}/n.txt")
    assert result.rc == 2
    assert "no version (ETag, Last-Modified), so a copy might be stale" in result.stderr
    assert "there is nothing of this name" in reads("r", f"study.path={server}/none").stderr
    for number, tag in ((b"7", '"1"'), (b"8", '"2"')):
        monkeypatch.setattr(Server, "body", number)
        monkeypatch.setattr(Server, "headers_", {"ETag": tag})
        folder = f"r{number.decode()}"
        result = reads(folder, f"study.path={server}/n.txt")
        assert result.rc == 0, result.stderr
        assert total(folder) == int(number)
