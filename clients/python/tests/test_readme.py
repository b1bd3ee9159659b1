"""The examples of the README run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY, Running, without_settings

README = (REPOSITORY / "clients/python/README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_runs(example: str, service: Running, tmp_path: Path) -> None:
    program = tmp_path / "example.py"
    program.write_text(example)
    environment = {**without_settings(), "PLUMBLINE_SERVER": service.url}
    done = subprocess.run([sys.executable, program], check=True, capture_output=True, text=True, env=environment)
    assert done.stdout.strip(), done.stderr


def test_the_options_of_the_readme_exist() -> None:
    parts = []
    for command in ("evaluate", "mindcraft"):
        line = [sys.executable, "-m", "plumbline_client", command, "--help"]
        parts.append(subprocess.run(line, check=True, capture_output=True, text=True).stdout)
    others = {
        "--no-push",
        "--resume",
        "--message-limit",
        "--limit",
        "--include_path",
        "--apply_chat_template",
        "--model_args",
    }
    others |= {"--tasks", "--reward", "--data", "--client", "--env", "--model-base-url"}
    named = set(re.findall(r"--[a-z][a-z_-]*", README)) - others
    assert named <= set(re.findall(r"--[a-z_-]+", "".join(parts)))
