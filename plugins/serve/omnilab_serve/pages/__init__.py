"""The pages, a router a page."""

from omnilab_serve.pages import (
    compare,
    components,
    events,
    login,
    new,
    queue,
    reports,
    run,
    run_list,
    sweep,
    sweep_list,
    viewer,
)

ROUTERS = [
    module.router
    for module in (run_list, run, viewer, sweep_list, sweep, compare, reports, queue, new, components, events, login)
]
