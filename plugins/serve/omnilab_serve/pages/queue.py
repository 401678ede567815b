"""What waits, runs, and has ended."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from omnilab.client import Submission
from omnilab_serve.rendering import page
from omnilab_serve.service import Here, NotThereError, Service

router = APIRouter(include_in_schema=False)
ENDED = 25  # as many of those that have ended are shown at first
STOPPED = (
    "It is told to end, as by Ctrl-C: what it has logged stays readable.",
    "It is told to end by SIGTERM.",
    "It is ended by SIGKILL.",
)


@router.get("/queue")
def queue(request: Request, service: Here, ended: int = ENDED) -> HTMLResponse:
    return page(request, "queue.html", **_content(service, ended))


@router.get("/parts/queue")
def queue_part(request: Request, service: Here, ended: int = ENDED) -> HTMLResponse:
    return page(request, "part_queue.html", **_content(service, ended))


@router.get("/queue/{identity}")
def submission(request: Request, service: Here, identity: str) -> HTMLResponse:
    return page(request, "submission.html", **_one(service, identity))


@router.get("/parts/queue/{identity}")
def submission_part(request: Request, service: Here, identity: str) -> HTMLResponse:
    return page(request, "part_submission.html", **_one(service, identity))


@router.post("/queue/{identity}/cancel")
def cancel(request: Request, service: Here, identity: str) -> HTMLResponse:
    there(service, identity)
    now = service.queue.cancel(identity)
    sentence = STOPPED[min(now.stopping, 3) - 1] if now.state == "running" else "It is taken out of the queue."
    return page(request, "part_answer.html", sentence=sentence)


@router.post("/queue/{identity}/retry")
def retry(request: Request, service: Here, identity: str) -> HTMLResponse:
    there(service, identity)
    return _queued(request, service.queue.retry(identity))


@router.post("/queue/{identity}/sooner")
def sooner(request: Request, service: Here, identity: str) -> HTMLResponse:
    return _moved(request, service, identity, 1)


@router.post("/queue/{identity}/later")
def later(request: Request, service: Here, identity: str) -> HTMLResponse:
    return _moved(request, service, identity, -1)


@router.post("/runs-stop/{path:path}")
@router.post("/sweeps-stop/{path:path}")
def stop(request: Request, service: Here, path: str) -> HTMLResponse:
    service.queue.interrupt(service.path(service.folder(path)))
    return page(request, "part_answer.html", sentence=STOPPED[0])


@router.post("/sweeps-resume/{path:path}")
def resume(request: Request, service: Here, path: str, retry_failed: bool = False) -> HTMLResponse:
    return _queued(request, service.queue.resume(service.path(service.folder(path)), retry_failed))


def there(service: Service, identity: str) -> Submission:
    """A submission; NotThereError if there is none of that id."""
    if (found := service.queue.submission(identity)) is None:
        raise NotThereError(f"there is no submission {identity}; the page Queue has those there are")
    return found


def _moved(request: Request, service: Service, identity: str, by: int) -> HTMLResponse:
    now = service.queue.prioritise(identity, there(service, identity).priority + by)
    return page(request, "part_answer.html", sentence=f"Its priority is {now.priority}; the larger, the sooner.")


def _queued(request: Request, now: Submission) -> HTMLResponse:
    return page(request, "part_answer.html", sentence="It is in the queue:", submission=now)


def _content(service: Service, most: int) -> dict[str, Any]:
    found = service.queue.submissions()
    running = [one for one in found if one.state == "running"]
    ended = sorted((one for one in found if one.ended), key=lambda one: one.ended or "", reverse=True)
    return {
        "running": running,
        "queued": service.queue.waiting(),
        "ended": ended[:most],
        "more": len(ended) - most,
        "folders": _folders(service, [*running, *ended[:most]]),
    }


def _folders(service: Service, submissions: Iterable[Submission]) -> set[str]:
    """The paths of those whose folder is there: of what has just begun it is not yet."""
    return {one.path for one in submissions if one.path and (service.settings.logs / one.path).is_dir()}


def _one(service: Service, identity: str) -> dict[str, Any]:
    one = there(service, identity)
    return {"one": one, "output": service.queue.output(identity), "folders": _folders(service, [one])}
