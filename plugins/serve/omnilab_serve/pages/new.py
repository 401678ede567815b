"""The form by which an experiment is started."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from starlette.datastructures import FormData
from starlette.responses import HTMLResponse, Response

from omnilab.client import SubmissionRequest
from omnilab.errors import ConfigError, OmnilabError
from omnilab.manifest import recipe_of
from omnilab_serve.composing import SettingError, check_request
from omnilab_serve.composing.filled import SET, Filled, filled_by, is_main, laid_out
from omnilab_serve.rendering import page
from omnilab_serve.service import Here, NotThereError, Service

router = APIRouter(include_in_schema=False)


async def posted(request: Request) -> FormData:
    """The fields of a form, whatever they are."""
    return await request.form()


Fields = Annotated[FormData, Depends(posted)]


@router.get("/new")
def new(
    request: Request,
    service: Here,
    experiment: str = "",
    override: Annotated[list[str] | None, Query()] = None,
    run: Annotated[str, Query(alias="from")] = "",
) -> HTMLResponse:
    catalog = service.composer.catalog()
    if run:
        manifest = service.run(run).manifest
        override = [str(word) for word in manifest["overrides"]]
        if (recipe := recipe_of(str(manifest["experiment"]), override)) is None:
            raise NotThereError(f"the run {run} has no recipe, and a form is one of a recipe; start it by its command")
        experiment = recipe
    if not experiment:
        return page(request, "new.html", recipes=catalog["recipes"], failures=catalog["failures"])
    if experiment not in [recipe["name"] for recipe in catalog["recipes"]]:
        raise NotThereError(f"there is no recipe '{experiment}'; choose another")
    filled = filled_by(experiment, override or [], service.composer)
    form = filled.form(service.composer)
    return page(
        request, "new_form.html", form=form, laid_out=laid_out(form), launchers=catalog["launchers"], origin=run,
        **_fields(filled),
    )  # fmt: skip


@router.post("/parts/new/slot")
def slot(request: Request, service: Here, fields: Fields) -> HTMLResponse:
    """A slot anew, with the component that was chosen for it."""
    path = str(fields.get("slot", ""))
    form = _filled(fields).form(service.composer)
    found = [slot for slot in form["slots"] if slot["path"] == path]
    if not found:
        raise NotThereError(f"the experiment has no slot {path}")
    filled = _filled(fields)
    own = {name: value for name, value in filled.fields.items() if not name.startswith(f"{SET}{path}.")}
    part = page(request, "part_new_slot.html", slot=found[0], **_fields(Filled(filled.experiment, own)))
    part.headers["HX-Trigger-After-Settle"] = "slot-changed"
    return part


@router.post("/parts/new/check")
def check(request: Request, service: Here, fields: Fields) -> HTMLResponse:
    """What the form comes to so far: the command and its jobs, or what is wrong."""
    try:
        composed = check_request(_request(fields, service), service.composer)
    except OmnilabError as error:
        return _refused(request, error)
    return page(request, "part_new_outcome.html", composed=composed, sentence=None, setting=None)


@router.post("/new")
def start(request: Request, service: Here, fields: Fields) -> Response:
    """Put it into the queue, and show that."""
    try:
        service.queue.submit(_request(fields, service))
    except OmnilabError as error:
        return _refused(request, error)
    return Response(headers={"HX-Redirect": "/queue"})


def _refused(request: Request, error: OmnilabError) -> HTMLResponse:
    setting = error.setting if isinstance(error, SettingError) else None
    return page(request, "part_new_outcome.html", composed=None, sentence=str(error), setting=setting)


def _filled(fields: FormData) -> Filled:
    given = {name: [str(value) for value in fields.getlist(name)] for name in fields if ":" in name}
    more = [line.strip() for line in str(fields.get("more", "")).splitlines()]
    return Filled(str(fields.get("experiment", "")), given, [line for line in more if line])


def _request(fields: FormData, service: Service) -> SubmissionRequest:
    try:
        priority = int(str(fields.get("priority") or 0))
    except ValueError as error:
        raise ConfigError(f"priority={fields.get('priority')} is no whole number; give one such as 0") from error
    return SubmissionRequest(_filled(fields).words(service.composer), priority, str(fields.get("launcher", "basic")))


def _fields(filled: Filled) -> dict[str, Any]:
    """What templates ask of what was filled in."""
    return {"given": filled.fields, "more": filled.more, "is_main": is_main}
