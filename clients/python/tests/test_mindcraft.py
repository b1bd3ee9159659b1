"""`plumbline-client mindcraft`: what the published pipeline leaves becomes a run."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import Running, build, without_settings

from plumbline_client import Client
from plumbline_client.mindcraft import UnreadableRecords, read_records

TEMPLATE = "(async (bot) => {{\n\n/* CODE HERE */\n{}\nlog(bot, 'Code finished.');\n\n}})"


def wrapped(rows: list[list[int]], palette: list[str]) -> str:
    lines = []
    for x, y, z, *placed in rows:
        call = (
            f"placeBlock(bot, '{palette[placed[0]]}', {x}, {y}, {z})" if placed else f"breakBlockAt(bot, {x}, {y}, {z})"
        )
        lines.append(f'    await skills.{call}; if(bot.interrupt_code) {{log(bot, "Code interrupted.");return;}}')
    return TEMPLATE.format("\n".join(lines))


class Pipeline:
    """Writes a folder as the pipeline does: numbers that run on, failed attempts, and paths of another machine."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.index, self.records = folder, 3, list[dict[str, Any]]()
        self.code = folder / "bots/builder/action-code"
        self.code.mkdir(parents=True)
        (folder / "mineCEraft/eval_results").mkdir(parents=True)

    def file(self, text: str) -> None:
        self.index += 1
        (self.code / f"{self.index}.js").write_text(text)

    def turn(self, run: int, turn: int, of: int, prompt: str, is_there: bool = True) -> None:
        path = f"D:\\git\\mineCEraft\\bots\\builder\\action-code\\{self.index}.js" if is_there else None
        self.records.append({
            "run_idx": run, "turn_idx": turn, "n_turns": of, "prompt": prompt, "checks": [], "coords": [],
            "builder_model": "m/7b", "model_safe": "m-7b", "ts": "20260304_220701", "action_file": path,
        })  # fmt: skip

    def save(self) -> Path:
        lines = "".join(json.dumps(record) + "\n" for record in self.records)
        (self.folder / "mineCEraft/eval_results/eval_m-7b_20260304_220701_raw.json").write_text(lines)
        return self.folder


def command(service: Running, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "plumbline_client", "--server", service.url, "mindcraft", *arguments]
    return subprocess.run(line, check=False, capture_output=True, text=True, env=without_settings())


def test_a_run_of_the_pipeline_becomes_a_run(service: Running, client: Client, tmp_path: Path) -> None:
    pipeline = Pipeline(tmp_path)
    tasks = list(client.tasks.all("mineceraft-lite@4"))[:6]
    for number, task in enumerate(tasks, start=1):
        turns = build(task.id)["turns"]
        for turn, (prompt, good) in enumerate(zip(task.prompts, turns, strict=True), start=1):
            # A first attempt that did nothing, and then the wall in two halves.
            half = len(good["rows"]) // 2
            if number == 1:
                pipeline.file("await (((")
            pipeline.file(TEMPLATE.format("//no response"))
            pipeline.file(wrapped(good["rows"][:half], good["palette"]))
            pipeline.file(wrapped(good["rows"][half:], good["palette"]))
            pipeline.turn(number, turn, task.turns, f" {prompt}\n")
    pipeline.save()
    # In the small suite the pipeline counts from 1, so its numbers are those of other tasks.
    refused = command(service, str(tmp_path), "--agent", "piped", "--suite", "mineceraft-lite@4")
    assert (refused.returncode, "19 are missing" in refused.stdout) == (1, True)
    done = command(service, str(tmp_path), "--agent", "piped", "--suite", "mineceraft-lite@4", "--partial")
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(f"server {service.url}\n")
    assert f"{tasks[0].id}: the code of turn 1, file 1 of its files, line " in done.stdout
    run = client.runs.list(agent="piped").runs[0]
    assert (run.graded, run.skipped, run.suite) == (len(tasks), 25 - len(tasks), "mineceraft-lite@4")
    found = client.runs.wait(run.id)
    assert found.summary is not None
    assert len(found.summary.passed_runs.overall) == len(tasks), done.stdout
    done = command(
        service, str(tmp_path), "--agent", "last", "--suite", "mineceraft-lite@4", "--files", "last", "--partial"
    )
    assert "0 of 25 problems pass" in done.stdout


def test_what_contradicts_itself_is_refused_with_its_place(service: Running, client: Client, tmp_path: Path) -> None:
    pipeline = Pipeline(tmp_path)
    pipeline.file("x")
    pipeline.turn(1, 2, 2, "Raise a wall.")
    with pytest.raises(UnreadableRecords, match=r"line 1: turn 2 of task 1 follows turn 0"):
        read_records(pipeline.save(), "all")
    pipeline.records = []
    pipeline.turn(1, 1, 2, "Raise a wall.")
    with pytest.raises(UnreadableRecords, match=r"task 1 has 1 of 2 turns"):
        read_records(pipeline.save(), "all")
    pipeline.records = []
    pipeline.file("y")
    pipeline.turn(1, 1, 1, "p")
    pipeline.turn(2, 1, 1, "q")
    assert [task.turns for task in read_records(pipeline.save(), "all")] == [[["x", "y"]], [[]]]
    pipeline.index = 4
    pipeline.turn(3, 1, 1, "r")
    with pytest.raises(UnreadableRecords, match=r"line 3: action file 4.js after 5.js"):
        read_records(pipeline.save(), "all")
    pipeline.records = []
    pipeline.turn(1, 1, 1, "Raise a wall that no suite knows.")
    done = command(service, str(pipeline.save()), "--agent", "x")
    assert (done.returncode, "no task has these prompts" in done.stderr) == (1, True)
    with (pipeline.folder / "mineCEraft/eval_results/eval_m-7b_20260304_220701_raw.json").open("a") as file:
        file.write('{"run_idx": 1')
    with pytest.raises(UnreadableRecords, match=r"line 2: not JSON"):
        read_records(tmp_path, "all")
    [raw] = (tmp_path / "mineCEraft/eval_results").iterdir()
    raw.write_text(json.dumps(pipeline.records))
    with pytest.raises(UnreadableRecords, match=r"line 1: expected an object on each line; `jq -c '\.\[\]'`"):
        read_records(tmp_path, "all")
    pipeline.save()
    (pipeline.code / f"{pipeline.index}.js").write_bytes("// Stein\nplace('größe')".encode("latin-1"))
    with pytest.raises(UnreadableRecords, match=r"4\.js, line 2: not UTF-8"):
        read_records(tmp_path, "all")
    shutil.rmtree(tmp_path / "mineCEraft")
    with pytest.raises(UnreadableRecords, match="neither raw records"):
        read_records(tmp_path, "all")
    assert client.runs.list(agent="x").runs == []


def test_a_turn_without_a_file_is_empty_and_sorted_folders_are_read(tmp_path: Path) -> None:
    pipeline = Pipeline(tmp_path / "raw")
    pipeline.turn(1, 1, 1, "p", is_there=False)
    pipeline.file("a")
    pipeline.turn(2, 1, 1, "q")
    found = read_records(pipeline.save(), "all")
    assert [(task.name, task.turns) for task in found] == [("1", [[]]), ("2", [["a"]])]
    for number, text in ((9, "nine"), (10, "ten")):
        path = tmp_path / f"folders/walls__5x1x5-raise/1/{number}.js"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    [task] = read_records(tmp_path / "folders", "all")
    assert (task.name, task.turns) == ("walls/5x1x5-raise", [["nine", "ten"]])
