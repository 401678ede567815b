"""Requests to one server: bounded, in time, to no other host."""

from __future__ import annotations

import http.client
import json
import os
import ssl
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from omnilab.errors import ConfigError, DataError, OmnilabError

SERVER_VARIABLE, TOKEN_VARIABLE = "OMNILAB_SERVER", "OMNILAB_TOKEN"
MOST_BYTES = 64_000_000  # of an answer
TIMEOUT_S = 60.0  # of an answer, from its question to its end
CHUNK = 65536


class Connection:
    """Where a server is, and how it is asked. Redirects are not followed, proxies are not used."""

    def __init__(self, url: str | None = None, token: str | None = None) -> None:
        url = url or os.environ.get(SERVER_VARIABLE, "http://127.0.0.1:8700")
        try:
            found = urlsplit(url)
            self._host, self._port = found.hostname or "", found.port
        except ValueError:
            found, self._host, self._port = urlsplit(""), "", None
        if found.scheme not in {"http", "https"} or not self._host or found.path not in {"", "/", "/login"}:
            raise ConfigError(f"'{url}' is no address of a server; give one such as http://127.0.0.1:8700")
        self._secure = found.scheme == "https"
        self.url = f"{found.scheme}://{found.netloc.rpartition('@')[2]}"
        given = parse_qs(found.query).get("token", [None])[0]  # the address that `omnilab serve` prints has it
        self.token = token or given or os.environ.get(TOKEN_VARIABLE)

    def request(
        self, method: str, path: str, query: Mapping[str, Any] | None = None, body: object = None, csrf: str = ""
    ) -> Any:
        """The answer, from JSON; ConfigError or DataError with the server's sentence."""
        with self._answer(method, target(path, query), body, csrf) as answer:
            text = _read_all(answer, self.url)
            if answer.status == 204:
                return None
            data = _json(answer, text, self.url)
            if answer.status >= 400:
                raise _refusal(answer.status, data, self.url)
            return data

    def pieces(self, path: str) -> Iterator[bytes]:
        """The bytes at a path, as they come."""
        with self._answer("GET", target(path), None, "") as answer:
            if answer.status != 200:
                raise DataError(f"{self.url} has no file {path} (status {answer.status})")
            while piece := answer.read(CHUNK):
                yield piece
            if answer.length:
                raise DataError(f"{self.url} ended in the midst of {path}; get it again")

    @contextmanager
    def _answer(self, method: str, where: str, body: object, csrf: str) -> Iterator[http.client.HTTPResponse]:
        headers = {"Accept": "application/json", "Connection": "close"}
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        if csrf:
            headers["X-CSRF-Token"] = csrf
        if body is not None:
            headers["Content-Type"] = "application/json"
        connection = self._connection()
        try:
            connection.request(method, where, None if body is None else json.dumps(body), headers)
            with connection.getresponse() as answer:
                yield answer
        except TimeoutError as error:
            raise DataError(f"{self.url} did not answer within {TIMEOUT_S:.0f} s; is it overloaded?") from error
        except ConnectionRefusedError as error:
            raise ConfigError(f"no server is at {self.url}; start one: omnilab serve") from error
        except (OSError, http.client.HTTPException) as error:
            raise DataError(
                f"{self.url} cannot be asked ({str(error) or type(error).__name__}); is omnilab serve there?"
            ) from error
        finally:
            connection.close()

    def _connection(self) -> http.client.HTTPConnection:
        if self._secure:
            return http.client.HTTPSConnection(
                self._host, self._port, timeout=TIMEOUT_S, context=ssl.create_default_context()
            )
        return http.client.HTTPConnection(self._host, self._port, timeout=TIMEOUT_S)


def target(path: str, query: Mapping[str, Any] | None = None) -> str:
    """A path and a query as a request has them."""
    return quote(path, safe="/") + (f"?{urlencode(query, doseq=True)}" if query else "")


def _read_all(answer: http.client.HTTPResponse, url: str) -> bytes:
    """The whole answer: no larger, and not longer underway, than is believable."""
    until, text = time.monotonic() + TIMEOUT_S, bytearray()
    while piece := answer.read1(CHUNK):
        text += piece
        if len(text) > MOST_BYTES:
            raise DataError(f"the answer of {url} is larger than {MOST_BYTES} bytes; ask for less, with a limit")
        if time.monotonic() > until:
            raise TimeoutError
    if answer.length:
        raise http.client.IncompleteRead(bytes(text), answer.length)
    return bytes(text)


def _json(answer: http.client.HTTPResponse, text: bytes, url: str) -> Any:
    kind = answer.headers.get_content_type()
    if answer.status < 300 or answer.status >= 400:
        try:
            if kind == "application/json":
                return json.loads(text)
        except (ValueError, RecursionError):
            kind = "damaged JSON"
    what = f"a redirection to {answer.headers.get('location')}" if 300 <= answer.status < 400 else kind
    raise DataError(f"{url} answers with {what} (status {answer.status}), which omnilab serve does not")


def _refusal(status: int, data: Any, url: str) -> OmnilabError:
    """The server's own sentence as an error."""
    detail = data.get("detail") if isinstance(data, dict) else None
    sentence = detail if isinstance(detail, str) else f"{url} refuses, and does not say why (status {status})"
    return DataError(sentence) if status == 404 or status >= 500 else ConfigError(sentence)
