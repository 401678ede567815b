"""The service from elsewhere: what `omnilab serve` answers, as data, and a client that asks it."""

from omnilab.client.client import Client
from omnilab.client.models import (
    ComponentRecord,
    JobRecord,
    LogTail,
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
    "Client",
    "ComponentRecord",
    "JobRecord",
    "LogTail",
    "RunFile",
    "RunPage",
    "RunRecord",
    "Session",
    "StageProgress",
    "Submission",
    "SubmissionRequest",
    "SweepRecord",
]
