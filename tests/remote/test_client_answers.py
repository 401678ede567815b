"""The client before servers that are none, lie, or are not there."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from omnilab.client import Client, RunPage, RunRecord, Submission, connection
from omnilab.client.reader import read, read_each
from omnilab.errors import ConfigError, DataError
from omnilab.runner.cli import main

RUN = {"path": "grid/a", "state": "done"}


@pytest.fixture
def answering() -> Iterator[Callable[..., Client]]:
    """A client of a server that always answers the same: `answering(body, status, **headers)`."""
    servers = []

    def start(body: bytes, status: int = 200, **headers: str) -> Client:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(status)
                for name, value in ({"Content_Type": "application/json"} | headers).items():
                    self.send_header(name.replace("_", "-"), value)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return Client(f"http://127.0.0.1:{server.server_port}")

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


# -------------------------------------------------------------------------------------------------------- the records
def test_records_are_read_with_what_they_hold():
    progress = {"fraction": 1, "words": "all", "left_s": None}
    data = {"total": 1, "runs": [RUN | {"metrics": {"a": 1, "b": None}, "progress": progress, "overrides": ["x=1"]}]}
    page = read(RunPage, data)
    assert isinstance(page.runs[0], RunRecord)
    assert page.runs[0].metrics == {"a": 1.0, "b": None}
    assert page.runs[0].progress is not None
    assert page.runs[0].progress.fraction == 1.0
    assert page.runs[0].overrides == ["x=1"]


def test_what_a_newer_server_adds_is_left_out():
    assert read(RunRecord, RUN | {"mood": "good"}) == RunRecord("grid/a", "done")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"path": 3}, "the answer.path is '3', which is not a text"),
        ({"path": None}, "the answer.path is 'None', which is not a text"),
        ({"metrics": {"a": "1"}}, "the answer.metrics.a is '1', which is not a number"),
        ({"metrics": {"a": True}}, "the answer.metrics.a is 'True', which is not a number"),
        ({"overrides": "x=1"}, "the answer.overrides is 'x=1', which is not an array"),
        ({"progress": []}, "the answer.progress is '[]', which is not an object"),
        ({"progress": {}}, "the answer.progress has no 'fraction'"),
    ],
)
def test_what_is_of_another_type_is_one_sentence(change, sentence):
    with pytest.raises(DataError) as told:
        read(RunRecord, RUN | change)
    assert str(told.value).startswith(sentence)


def test_an_array_is_read_record_by_record():
    data = [{"id": "a", "state": "done", "overrides": []}, {"id": "b", "state": "done"}]
    assert read_each(Submission, data[:1]) == [Submission("a", "done", [])]
    with pytest.raises(DataError, match=r"the answer\[1\] has no 'overrides', which every Submission has"):
        read_each(Submission, data)


# --------------------------------------------------------------------------------------------------------- the server
def test_the_servers_sentence_is_the_error(answering):
    for status, kind in ((422, ConfigError), (401, ConfigError), (404, DataError), (500, DataError)):
        with pytest.raises(kind) as told:
            answering(b'{"detail": "say it so"}', status).session()
        assert str(told.value) == "say it so"


@pytest.mark.parametrize(
    ("body", "status", "headers", "sentence"),
    [
        (b"<h1>Hello</h1>", 200, {"Content_Type": "text/html"}, "answers with text/html (status 200)"),
        (b"{", 200, {}, "answers with damaged JSON"),
        (b"[" * 200_000, 200, {}, "answers with damaged JSON"),
        (b"", 302, {"Location": "http://evil.example/"}, "answers with a redirection to http://evil.example/"),
        (b"[]", 403, {}, "refuses, and does not say why (status 403)"),
        (b"{}" * 2000, 200, {}, "is larger than 1000 bytes"),
        (b"{}", 200, {"Content_Length": "5"}, "cannot be asked (IncompleteRead"),
    ],
)
def test_what_is_no_answer_of_ours_is_one_sentence(answering, monkeypatch, body, status, headers, sentence):
    if "larger" in sentence:
        monkeypatch.setattr(connection, "MOST_BYTES", 1000)
    with pytest.raises((ConfigError, DataError)) as told:
        answering(body, status, **headers).session()
    assert sentence in str(told.value)


def test_an_answer_that_does_not_end_is_given_up(answering, monkeypatch):
    client = answering(b"{}", Content_Length="5000000")
    monkeypatch.setattr(connection, "TIMEOUT_S", 0.0)
    with pytest.raises(DataError, match=r"did not answer within|cannot be asked"):
        client.session()


@pytest.mark.parametrize(
    "url", ["", "lab", "ftp://lab", "http://", "http://lab:port", "http://lab/page", "file:///etc/passwd"]
)
def test_what_is_no_address_is_refused(url, monkeypatch):
    monkeypatch.setenv("OMNILAB_SERVER", "nothing either")
    with pytest.raises(ConfigError, match="is no address of a server; give one such as http://127"):
        Client(url)


def test_the_printed_address_has_the_token():
    asked = connection.Connection("http://lab:8700/login?token=a-token-of-the-tests")
    assert (asked.url, asked.token) == ("http://lab:8700", "a-token-of-the-tests")


def test_no_server_says_how_to_start_one(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["submit", "experiment=quickstart", "--server", "http://127.0.0.1:1"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "omnilab: no server is at http://127.0.0.1:1; start one: omnilab serve\n"


def test_a_folder_and_a_server_are_one_too_many(capsys, tmp_path):
    with pytest.raises(SystemExit):
        main(["runs", str(tmp_path), "--server", "http://127.0.0.1:1"])
    assert "give either a folder" in capsys.readouterr().err
