"""What is asked to be run, held against Hydra's grammar, the builder, and what may come over the network."""

from __future__ import annotations

import shlex

from omnilab.client import CheckedRequest, SubmissionRequest
from omnilab_serve.composing.composer import Composer


class Composed(CheckedRequest):
    """An experiment that the builder accepts."""

    @property
    def is_sweep(self) -> bool:
        """Also of one job: `range(0,1)` is a sweep, and its folder that of one."""
        return "-m" in self.command

    @property
    def line(self) -> str:
        """The command for a shell."""
        return shlex.join(["omnilab", *self.command])


def check_request(request: SubmissionRequest, composer: Composer) -> Composed:
    """The experiment that is asked for; SettingError in the builder's own sentence for one that cannot, or must not, be run."""
    return Composed(**composer.check(request.overrides, request.launcher))
