"""Runs side by side: what differs, paired differences, curves, and their recordings as one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from starlette.responses import FileResponse, HTMLResponse

from omnilab.errors import ConfigError
from omnilab.runner.run_folder.names import STATUS
from omnilab_serve.comparing.charts import error_charts, metric_charts, recall_chart
from omnilab_serve.comparing.merged import MERGED, merge_recordings
from omnilab_serve.comparing.words import best_of, ordered
from omnilab_serve.pages.viewer import viewer_page
from omnilab_serve.rendering import page
from omnilab_serve.service import Here, Service

router = APIRouter(include_in_schema=False)
BESIDE = 6  # configurations that are columns; more are rows
MOST_MERGED = 8  # recordings in one view, as `omnilab view` takes
CHOICES = 60
RunPaths = Annotated[list[str], Query(alias="run", default_factory=list)]


@router.get("/compare")
def compare(request: Request, service: Here, runs: RunPaths, best: str = "", metric: str = "") -> HTMLResponse:
    found = folders(service, runs)
    if not found or (len(found) == 1 and (found[0] / STATUS).is_file()):  # one run alone is compared with nothing
        shown = service.index.search("", limit=CHOICES)
        sweeps = service.index.sweeps()
        return page(request, "compare_choice.html", found=shown, sweeps=sweeps, chosen=unique(runs), q="")
    return page(request, "compare.html", runs=unique(runs), address=address(runs, best, metric))


@router.get("/parts/compare-choices")
def choices(request: Request, service: Here, runs: RunPaths, q: str = "") -> HTMLResponse:
    """The runs that a query finds, and those that are ticked already."""
    found = service.index.search(q, limit=CHOICES)
    return page(request, "part_compare_choices.html", found=found, chosen=unique(runs), q=q)


@router.get("/parts/compare")
def comparison(request: Request, service: Here, runs: RunPaths, best: str = "", metric: str = "") -> HTMLResponse:
    document = service.comparisons.document(folders(service, runs))
    names = [one["name"] for one in document["metrics"]]
    for name in (best.removeprefix("-"), metric):
        if name and name not in names:
            raise ConfigError(f"these runs have no metric {name} to compare; there is {', '.join(names)}")
    shown = metric or best.removeprefix("-") or next(iter(names), "")
    charts = [*error_charts(document), *filter(None, [recall_chart(document)])]
    return page(
        request, "part_comparison.html", document=document, rows=ordered(document, best), best=best,
        winners=best_of(document, best), metric=shown, charts=charts, curves=metric_charts(document, shown),
        runs=unique(runs), address=address(runs, "", metric), beside=BESIDE,
        mergeable=len(document["runs"]) in range(2, MOST_MERGED + 1),
    )  # fmt: skip


@router.get("/parts/merged")
def merged(request: Request, service: Here, runs: RunPaths) -> HTMLResponse:
    """The viewer with the recordings of runs as one."""
    key, warnings = merge_recordings(folders(service, runs))
    return page(request, "part_merged.html", key=key, warnings=warnings)


@router.get("/merged/{key}")
def merged_viewer(request: Request, key: str) -> HTMLResponse:
    MERGED.file(key)
    return viewer_page(request, f"/merged/{key}/runs.rrd")


@router.get("/merged/{key}/runs.rrd")
def merged_file(key: str) -> FileResponse:
    return FileResponse(MERGED.file(key), media_type="application/octet-stream", filename="runs.rrd")


def folders(service: Service, runs: Sequence[str]) -> list[Path]:
    """The folders of runs and sweeps, each once; NotThereError for one that is not below the logs."""
    return list(dict.fromkeys(service.folder(path) for path in runs))


def unique(runs: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(runs))


def address(runs: Sequence[str], best: str = "", metric: str = "") -> str:
    """The query of a comparison's address."""
    words = [f"run={quote(path)}" for path in unique(runs)]
    words += [f"{name}={quote(value)}" for name, value in (("best", best), ("metric", metric)) if value]
    return "&".join(words)
