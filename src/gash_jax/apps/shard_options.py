"""--shard, --merge and --cluster: the same for every command whose work is a list of pieces (`files.shards`).

A command takes `work` and says in its own words what its pieces are. Checks of its input come before
`work = by_jobs(work, quiet)`, so that no job is submitted for what every job would refuse.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple

import click

from gash_jax.apps.cluster import Jobs, run_jobs
from gash_jax.apps.printing import say
from gash_jax.files.shards import Shard, read_shard

CLUSTERS = ("slurm", "local")


class Work(NamedTuple):
    """Which pieces a command is to do: one shard's, by jobs, none but merge what so many shards did; else all."""

    shard: Shard | None = None
    merge: int | None = None
    jobs: Jobs | None = None


class _ShardType(click.ParamType):
    name = "i/n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Shard:
        """A shard from its text."""
        try:
            return value if isinstance(value, Shard) else read_shard(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


OPTIONS = (
    click.option(
        "--shard",
        type=_ShardType(),
        metavar="I/N",
        help="Do part I of N alone, such as --shard 2/8 on one of 8 machines (docs/machines.md).",
    ),
    click.option(
        "--merge",
        type=click.IntRange(1),
        metavar="N",
        help="Check what N shards did, piece by piece, and finish, such as --merge 8.",
    ),
    click.option(
        "--cluster", type=click.Choice(CLUSTERS), help="Submit the shards as jobs, such as --cluster slurm --shards 8."
    ),
    click.option("--shards", type=click.IntRange(1), default=4, show_default=True, help="With --cluster: how many."),
    click.option(
        "--job",
        multiple=True,
        metavar="KEY=VALUE",
        help="With --cluster: what a job asks for, such as timeout_min=600 or slurm_partition=long; repeatable.",
    ),
    click.option(
        "--wait", is_flag=True, help="With --cluster slurm: wait for the jobs and merge; local jobs always do."
    ),
)


def shard_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options above; it gets them as `work`."""

    @wraps(command)
    def with_work(
        *,
        shard: Shard | None,
        merge: int | None,
        cluster: str | None,
        shards: int,
        job: tuple[str, ...],
        wait: bool,
        **options: Any,
    ) -> None:
        if sum(choice is not None for choice in (shard, merge, cluster)) > 1:
            raise click.UsageError("--shard, --merge and --cluster are three steps: give one of them")
        if cluster is None and (job or wait):
            raise click.UsageError("--job and --wait are for jobs: give them with --cluster")
        jobs = None
        if cluster is not None:
            name = click.get_current_context().info_name or ""
            jobs = Jobs(name, options, cluster, shards, job, wait or cluster == "local")
        command(**options, work=Work(shard, merge, jobs))

    for option in reversed(OPTIONS):
        option(with_work)
    return with_work


def by_jobs(work: Work, quiet: bool) -> Work | None:
    """Submit the jobs, if asked for. What is left to do here: the merge, where they were waited for, or None."""
    if work.jobs is None:
        return work
    folder = run_jobs(work.jobs, quiet)
    if work.jobs.wait:
        return Work(merge=work.jobs.number)
    say(f"submitted {work.jobs.number} jobs, their logs will be in {folder}", quiet)
    say(f"when they have ended, give the same command with --merge {work.jobs.number} in place of --cluster", quiet)
    return None
