"""What is installed: components, their manuals, plugins that failed."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse, Response

from omnilab.api import KINDS, Kind
from omnilab.client import ComponentRecord
from omnilab_serve.composing import SettingError
from omnilab_serve.rendering import page
from omnilab_serve.service import Here, NotThereError, Service

router = APIRouter(include_in_schema=False)


@router.get("/components")
def components(request: Request, service: Here) -> HTMLResponse:
    catalog = service.composer.catalog()
    found = {kind: [each for each in catalog["components"] if each["kind"] == kind] for kind in KINDS}
    for each in found.values():
        each.sort(key=lambda component: str(component["name"]))
    return page(
        request, "components.html", kinds=KINDS, found=found, failures=catalog["failures"], worlds=catalog["worlds"]
    )


@router.get("/components/{kind}/{name}")
def component(request: Request, service: Here, kind: str, name: str) -> HTMLResponse:
    found = installed(service, kind, name)
    worlds = service.composer.catalog()["worlds"].get(name, []) if kind == "sensor" else []
    return page(request, "component.html", component=found, word=word_for(KINDS[kind], name), worlds=worlds)


@router.get("/components/sensor/{name}/{world}.png")
def picture(service: Here, name: str, world: str) -> Response:
    """What a sensor sees of a world, small; drawn when it is first asked for."""
    try:
        content = service.painter.picture(name, world).read_bytes()
    except (OSError, SettingError) as error:
        raise NotThereError(f"there is no picture of {world} by {name} ({error})") from error
    return Response(content, media_type="image/png", headers={"Cache-Control": "private, max-age=86400"})


def installed(service: Service, kind: str, name: str) -> ComponentRecord:
    """The component of that kind and name; NotThereError if there is none."""
    for each in service.composer.catalog()["components"]:
        if (each["kind"], each["name"]) == (kind, name):
            return ComponentRecord(**each)
    raise NotThereError(f"no {kind} '{name}' is installed")


def word_for(kind: Kind, name: str) -> str:
    """The override that uses a component."""
    if kind.slot or kind.part:
        return f"{kind.name}={name}"
    return f"+{kind.name}@{kind.plural}.{name}={name}"
