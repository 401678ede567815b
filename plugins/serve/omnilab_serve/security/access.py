"""Who may come in: whoever knows the token, by a header or by the cookie that the login page gives for it."""

from __future__ import annotations

import hashlib
import hmac
import time

from starlette.requests import HTTPConnection

MOST_WRONG, WINDOW_S = 10, 60.0  # wrong tokens of one address, before it is told to wait
MOST_ADDRESSES = 1000  # that are remembered
ROUNDS = 200_000  # of the digest that the cookie is: who guesses tokens by cookies pays this for each


class Access:
    """The token of a service, or that it has none; compared in constant time."""

    def __init__(self, token: str | None, port: int) -> None:
        self._token = token.encode() if token else None
        self.cookie_name = f"omnilab_{port}"  # browsers send cookies to every port of a host
        self.cookie_value = ""
        if self._token:  # survives a new start of the service with the same token
            self.cookie_value = hashlib.pbkdf2_hmac("sha256", self._token, b"omnilab cookie", ROUNDS).hex()
        self._wrong: dict[str, list[float]] = {}

    @property
    def is_open(self) -> bool:
        """Whether no token is needed."""
        return self._token is None

    def by_header(self, connection: HTTPConnection) -> bool | None:
        """Whether `Authorization: Bearer` has the token; None if there is no such header."""
        scheme, _, given = connection.headers.get("authorization", "").partition(" ")
        return self.try_token(connection, given.strip()) if scheme.lower() == "bearer" else None

    def by_cookie(self, connection: HTTPConnection) -> bool:
        """Whether the cookie of the login page was sent."""
        given = connection.cookies.get(self.cookie_name, "")
        return not self.is_open and hmac.compare_digest(given.encode(), self.cookie_value.encode())

    def try_token(self, connection: HTTPConnection, given: str) -> bool:
        """Whether this is the token; a wrong one counts against the address that it came from."""
        right = self._token is not None and hmac.compare_digest(given.encode(), self._token)
        if not right:
            address = _address(connection)
            self._wrong[address] = [*self._recent(address), time.monotonic()]
            while len(self._wrong) > MOST_ADDRESSES:
                del self._wrong[next(iter(self._wrong))]
        return right

    def is_guessing(self, connection: HTTPConnection) -> bool:
        """Whether too many wrong tokens came from this address of late to look at another."""
        return len(self._recent(_address(connection))) >= MOST_WRONG

    def _recent(self, address: str) -> list[float]:
        since = time.monotonic() - WINDOW_S
        return [when for when in self._wrong.get(address, []) if when > since]


def _address(connection: HTTPConnection) -> str:
    return connection.client.host if connection.client else ""
