"""What stands between Hydra's sweeper and its launcher, so that a sweep survives its workers and can be resumed.

Hydra's sweepers hand jobs to a launcher, whichever it is: this process, joblib's workers, a cluster's queue. This one
numbers them, leaves out those that are done, and has the launcher that was chosen run the others. Should that one come to
grief because a worker died, the worker's job has failed, and the rest goes on.
"""

from __future__ import annotations

import copy
import os
import time
from collections.abc import Iterable, Mapping, Sequence

from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict, read_write

from omnilab.errors import OmnilabError
from omnilab.runner.build import build
from omnilab.runner.registry import discover
from omnilab.runner.run_folder.names import DONE, INTERRUPTED, KILLED, RUNNING
from omnilab.runner.sweeps.active import ActiveSweep
from omnilab.runner.sweeps.display import SweepDisplay
from omnilab.runner.sweeps.identity import job_identity
from omnilab.runner.sweeps.job_log import PLANNED
from omnilab.runner.sweeps.jobs import JOB
from omnilab.runner.sweeps.objective import value_of
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.state import Job

TARGET = "hydra_plugins.omnilab.SweepLauncher"  # Hydra asks its plugins to have such a name
POLL_S, QUIET_S = 0.5, 30.0  # between looks at jobs of other processes; after which what waits is launched anew

MANY = 50  # jobs that take some seconds to look at
CUT_OFF = (KILLED, INTERRUPTED)

Jobs = Mapping[int, Sequence[str]]  # overrides by number


class SweepLauncher(Launcher):
    """Has another launcher run what is not done yet, and once more what a dead worker took along."""

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        assert ActiveSweep.now is not None
        # Ray's workers are this Python: below `uv run` it would have `uv run` make them an environment each, and may hang
        os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
        os.environ.setdefault("RAY_worker_niceness", "0")  # Ray's own is 15: they would wait for all that others do
        self._sweep, self._context = ActiveSweep.now, hydra_context
        self._display = SweepDisplay(SweepReader(self._sweep.folder, self._sweep.log.unwritten).load)
        self._registry = getattr(task_function, "registry", None) or discover()
        self._config = config.copy()
        with read_write(self._config), open_dict(self._config):
            self._config.hydra.launcher = self._sweep.launcher
        self._inner = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=self._config
        )

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:  # noqa: ARG002
        """What the jobs returned, in their order; their numbers are the sweep's, which may have been begun before."""
        jobs = self._sweep.plan(job_overrides)
        stand = self._stand(jobs)
        if (done := sum(job.state == DONE for job in stand.values())) >= MANY:
            self._sweep.say(f"{done} jobs are done; whether anything has changed since is looked at first")
        to_run = {n: jobs[n] for n in jobs if self._sweep.to_run(stand[n], lambda n=n: self._identity(jobs[n]))}  # type: ignore[misc]
        with self._display:
            returned = self._survive(to_run)
            ended = self._settled([n for n in jobs if stand[n].state == RUNNING], patience_s=0)
            returned |= self._survive({n: jobs[n] for n, job in ended.items() if job.state in CUT_OFF})
        stand = self._stand(jobs)
        return [returned.get(n) or self._returned(stand[n]) for n in jobs]

    def _survive(self, jobs: Jobs) -> dict[int, JobReturn]:
        """Launch jobs, also when workers die: those of which one may have killed its worker once more, each alone."""
        returned: dict[int, JobReturn] = {}
        groups = [list(jobs)] if jobs else []
        while groups:
            group = groups.pop(0)
            try:
                returned |= self._launch({n: jobs[n] for n in group})
            except Exception as error:
                if all(job.state == PLANNED for job in self._stand(group).values()):
                    raise  # this is about no worker
                stand = self._settled(group, self._patience_s)
                died = [n for n in group if stand[n].state in CUT_OFF]
                if len(died) == 1:
                    self._note_death(died[0], error)
                else:
                    groups += [[n] for n in died]
                if waiting := [n for n in group if stand[n].state == PLANNED]:
                    groups.insert(0, waiting)
        return returned

    def _launch(self, jobs: Jobs) -> dict[int, JobReturn]:
        """What jobs return from the launcher that was chosen, which is told their numbers."""
        numbered = [[*overrides, f"+hydra.job.env_set.{JOB}='{n}'"] for n, overrides in jobs.items()]
        return dict(zip(jobs, self._inner.launch(numbered, initial_job_idx=0), strict=True))

    @property
    def _patience_s(self) -> float:
        """How long a job may wait after the launcher's failure: joblib's workers are gone with it, a cluster's are not."""
        return 0.0 if "joblib" in type(self._inner).__module__ else QUIET_S

    def _settled(self, numbers: Iterable[int], patience_s: float) -> dict[int, Job]:
        """How jobs stand once none of them goes on, and none was begun for this time."""
        wanted, quiet_s = list(numbers), time.monotonic()
        while True:
            stand = self._stand(wanted)
            states, now_s = {job.state for job in stand.values()}, time.monotonic()
            if RUNNING in states:
                quiet_s = now_s
            elif PLANNED not in states or now_s - quiet_s >= patience_s:
                return stand
            time.sleep(POLL_S)

    def _stand(self, numbers: Iterable[int]) -> dict[int, Job]:
        """How jobs stand, by number."""
        wanted = set(numbers)
        if not wanted:
            return {}
        return {job.number: job for job in self._sweep.load().jobs if job.number in wanted}

    def _note_death(self, number: int, error: Exception) -> None:
        """A job whose process died: it has failed."""
        why = f"its process died ({type(error).__name__}); too little memory is the likeliest reason"
        self._sweep.say(f"job {number}: {why}")
        self._sweep.log.append({"event": KILLED, "job": number, "error": why})

    def _identity(self, overrides: Sequence[str]) -> str | None:
        """The identity that a job would have now; None if it could not even be built."""
        config = self._context.config_loader.load_sweep_config(self._config, list(overrides))
        before = HydraConfig.instance().cfg
        try:
            HydraConfig.instance().set_config(config)
            own = copy.deepcopy(config)
            with read_write(own), open_dict(own):
                del own["hydra"]
            run = build(own, self._registry)
            return job_identity(run, self._registry)
        except OmnilabError:
            return None
        finally:
            HydraConfig.instance().cfg = before

    def _returned(self, job: Job) -> JobReturn:
        """What a job returned that was run before, or elsewhere."""
        found = JobReturn(overrides=list(job.overrides), status=JobStatus.COMPLETED)
        done = job.state == DONE
        found.return_value = value_of(self._config.objective, job.metrics) if done else f"the job is {job.state}"
        return found


Plugins.instance().class_name_to_class[TARGET] = SweepLauncher  # without a module where Hydra would look for plugins
