"""Runs and sweeps side by side: the numbers of `omnilab compare`, charts of them, and their recordings as one."""

from omnilab_serve.comparing.documents import Comparisons as Comparisons
