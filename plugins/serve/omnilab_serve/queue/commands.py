"""The command lines of submissions, and what may be said to be resumed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from omnilab.errors import DataError
from omnilab.runner.overrides.command_line import quoted
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder import RUNNING, new_folder_name
from omnilab.runner.run_folder.lock import lock_state
from omnilab.runner.sweeps.commands import checked_words
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.plan_file import PLAN, SweepPlan, read_plan
from omnilab_serve.queue.submission_file import SubmissionFile


def new_path(experiment: str) -> str:
    """Of the folder of a run or sweep that is begun now, below the logs."""
    return f"{re.sub(r'[^A-Za-z0-9_-]+', '_', experiment) or 'experiment'}/{new_folder_name()}"


def words_of(record: SubmissionFile, logs: Path) -> list[str]:
    """The words of `omnilab` for the last start of a submission."""
    folder = logs / record.starts[-1].path
    if record.resumes:  # its command is checked again as it is read
        return ["sweep", "resume", str(folder), *(["--retry-failed"] if record.retry_failed else [])]
    words = [*record.words, *([] if logs == Path(record.directory) / "logs" else [f"logs={quoted(str(logs))}"])]
    if not record.sweep:
        return [*words, f"hydra.run.dir={quoted(str(folder))}"]
    if not (folder / JOBS).is_file():
        return [*words, f"hydra.sweep.dir={quoted(str(folder))}"]
    return [*words, f"resume={folder}", *(["retry_failed=on"] if record.retry_failed else [])]


def check_idle(folder: Path, path: str) -> None:
    """DataError if a process leads the sweep in a folder."""
    if (found := lock_state(folder)) and found.state == RUNNING:
        raise DataError(found.sentence(Path(path)))


def resumable(folder: Path, path: str) -> SweepPlan:
    """The plan of a sweep that can go on from here; DataError or ConfigError, in a sentence, for one that cannot.

    What plugins alone know of its words is looked at by the process that runs it.
    """
    plan = read_plan(folder)
    if plan is None:
        raise DataError(f"{path} holds no sweep that could go on (no {PLAN}); run its command again")
    try:
        checked_words(plan, folder, trust=False, registry=Registry())
    except DataError as error:
        trusted = f"omnilab sweep resume --trust {shlex.quote(str(folder))}"
        raise DataError(f"{str(error).partition('; if that')[0]}; if that file is your own: {trusted}") from error
    return plan
