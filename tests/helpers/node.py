"""Packages of npm in node: three.js and the glTF validator of Khronos, installed once a session; else tests skip."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

PACKAGES = ("three@0.187.0", "gltf-validator@2.0.0-dev.3.10")


def node_modules() -> Path:
    """The folder that holds them, or skip the test."""
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("needs node and npm, which are not installed")
    folder = Path(os.environ["GASH_TEST_CACHE"]) / "npm"
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock"):
        done = folder / "installed.json"
        if not done.is_file():
            command = ["npm", "install", "--no-audit", "--no-fund", "--prefix", str(folder), *PACKAGES]
            try:
                result = subprocess.run(command, capture_output=True, text=True, timeout=120)
                done.write_text(json.dumps(result.returncode == 0))
            except subprocess.TimeoutExpired:
                done.write_text("false")
        if not json.loads(done.read_text()):
            pytest.skip(f"needs {' and '.join(PACKAGES)} from npm, which could not be installed")
    return folder


def run_node(script: str, *arguments: Path | str) -> Any:
    """What a script (a module, with `require`) prints as JSON; the arguments follow in process.argv from 2 on."""
    folder = node_modules()
    head = "import { createRequire } from 'module'; import fs from 'fs';"
    head += f" const require = createRequire({json.dumps(str(folder / 'script.mjs'))});\n"
    path = folder / f"script-{os.getpid()}.mjs"
    path.write_text(head + script)
    result = subprocess.run(["node", str(path), *map(str, arguments)], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr[-2000:]
    return json.loads(result.stdout)


VALIDATE = """
const report = await require('gltf-validator').validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])));
console.log(JSON.stringify(report));
"""


def validator_errors(path: Path) -> list[str]:
    """Errors that Khronos' validator finds in a glTF file."""
    messages = run_node(VALIDATE, path)["issues"]["messages"]
    return [f"{m['code']} {m['message']} {m.get('pointer', '')}" for m in messages if m["severity"] == 0]
