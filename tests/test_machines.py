"""docs/machines.md says what holds: its commands parse, its script gives every task its shard, its numbers are ours."""

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from gash_jax.apps.cli import load_command
from gash_jax.apps.cluster import SETTINGS, TIMES
from gash_jax.files.atomic import FileError
from gash_jax.files.shards import check_merge
from gash_jax.train.truth import FRAMES

PAGE = (Path(__file__).parents[1] / "docs" / "machines.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```\w*\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
COMMANDS = [
    line for block in BLOCKS for line in re.findall(r"\bgash ((?:corpus|sweep|bake|animate) [^\"#&\n]+)", block)
]


@pytest.mark.parametrize("text", COMMANDS)
def test_commands_parse(text: str) -> None:
    words = re.sub(r"\$\w+/(\$\w+|\d)", "1/3", text)
    name, *arguments = shlex.split(words)
    load_command(name).make_context(name, arguments)


def test_there_are_commands_of_every_step() -> None:
    said = " ".join(COMMANDS)
    assert len(COMMANDS) >= 8 and all(word in said for word in ("--shard", "--merge", "--cluster slurm", "--job"))


def test_the_script_of_slurm_gives_every_task_its_shard(tmp_path: Path) -> None:
    (script,) = [block for block in BLOCKS if block.startswith("#!/bin/bash")]
    assert {"--array=1-8", "--requeue"} <= set(re.findall(r"^#SBATCH (\S+)$", script, re.MULTILINE))
    (tmp_path / "gash").write_text('#!/bin/sh\necho "$PWD $GASH_CACHE $@"\n')
    (tmp_path / "gash").chmod(0o755)
    task = {"SLURM_SUBMIT_DIR": str(tmp_path), "SLURM_ARRAY_TASK_ID": "3", "SLURM_ARRAY_TASK_COUNT": "8"}
    environment = {**os.environ, **task, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == f"{tmp_path} {tmp_path}/cache sweep sweep.toml -o runs/sweep --jobs 4 --shard 3/8\n"


def test_numbers_and_messages_are_ours() -> None:
    assert f"| {FRAMES} frames |" in PAGE
    assert f"may take {SETTINGS['slurm']['timeout_min']} minutes" in PAGE
    assert TIMES == 3 and "submits one\n  that was killed up to three times" in PAGE
    faults = ["baked/bunny.npz is missing" if number in (1, 4, 9, 12) else "" for number in range(60)]
    with pytest.raises(FileError) as caught:
        check_merge(faults, 8)
    assert f"\nerror: {caught.value}\n" in PAGE
