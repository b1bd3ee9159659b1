"""A real service for the tests: the program of the repository, on a port and a database of its own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from plumbline_client import Client

REPOSITORY = Path(__file__).parents[3]
PROGRAM = os.environ.get("PLUMBLINE_PROGRAM") or str(REPOSITORY / "target/debug/plumbline")


class Running:
    """A started service."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self.database = folder / "p.db"
        log = folder / "log"
        with log.open("wb") as file:
            listen = [] if "--listen" in arguments else ["--listen", "127.0.0.1:0"]
            command = [PROGRAM, "serve", *listen, "--database", str(self.database), *arguments]
            self.process = subprocess.Popen(command, stdout=file, stderr=file, env=without_settings())
        self.url = self._address(log)

    def _address(self, log: Path) -> str:
        for _ in range(600):
            found = re.search(r"http://127\.0\.0\.1:\d+", log.read_text(errors="replace"))
            if found:
                try:
                    if httpx.get(f"{found[0]}/readyz").status_code == 200:
                        return found[0]
                except httpx.TransportError:
                    pass
            if self.process.poll() is not None:
                break
            time.sleep(0.1)
        raise AssertionError(log.read_text())

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(120)

    def run(self, *arguments: str) -> str:
        command = [PROGRAM, *arguments, "--database", str(self.database)]
        return subprocess.run(command, check=True, capture_output=True, text=True, env=without_settings()).stdout


def verified_afterwards(running: Running, epoch: str, kept: Path, answers: int) -> str:
    """Ends an epoch, verifies its reveal against what a lab kept of it, and returns what was said."""
    running.run("epochs", "close", epoch, "--reason", "the test is over")
    reveal = running.database.with_name("reveal.json")
    for _ in range(600):
        response = httpx.get(f"{running.url}/v1/epochs/{epoch}/reveal")
        if response.status_code == 200:
            break
        time.sleep(0.1)
    reveal.write_bytes(response.raise_for_status().content)
    command = [PROGRAM, "verify-epoch", str(reveal), "--given", str(kept)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=without_settings())
    assert done.returncode == 0, done.stdout
    # Each of them is in the reveal: without one of them, it is missed.
    lacking = json.loads(reveal.read_bytes())
    signed = [one for one in lacking["receipts"] if one["receipt"].get("answer")]
    assert len(signed) == answers
    lacking["receipts"].remove(signed[-1])
    reveal.write_text(json.dumps(lacking))
    broken = subprocess.run(command, check=False, capture_output=True, text=True, env=without_settings())
    assert broken.returncode == 1
    assert "is missing from the reveal" in broken.stdout
    return done.stdout


def without_settings() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.startswith("PLUMBLINE")}


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service that is open to everyone."""
    running = Running(tmp_path_factory.mktemp("service"), "--open")
    yield running
    running.stop()


@pytest.fixture
def client(service: Running) -> Iterator[Client]:
    with Client(service.url) as client:
        yield client


def build(task: str, *arguments: str) -> dict[str, Any]:
    """Returns a good build of a task, or a broken one, as a submission."""
    command = [PROGRAM, "build", task, "--format", "submission", *arguments]
    built = subprocess.run(command, check=True, capture_output=True, text=True, env=without_settings())
    found: dict[str, Any] = json.loads(built.stdout)
    return found


WALL = "walls/5x1x5-raise"


@pytest.fixture(scope="session")
def wall() -> dict[str, Any]:
    return build(WALL)
