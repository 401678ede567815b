"""Reports: runs and sweeps as one HTML file that needs nothing else."""

from omnilab_serve.reports.command import report as report
