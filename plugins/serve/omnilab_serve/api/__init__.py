"""The REST API, a router a subject: as the pages, in JSON."""

from omnilab_serve.api import compare, components, files, queue, reports, runs, session, sweeps

ROUTERS = [module.router for module in (runs, files, sweeps, compare, reports, queue, components, session)]
