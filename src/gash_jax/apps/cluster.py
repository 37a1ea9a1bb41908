"""Shards as jobs of a cluster: the only file that imports submitit.

A job calls a command as the command line would, with its shard, in a process of submitit's. What is lost with a job
is the piece that it was at: jobs that Slurm ends early (time limit, preemption, a node that fails) are put into its
queue again, and while the submitting process waits it submits a job that ended without a word again, a few times.
What submitit writes, jobs, results and logs, stands in a folder of its own below the cache folder, which all machines
must see.
"""

import time
import uuid
from pathlib import Path
from typing import Any, NamedTuple

from gash_jax.apps.progress import UpdateFn, progress_bar
from gash_jax.files.caches import cache_folder, keep_compiled_programs, quiet_compiler
from gash_jax.files.settings import ConfigError
from gash_jax.files.shards import Shard

TIMES = 3  # that a job is submitted by a process that waits for it
SETTINGS = {"slurm": {"timeout_min": 240}, "local": {"timeout_min": 60 * 24 * 30}}  # submitit's own: 5 and 2 minutes
ENDS = 1000  # times that a job may reach its time limit: it gets on each time
POLL_SECONDS = 0.5


class Jobs(NamedTuple):
    """How a command is given to a cluster: its name and options, jobs, settings of each, whether to wait for them."""

    command: str
    options: dict[str, Any]
    cluster: str
    number: int
    settings: tuple[str, ...]
    wait: bool


class ShardJob(NamedTuple):
    """What a job does: one shard of a command with its options."""

    command: str
    options: dict[str, Any]
    shard: Shard

    def __call__(self) -> None:
        """Run the shard in this process."""
        from gash_jax.apps.cli import load_command  # whose commands lead here

        quiet_compiler()
        keep_compiled_programs()
        callback = load_command(self.command).callback
        assert callback is not None
        none = {"merge": None, "cluster": None, "shards": self.shard.total, "job": (), "wait": False}
        callback(**self.options, **none, shard=self.shard)

    def checkpoint(self) -> Any:
        """What submitit puts into the queue when a job is ended early: the same, as finished pieces are kept."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self)


def run_jobs(jobs: Jobs, quiet: bool) -> Path:
    """Submit all shards of a command, and wait for them where that was asked for; the folder of their logs.

    Raises ConfigError where submitit or the cluster is not there, for settings that it does not know, and where a job
    failed.
    """
    folder = cache_folder().resolve() / "jobs" / f"{jobs.command}-{uuid.uuid4().hex[:8]}"
    executor = _executor(jobs, folder)
    tasks = [ShardJob(jobs.command, jobs.options, Shard(i + 1, jobs.number)) for i in range(jobs.number)]
    try:
        with executor.batch():  # one array of jobs to Slurm
            submitted = [executor.submit(task) for task in tasks]
    except (RuntimeError, OSError) as error:
        raise ConfigError(f"the jobs were not submitted, sbatch said: {error}") from None
    if jobs.wait:
        with progress_bar(f"{jobs.number} jobs", quiet) as update:
            failures = _wait(executor, list(zip(tasks, submitted, strict=True)), update)
        if failures:
            said = "; ".join(failures)
            raise ConfigError(f"{len(failures)} of {jobs.number} jobs failed, what the others did is kept: {said}")
    return folder


def _executor(jobs: Jobs, folder: Path) -> Any:
    """What submits to the cluster, with the settings of a job."""
    try:
        import submitit
    except ImportError:
        raise ConfigError("--cluster needs submitit: pip install 'gash-jax[cluster]'") from None
    settings: dict[str, Any] = {"name": f"gash-{jobs.command}", **SETTINGS[jobs.cluster]}
    for text in jobs.settings:
        key, equals, value = text.partition("=")
        if not (key and equals and value):
            raise ConfigError(f"--job {text} is not of the form KEY=VALUE, such as timeout_min=600")
        settings[key] = int(value) if value.isdecimal() else value
    if jobs.cluster == "slurm":
        settings["slurm_additional_parameters"] = {"requeue": True}  # after the failure of a node, too
    try:
        executor = submitit.AutoExecutor(folder, jobs.cluster, **{f"{jobs.cluster}_max_num_timeout": ENDS})
        executor.update_parameters(**settings)
    except RuntimeError:
        raise ConfigError("--cluster slurm found no srun: call it where Slurm is, or take --cluster local") from None
    except (NameError, AssertionError, ValueError, TypeError) as error:
        said = str(error).splitlines()[0].split(" Valid arguments")[0]
        raise ConfigError(f"--job: {said}; settings are timeout_min, cpus_per_task, slurm_partition ...") from None
    return executor


def _wait(executor: Any, jobs: list[tuple[ShardJob, Any]], update: UpdateFn) -> list[str]:
    """Wait for all jobs; one that ended without a word (killed, out of memory) is submitted again. What failed."""
    from submitit.core.utils import FailedJobError

    running = {task.shard: (task, job, 1) for task, job in jobs}
    failures = []
    while running:
        time.sleep(POLL_SECONDS)
        for shard, (task, job, times) in list(running.items()):
            if not job.done():
                continue
            error = job.exception()
            if error is not None and not isinstance(error, FailedJobError) and times < TIMES:
                running[shard] = task, executor.submit(task), times + 1
                continue
            del running[shard]
            if error is not None:
                failures.append(f"shard {shard}: {_reason(error, times)}")
        update(len(jobs) - len(running), len(jobs))
    return failures


def _reason(error: Exception, times: int) -> str:
    """One line of what submitit tells: the last of the job's own traceback, where there is one."""
    parts = str(error).split("-" * 22)
    if len(parts) < 3:
        return f"ended {times} times without a word (killed, or out of memory)"
    return parts[1].strip().splitlines()[-1].partition(": ")[2]
