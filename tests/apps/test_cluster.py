"""Shards as jobs: local ones for real, killed and taken away as well; of Slurm, what would be submitted."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gash_jax.apps.cli import gash
from gash_jax.apps.cluster import ShardJob
from gash_jax.files.settings import ConfigError
from gash_jax.files.shards import Shard
from gash_jax.formats.meshes import save_mesh
from gash_jax.shapes.primitives import bumpy_sphere

CORPUS = ["corpus", "mlp", "model.bands=2", "data.validation_shapes=1", "data.rays=16"]
CORPUS += ["data.min_vertices=150", "data.max_vertices=200"]
TINY = [*CORPUS, "data.shapes=4"]
WHY = "needs submitit, which the extra cluster brings"


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def apart(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own: jobs on this machine are its children, and what they leave ends with it."""
    return subprocess.run([sys.executable, "-m", "gash_jax", *arguments], capture_output=True, text=True)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to be in, and a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Programs called srun and sbatch; the second keeps the script that it is given. Returns the script."""
    pytest.importorskip("submitit", reason=WHY)
    (tmp_path / "bin").mkdir()
    for name, text in (("srun", ""), ("sbatch", f"cp $1 {tmp_path}/script\necho Submitted batch job 1234")):
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    return tmp_path / "script"


def test_slurm_gets_an_array_of_shards(slurm: Path, cache: Path, capsys: pytest.CaptureFixture) -> None:
    settings = ("--job", "slurm_partition=long", "--job", "cpus_per_task=8")
    run(*TINY, "--cluster", "slurm", "--shards", "3", *settings)
    said = capsys.readouterr().out
    assert "submitted 3 jobs" in said and "give the same command with --merge 3" in said
    lines = slurm.read_text().splitlines()
    wanted = {"array=0-2%3", "requeue", "partition=long", "cpus-per-task=8", "time=240", "job-name=gash-corpus"}
    assert {f"#SBATCH --{flag}" for flag in wanted} <= set(lines)
    assert any("--signal=USR2@90" in line for line in lines) and "submitit.core._submit" in slurm.read_text()
    jobs = sorted((cache / "jobs").glob("corpus-*/1234_*_submitted.pkl"))
    tasks = [pickle.loads(path.read_bytes()).function for path in jobs]
    assert [task.shard for task in tasks] == [Shard(1, 3), Shard(2, 3), Shard(3, 3)]
    assert tasks[1].checkpoint().function == tasks[1], "what is put into the queue again is the same shard"
    for task in (*tasks, tasks[1]):  # what the jobs do, and one of them once more
        task()
    run(*TINY, "--merge", "3")
    assert "4 shapes to train on, 1 to validate" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--job", "fruit=1"), "fruit"),
        (("--job", "slurm_fruit=1"), "slurm_fruit"),
        (("--job", "timeout_min=long"), "timeout_min"),
        (("--job", "timeout_min"), "not of the form KEY=VALUE"),
        (("data.shapes=none",), "data.shapes"),
    ],
)
def test_what_no_job_could_do_is_not_submitted(slurm: Path, arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        run(*TINY, "--cluster", "slurm", *arguments)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 250 and not slurm.exists()


def test_where_slurm_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("submitit", reason=WHY)
    monkeypatch.setenv("PATH", "nowhere")
    with pytest.raises(ConfigError, match="found no srun: call it where Slurm is, or take --cluster local"):
        run(*TINY, "--cluster", "slurm")


def test_without_submitit_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(ConfigError, match=r"pip install 'gash-jax\[cluster\]'"):
        run(*TINY, "--cluster", "local")


def test_a_job_is_a_shard_of_a_command() -> None:
    save_mesh("a.ply", bumpy_sphere(3))
    save_mesh("b.ply", bumpy_sphere(3))
    run("bake", "a.ply", "b.ply", "-o", "out", "--rays", "4", "--shard", "1/2")
    command = [*"bake a.ply b.ply -o out --rays 4".split(), "--cluster", "local"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gash_jax.apps.shard_options.run_jobs", lambda jobs, quiet: seen.append(jobs) or Path())
        seen: list = []
        with pytest.raises(ValueError, match="b.npz is missing"):  # of the merge that follows
            run(*command, "--shards", "2")
    assert seen[0].number == 2 and seen[0].wait
    ShardJob(seen[0].command, seen[0].options, Shard(2, 2))()
    run("bake", "a.ply", "b.ply", "-o", "out", "--rays", "4", "--merge", "2")


@pytest.mark.slow
def test_local_jobs_do_the_work_and_are_waited_for(cache: Path) -> None:
    pytest.importorskip("submitit", reason=WHY)
    assert "4 shapes to train on, 1 to validate" in apart(*TINY, "--cluster", "local", "--shards", "2").stdout
    found = {path.name: path.read_bytes() for path in (cache / "corpus").iterdir()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GASH_CACHE", "other")
        run(*TINY, "--quiet")
    assert found == {path.name: path.read_bytes() for path in Path("other/corpus").iterdir()}
    Path("bad.ply").write_text("hello")
    save_mesh("good.ply", bumpy_sphere(3))
    done = apart(*"bake bad.ply good.ply -o out --rays 4 --cluster local --shards 2".split())
    assert "error: 1 of 2 jobs failed, what the others did is kept: shard 1/2: 1 of 1 meshes" in done.stderr
    assert done.returncode != 0 and Path("out/good.npz").is_file()


def _children(pid: int) -> list[int]:
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


@pytest.mark.slow
@pytest.mark.parametrize("sign", ["SIGKILL", "SIGUSR2"])
def test_a_job_that_is_killed_or_taken_away_is_run_again(cache: Path, sign: str) -> None:
    """SIGKILL is what an end without memory or a node looks like; SIGUSR2 is what Slurm sends before it takes a job."""
    pytest.importorskip("submitit", reason=WHY)
    if not Path("/proc/self/task").is_dir():
        pytest.skip("needs /proc, to find the job")
    command = [sys.executable, "-m", "gash_jax", *CORPUS, "data.shapes=13", "--cluster", "local", "--shards", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        while not (items := list((cache / "corpus").glob("*.npz"))):
            assert process.poll() is None, "it ended before anything was baked"
            time.sleep(0.005)
        stamp = items[0].stat().st_mtime_ns
        (job,) = [job for controller in _children(process.pid) for job in _children(controller)]
        os.kill(job, getattr(signal, sign))
        said, _ = process.communicate(timeout=600)
    finally:
        process.kill()
    assert process.returncode == 0 and "13 shapes to train on, 1 to validate" in said
    assert items[0].stat().st_mtime_ns == stamp and len(list((cache / "corpus").glob("*.npz"))) == 14
    logs = "".join(path.read_text() for path in (cache / "jobs").glob("corpus-*/*_log.*"))
    assert logs.count("Loading pickle") == 2, "the job was started twice"
