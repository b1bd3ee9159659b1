"""`plumbline-client mindcraft`."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import httpx
from tqdm import tqdm

from .. import __version__
from ..client import Client
from ..errors import Conflict, Faulty
from ..mindcraft import TaskRecord, UnreadableRecords, read_records
from ..models import CodeError, TaskSummary
from ..refused import without_refused


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "mindcraft", help="submit what the published pipeline left of a run of mindcraft, as a run"
    )
    parser.set_defaults(run=run)
    parser.add_argument("records", type=Path, metavar="RECORDS", help="folder with raw records and action files")
    parser.add_argument("--agent", required=True, help="name on the board")
    parser.add_argument("--suite", default="mineceraft@1", help="suite whose prompts were given (mineceraft@1)")
    parser.add_argument("--track", choices=["specified", "brief"], default="specified")
    parser.add_argument(
        "--profile", choices=["mindcraft", "published"], help="rules for code; by default those of the suite"
    )
    parser.add_argument(
        "--files",
        choices=["all", "last"],
        default="all",
        help="all files of a turn, or the last alone, which is what the published pipeline grades (all)",
    )
    parser.add_argument(
        "--any-prompt", action="store_true", help="do not compare the prompts of the records with the suite's"
    )
    parser.add_argument(
        "--partial", action="store_true", help="submit although tasks are missing, which then count as failed"
    )
    parser.add_argument("--dry-run", action="store_true", help="read and compare only")


def run(given: argparse.Namespace) -> int:
    """Runs the command."""
    records = read_records(given.records, given.files)
    with Client(given.server, given.key) as client:
        print(f"server {httpx.URL(client.url).copy_with(userinfo=b'')}", file=sys.stderr)
        suite = client.suites.get(given.suite).id
        known = list(client.tasks.all(suite, track=given.track))
        paired = pairs(records, known, must_match=not given.any_prompt)
        missing = len(known) - len(paired)
        print(
            f"{len(paired)} tasks of {suite}, {sum(len(record.turns) for record, _ in paired)} turns; {missing} are missing"
        )
        if missing and not given.partial:
            print(
                "missing tasks would count as failed: --suite names the suite of the records, --partial submits them as they are"
            )
            return 1
        if given.dry_run:
            return 0
        metadata = {"harness": "mindcraft", "importer": f"plumbline-client {__version__}", "files": given.files}
        # Importing the same records again continues the same run.
        told = [[record.name, record.turns] for record in records]
        content = json.dumps([given.agent, suite, given.track, given.profile, given.files, told])
        key = f"mindcraft-{hashlib.sha256(content.encode()).hexdigest()}"
        run = client.runs.create(
            agent=given.agent, suite=suite, track=given.track, metadata=metadata, idempotency_key=key
        )
        for record, task in tqdm(paired, unit="task", disable=None):
            turns: list[dict[str, Any]] = [
                {"action_code": texts} if texts else {"events": []} for texts in record.turns
            ]
            reasons: list[str] = []
            try:
                accepted = client.submissions.create(run=run.id, task=task.id, profile=given.profile, turns=turns)
            except Faulty as refused:
                turns, reasons = without_refused(turns, refused)
                accepted = client.submissions.create(run=run.id, task=task.id, profile=given.profile, turns=turns)
            reasons += [why_failed(replay.turn, replay.error) for replay in accepted.action_code or [] if replay.error]
            if reasons:
                tqdm.write(f"{task.id}: {'; '.join(reasons)}")
        try:
            client.runs.finish(run.id, skip="unanswered")
        except Conflict as ended:
            # A run finishes by itself once every task is graded.
            if ended.kind != "run-not-open":
                raise
        done = client.runs.wait(run.id)
    passed = len(done.summary.passed_runs.overall) if done.summary is not None else 0
    print(
        f"run {done.id} is {done.state}: {passed} of {done.tasks} problems pass; {done.skipped} were not in the records"
    )
    return 0


def why_failed(turn: int, error: CodeError) -> str:
    """Says which code of a turn failed, and with which error."""
    file = "" if error.file is None else f", file {error.file} of its files"
    line = "" if error.line is None else f", line {error.line}"
    return f"the code of turn {turn}{file}{line} failed: {error.message}"


def pairs(
    records: list[TaskRecord], known: list[TaskSummary], *, must_match: bool
) -> list[tuple[TaskRecord, TaskSummary]]:
    """Finds the task of each record: by its prompts if it has any, else by its number or id.

    Raises an error that lists the records without a task. The pipeline numbers the tasks of a small suite anew, so that a
    number alone would name another task of the whole one.
    """
    by_name = {name: task for task in known for name in (str(task.number), task.id)}
    by_prompts = {tuple(map(normal, task.prompts)): task for task in known}
    found, faults = [], []
    for record in records:
        has_prompts = must_match and any(record.prompts)
        prompts = tuple(map(normal, record.prompts))
        task = by_prompts.get(prompts) if has_prompts else by_name.get(record.name)
        if task is None:
            reason = "no task has these prompts" if has_prompts else "no task has this number or id"
            faults.append(f"task {record.name}: {reason}")
        elif len(record.turns) != task.turns:
            faults.append(f"task {record.name}: {len(record.turns)} turns, but {task.id} has {task.turns}")
        else:
            found.append((record, task))
    twice = {task.id for _, task in found if sum(task.id == other.id for _, other in found) > 1}
    faults += [f"{task} has several records" for task in sorted(twice)]
    if faults:
        hint = (
            "\n--suite names the suite whose prompts were given; --any-prompt goes by number alone"
            if must_match
            else ""
        )
        raise UnreadableRecords("\n".join(faults[:20]) + hint)
    return found


def normal(prompt: str) -> str:
    """Returns a prompt with white space as single blanks."""
    return " ".join(prompt.split())
