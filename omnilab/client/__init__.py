"""The service from elsewhere: what `omnilab serve` answers, as data, and a client that asks it."""

from omnilab.client.client import Client
from omnilab.client.models import (
    CheckedRequest,
    ComponentRecord,
    JobRecord,
    LogTail,
    PluginFailure,
    RecipeRecord,
    RunFile,
    RunPage,
    RunRecord,
    Session,
    StageProgress,
    Submission,
    SubmissionRequest,
    SweepRecord,
)

__all__ = [
    "CheckedRequest",
    "Client",
    "ComponentRecord",
    "JobRecord",
    "LogTail",
    "PluginFailure",
    "RecipeRecord",
    "RunFile",
    "RunPage",
    "RunRecord",
    "Session",
    "StageProgress",
    "Submission",
    "SubmissionRequest",
    "SweepRecord",
]
