"""The queue, as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Body

from omnilab.client import Submission, SubmissionRequest
from omnilab_serve.pages.queue import there
from omnilab_serve.service import Here

router = APIRouter(prefix="/api/submissions", tags=["queue"])
InBody = Body(embed=True)


@router.get("")
def submissions(service: Here) -> Sequence[Submission]:
    """All submissions, the newest first."""
    return service.queue.submissions()


@router.post("", status_code=201)
def submit(service: Here, request: SubmissionRequest) -> Submission:
    """Put a run or a sweep into the queue."""
    return service.queue.submit(request)


@router.post("/resume", status_code=201)
def resume(service: Here, path: Annotated[str, InBody], retry_failed: Annotated[bool, InBody] = False) -> Submission:
    """Go on with the sweep of a path, which may have been started elsewhere."""
    return service.queue.resume(service.path(service.folder(path)), retry_failed)


@router.post("/interrupt", status_code=204)
def interrupt(service: Here, path: Annotated[str, InBody]) -> None:
    """Ctrl-C for the run or sweep of a path, whoever started it on the service's machine."""
    service.queue.interrupt(service.path(service.folder(path)))


@router.get("/{identity}")
def submission(service: Here, identity: str) -> Submission:
    """One submission."""
    return there(service, identity)


@router.get("/{identity}/output")
def output(service: Here, identity: str) -> str:
    """The end of what its last process has printed."""
    there(service, identity)
    return service.queue.output(identity)


@router.post("/{identity}/cancel")
def cancel(service: Here, identity: str) -> Submission:
    """Take it out of the queue; interrupt it if it runs, the second time by SIGTERM, the third by SIGKILL."""
    there(service, identity)
    return service.queue.cancel(identity)


@router.post("/{identity}/retry")
def retry(service: Here, identity: str) -> Submission:
    """Put it into the queue again, once it has ended; a sweep goes on where it is."""
    there(service, identity)
    return service.queue.retry(identity)


@router.post("/{identity}/priority")
def prioritise(service: Here, identity: str, priority: Annotated[int, InBody]) -> Submission:
    """Another place in the queue; the larger, the sooner."""
    there(service, identity)
    return service.queue.prioritise(identity, priority)
