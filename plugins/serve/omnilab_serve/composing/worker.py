"""The process of its own: answers requests on standard input, one a line of JSON, with the plugins that are installed."""

from __future__ import annotations

import json
import os
import queue
import threading
import traceback
from collections.abc import Callable, Mapping
from typing import IO, Any

from omnilab.errors import OmnilabError, of_machine
from omnilab.runner.registry import Registry, discover
from omnilab_serve.composing.catalog import catalog
from omnilab_serve.composing.checking import check
from omnilab_serve.composing.composer import SettingError
from omnilab_serve.composing.form import form
from omnilab_serve.composing.pictures import picture

CALLS: Mapping[str, Callable[..., Any]] = {"catalog": catalog, "form": form, "check": check, "picture": picture}


def main() -> None:
    """Answer until standard input ends: with the service, whatever a plugin is doing."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what plugins print is none of the answers
    requests = _requests(os.fdopen(os.dup(0), encoding="utf-8"))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    registry = discover()
    while True:
        answers.write(json.dumps(answer(requests.get(), registry)) + "\n")
        answers.flush()


def _requests(stream: IO[str]) -> queue.Queue[str]:
    """The lines of a stream, at whose end the process ends."""
    lines: queue.Queue[str] = queue.Queue()

    def read() -> None:
        for line in stream:
            lines.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    return lines


def answer(line: str, registry: Registry) -> dict[str, Any]:
    """What a request is answered: a result; a refusal, in a sentence; or the traceback of a bug."""
    try:
        request = json.loads(line)
        return {"result": CALLS[request["call"]](registry, **request["arguments"])}
    except SettingError as refused:
        return {"refused": str(refused), "setting": refused.setting}
    except Exception as error:  # noqa: BLE001  the next request may be a better one
        if mistake := error if isinstance(error, OmnilabError) else of_machine(error):
            return {"refused": str(mistake), "setting": None}
        return {"bug": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}


if __name__ == "__main__":
    main()
