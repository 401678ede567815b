"""A sweep: its jobs as a grid, figures, resume and stop."""

from __future__ import annotations

import shlex

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from omnilab.runner.run_folder import DONE
from omnilab.runner.sweeps.snapshot import Snapshot
from omnilab.runner.sweeps.status_table import advice, overall
from omnilab_serve.rendering import page
from omnilab_serve.service import Here, Service
from omnilab_serve.sweeps.grid import failures, job_grid, settings_of, sorted_jobs
from omnilab_serve.sweeps.watched import sweep_with_jobs

router = APIRouter(include_in_schema=False)
MOST_ROWS = 100  # of jobs, until all are asked for
TIMES = 12  # as often at least are the statistics of a sweep that goes on computed again, until it ends


@router.get("/sweeps/{path:path}")
def sweep(
    request: Request, path: str, service: Here, metric: str = "", sort: str = "", every: bool = False
) -> HTMLResponse:
    return _page(request, "sweep.html", service, path, metric, sort, every)


@router.get("/parts/sweep-jobs/{path:path}")
def sweep_part(
    request: Request, path: str, service: Here, metric: str = "", sort: str = "", every: bool = False
) -> HTMLResponse:
    return _page(request, "part_sweep.html", service, path, metric, sort, every)


def _page(
    request: Request, template: str, service: Service, path: str, metric: str, sort: str, every: bool
) -> HTMLResponse:
    seen = service.watched.snapshot(service.sweep(path).folder)
    shown = sweep_with_jobs(seen, service.path)
    metrics = list(dict.fromkeys(name for job in shown.jobs for name in job.metrics))
    jobs = sorted_jobs(shown.jobs, sort)
    return page(
        request, template, sweep=shown, words=overall(seen), advice=advice(seen), settings_of=settings_of,
        commands=_commands(seen), grid=job_grid(shown, metric), metric=metric, metrics=metrics, sort=sort,
        jobs=jobs if every else jobs[:MOST_ROWS], every=every, failures=failures(shown.jobs), done=_done(seen),
    )  # fmt: skip


def _commands(seen: Snapshot) -> dict[str, str]:
    """Words to copy: how the sweep was started, and how it goes on."""
    plan, folder = seen.sweep.plan, shlex.quote(str(seen.sweep.folder))
    found = {"Start it again": f"omnilab {shlex.join(plan.command)}"} if plan else {}
    return found | {
        "Go on": f"omnilab sweep resume {folder}",
        "Go on, failed jobs too": f"omnilab sweep resume {folder} --retry-failed",
        "Watch": f"omnilab sweep status {folder} --watch",
        "Compare": f"omnilab compare {folder}",
    }


def _done(seen: Snapshot) -> str:
    """Another text whenever the statistics are worth another look; "" while there are none."""
    done = seen.sweep.counts.get(DONE, 0)
    if not done:
        return ""
    return str(done // max(1, seen.total // TIMES)) if seen.goes_on else f"all-{done}"
