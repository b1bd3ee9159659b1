"""`plumbline-client evaluate`, as a lab runs it: the command, a real service, and an endpoint that is not always well."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from conftest import Running, build, verified_afterwards, without_settings
from endpoint import Endpoint, Reply, code_of

from plumbline_client import Client

Messages = list[dict[str, Any]]


@pytest.fixture
def endpoint() -> Iterator[Callable[[Callable[[Messages], Reply]], Endpoint]]:
    made: list[Endpoint] = []

    def make(answer: Callable[[Messages], Reply]) -> Endpoint:
        made.append(Endpoint(answer))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture(scope="session")
def answers(service: Running) -> dict[str, str]:
    """A good answer to each prompt of the small suite, and of some tasks of the large one."""
    good = {}
    with Client(service.url) as client:
        for task in client.tasks.all("mineceraft-lite"):
            built = build(task.id)
            for prompt, turn in zip(task.prompts, built["turns"], strict=True):
                good[prompt] = code_of(turn)
    return good


class Evaluate:
    """Runs the command."""

    def __init__(self, service: Running, folder: Path) -> None:
        self.service, self.folder = service, folder

    def command(self, endpoint: Endpoint, *arguments: str) -> list[str]:
        command = [sys.executable, "-m", "plumbline_client", "--server", self.service.url, "evaluate"]
        return [
            *command,
            "--model",
            "canned",
            "--base-url",
            endpoint.url,
            "--folder",
            str(self.folder),
            "--patience",
            "60",
            *arguments,
        ]

    def __call__(self, endpoint: Endpoint, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        environment = {**without_settings(), "OPENAI_API_KEY": "sk-test"}
        done = subprocess.run(
            self.command(endpoint, *arguments), check=False, capture_output=True, text=True, env=environment
        )
        assert done.returncode == code, f"{done.returncode}: {done.stdout}{done.stderr}"
        return done

    def outcome(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.folder / "outcome.json").read_text())
        return found

    def journal(self, kind: str) -> list[dict[str, Any]]:
        entries = [json.loads(line) for line in (self.folder / "journal.jsonl").read_text().splitlines()]
        return [entry for entry in entries if entry["kind"] == kind]


@pytest.fixture
def evaluate(service: Running, tmp_path: Path) -> Evaluate:
    return Evaluate(service, tmp_path / "evaluation")


def asked(messages: Messages) -> str:
    return str(next(m["content"] for m in reversed(messages) if m["role"] == "user"))


def test_a_model_becomes_a_row_on_the_board(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    model = endpoint(lambda messages: Reply(answers[asked(messages)]))
    prices = ["--price-input", "2", "--price-output", "10", "--prices-as-of", "2026-11-01"]
    done = evaluate(
        model,
        "--suite",
        "mineceraft-lite",
        "--agent",
        "row",
        "--temperature",
        "0.2",
        "--seed",
        "7",
        "--repeat",
        "2",
        *prices,
    )
    assert "25 of 25 problems pass" in done.stdout
    runs = evaluate.outcome()["runs"]
    board = client.boards.get("mineceraft-lite", agent="row")
    assert board.rows[0].overall is not None
    assert board.rows[0].overall.rate == 1.0
    assert {str(run.id) for run in client.runs.list(agent="row").runs} == set(runs)
    assert {request["seed"] for request in model.seen} == {7, 8}
    assert {request["temperature"] for request in model.seen} == {0.2}
    assert all("max_tokens" not in request and "top_p" not in request for request in model.seen)
    assert set(model.keys) == {"Bearer sk-test"}
    spending = evaluate.outcome()["spending"]
    assert spending["requests"] == len(model.seen)
    assert spending["cost"] == pytest.approx(len(model.seen) * (100 * 2 + 10 * 10) / 1e6)
    transcripts = list((evaluate.folder / "transcripts").rglob("*.json"))
    assert len(transcripts) == 50
    assert all("messages" in json.loads(path.read_text()) for path in transcripts)
    [group] = client.boards.repeats("mineceraft-lite").groups
    assert ({str(run) for run in group.runs}, group.mean) == (set(runs), 1.0)
    # Running it again repeats nothing.
    evaluate(
        model,
        "--suite",
        "mineceraft-lite",
        "--agent",
        "row",
        "--temperature",
        "0.2",
        "--seed",
        "7",
        "--repeat",
        "2",
        *prices,
    )
    assert spending == evaluate.outcome()["spending"]
    assert len(client.runs.list(agent="row").runs) == 2


def test_bad_answers_are_graded_and_bad_weather_is_waited_out(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    weather = [
        Reply("slow down", status=429, retry_after="1"),
        Reply("overloaded", status=503),
        Reply(body=b'{"choices": []}'),
        Reply(body=b"<html>"),
        Reply(delay_s=3.0),
    ]
    quality = iter(range(100))
    kinds: dict[str, int] = {}

    def answer(messages: Messages) -> Reply:
        if weather:
            return weather.pop()
        prompt = asked(messages)
        kind = kinds.setdefault(prompt, next(quality) % 6)
        good = answers[prompt]
        return [
            Reply(good),
            Reply("I'm sorry, but I can't help with building that.", finish_reason="stop"),
            Reply(None, refusal="I cannot do this.", finish_reason="content_filter"),
            Reply(good[: len(good) // 2], finish_reason="length"),
            Reply("```js\nthrow new Error('unlucky');\n```"),
            Reply(None, usage=None),
        ][kind]

    done = evaluate(endpoint(answer), "--suite", "mineceraft-lite", "--agent", "weather", "--request-timeout", "2")
    run = client.runs.get(evaluate.outcome()["runs"][0])
    assert run.state == "finished"
    assert (run.graded, run.skipped, run.grader_errors) == (25, 0, 0)
    assert run.summary is not None
    assert 0 < len(run.summary.passed_runs.overall) < 25
    # Where the endpoint told no tokens, neither tokens nor cost are known.
    assert evaluate.outcome()["spending"]["input_tokens"] is None
    assert "tokens: unknown; cost: unknown" in done.stdout
    reasons = {entry["completion"]["finish_reason"] for entry in evaluate.journal("completion")}
    assert reasons == {"stop", "content_filter", "length"}


def test_an_evaluation_that_is_killed_goes_on_and_pays_for_nothing_twice(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    model = endpoint(lambda messages: Reply(answers[asked(messages)], delay_s=0.15))
    arguments = ["--suite", "mineceraft-lite", "--agent", "killed", "--concurrency", "2"]
    for _ in range(3):
        before = len(model.seen)
        process = subprocess.Popen(
            evaluate.command(model, *arguments),
            env={**os.environ},
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        while len(model.seen) < before + 6:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        # As if the machine had lost power in the middle of a line.
        with (evaluate.folder / "journal.jsonl").open("ab") as file:
            file.write(b'{"attempt": "1/wal')
    evaluate(model, *arguments)
    runs = client.runs.list(agent="killed").runs
    assert [(run.graded, run.state) for run in runs] == [(25, "finished")]
    prompts = sum(len(task.prompts) for task in client.tasks.all("mineceraft-lite"))
    assert len(evaluate.journal("completion")) == prompts
    # At most the answers that were under way when the process was killed. They may have been paid for.
    assert len(model.seen) <= prompts + 3 * 2
    spending = evaluate.outcome()["spending"]
    assert len(model.seen) <= spending["requests"] <= prompts + 3 * 2
    assert (spending["input_tokens"] is None) == (spending["requests"] > prompts)


def test_turn_by_turn_with_feedback_and_pictures(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    tasks = [task for task in client.tasks.all("mineceraft") if task.turns > 1][:2]
    good = {
        prompt: code_of(turn)
        for task in tasks
        for prompt, turn in zip(task.prompts, build(task.id)["turns"], strict=True)
    }

    def answer(messages: Messages) -> Reply:
        last = messages[-1]["content"]
        if str(last) in good:
            return Reply("Let me see.\n```js\nlog(bot, 'hello');\nawait nothing();\n```")
        text, image = last
        assert image["image_url"]["url"].startswith("data:image/png;base64,")
        if "nothing is not defined" in text["text"]:
            prompt = next(m["content"] for m in reversed(messages) if str(m["content"]) in good)
            return Reply(good[prompt])
        assert "Placed" in text["text"]
        return Reply("DONE")

    arguments = ["--suite", "mineceraft", "--agent", "episodes", "--mode", "episodes", "--pictures"]
    arguments += [part for task in tasks for part in ("--task", task.id)]
    done = evaluate(endpoint(answer), *arguments)
    # A run of single tasks stays open, so that nobody mistakes it for a whole one.
    assert "stays open" in done.stdout
    [run] = client.runs.list(agent="episodes").runs
    answered = client.runs.submissions(run.id).submissions
    assert [(client.submissions.wait(one.id).overall, run.state) for one in answered] == [(True, "open")] * 2
    # The card says how the model was asked, and with which prompt.
    card = httpx.get(f"{client.url}/v1/runs/{run.id}/card").json()["versions"][0]["card"]
    sent = json.loads(next(evaluate.folder.rglob("transcripts/**/*.json")).read_text())["messages"][0]["content"]
    assert "You have 4 answers a turn" in sent
    assert card["system_prompt"]["sha256"] == hashlib.sha256(sent.encode()).hexdigest()
    assert card["harness"]["name"] == "plumbline-client evaluate, episodes of 4 answers a turn and pictures"
    assert f"{client.url}/runs/{run.id}" in done.stdout


def test_answers_that_build_nothing_are_counted(evaluate: Evaluate, endpoint: Any) -> None:
    replies = iter(
        [
            Reply(None, finish_reason="tool_calls"),
            Reply("  "),
            Reply("```js\nawait skills.", finish_reason="length"),
            Reply(None, refusal="No."),
        ]
    )
    model = endpoint(lambda messages: next(replies))
    # A task has a number as well as an id.
    tasks = [part for number in (113, 114, 115, 116) for part in ("--task", str(number))]
    done = evaluate(model, "--suite", "mineceraft", "--agent", "silent", "--concurrency", "1", *tasks)
    assert "of 4 answers: 1 refused, 1 with calls of tools, 1 cut off, 1 empty" in done.stdout
    assert evaluate.outcome()["answers"] == {
        "answers": 4,
        "refused": 1,
        "tool_calls": 1,
        "cut_off": 1,
        "empty": 1,
        "code_stopped": 0,
        "code_failed": 2,
        "code_idle": 2,
    }


def test_a_task_that_does_not_exist_and_a_service_that_is_away_are_told(evaluate: Evaluate, endpoint: Any) -> None:
    model = endpoint(lambda messages: Reply("DONE"))
    done = evaluate(model, "--suite", "mineceraft", "--agent", "none", "--task", "walls/5x1x5-rais", code=1)
    assert "has no task walls/5x1x5-rais; did you mean walls/5x1x5-raise?" in done.stderr
    command = evaluate.command(model, "--suite", "mineceraft", "--agent", "away")
    command[command.index("--server") + 1] = "http://127.0.0.1:9"
    away = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=without_settings())
    assert away.stderr is not None
    said = ""
    try:
        while "trying again for up to two minutes" not in said:
            line = away.stderr.readline()
            assert line, said
            said += line
    finally:
        away.kill()
        away.wait()


def test_the_budget_is_kept_and_can_be_raised(evaluate: Evaluate, endpoint: Any, answers: dict[str, str]) -> None:
    model = endpoint(lambda messages: Reply(answers[asked(messages)]))
    arguments = ["--suite", "mineceraft-lite", "--agent", "budget", "--concurrency", "1"]
    done = evaluate(model, *arguments, "--max-total-tokens", "1100", code=3)
    assert len(model.seen) == 10
    assert "stopped: 1100 tokens were used; the budget is 1100" in done.stderr
    assert model.seen[-1]["messages"]
    evaluate(model, *arguments[:-1], "8", "--max-requests", "12", code=3)
    assert len(model.seen) == 12
    evaluate(model, *arguments)


def test_an_endpoint_that_refuses_ends_the_evaluation_at_once(
    evaluate: Evaluate, endpoint: Any, client: Client, answers: dict[str, str]
) -> None:
    model = endpoint(lambda messages: Reply("Incorrect API key provided", status=401))
    done = evaluate(model, "--suite", "mineceraft-lite", "--agent", "refused", code=3)
    assert "Incorrect API key" in done.stderr
    assert len(model.seen) <= 8
    assert client.runs.list(agent="refused").runs[0].state == "open"


def test_a_task_that_the_endpoint_does_not_take_is_told_and_can_be_skipped(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    bad = next(iter(answers))

    def answer(messages: Messages) -> Reply:
        if asked(messages) == bad:
            return Reply("this model's maximum context length is 12 tokens", status=400)
        if any("max_tokens" in request for request in model.seen if request["messages"] is messages):
            return Reply("Unsupported parameter: use 'max_completion_tokens' instead", status=400)
        return Reply(answers[asked(messages)])

    model = endpoint(answer)
    arguments = ["--suite", "mineceraft-lite", "--agent", "skipped", "--max-tokens", "9000"]
    done = evaluate(model, *arguments, code=3)
    assert "maximum context length" in done.stderr
    evaluate(model, *arguments, "--skip-failed")
    run = client.runs.list(agent="skipped").runs[0]
    assert (run.state, run.graded, run.skipped) == ("finished", 24, 1)


def test_code_without_an_end_is_graded_as_an_empty_turn(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    endless = ["```js\nwhile (true) {}\n```", "x" * 600_000]

    def answer(messages: Messages) -> Reply:
        return Reply(endless.pop() if endless else answers[asked(messages)])

    done = evaluate(endpoint(answer), "--suite", "mineceraft-lite", "--agent", "endless")
    assert "turns whose answers reached a limit and count as empty: 2" in done.stdout
    [run] = client.runs.list(agent="endless").runs
    assert (run.state, run.graded) == ("finished", 25)
    refused = [entry["result"]["refused"] for entry in evaluate.journal("submitted") if "refused" in entry["result"]]
    assert len(refused) == 2
    assert any("limit" in reason for [reason] in refused)


def test_one_odd_answer_costs_the_others_nothing_and_no_key_is_kept(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str], client: Client
) -> None:
    odd = [
        Reply(
            body=rb'{"choices": [{"message": {"content": "half a pair \ud800 of surrogates"}}], "usage": {"prompt_tokens": "x"}}'
        ),
        Reply(body=b'{"choices": [{"message": "a text"}]}'),
        Reply(body=b'{"choices": [{"message": {"content": [{"text": {}}]}}], "usage": {"prompt_tokens_details": []}}'),
        Reply("the key sk-test is over its rate", status=429),
    ]
    evaluate(
        endpoint(lambda messages: odd.pop() if odd else Reply(answers[asked(messages)])),
        "--suite",
        "mineceraft-lite",
        "--agent",
        "odd",
    )
    [run] = client.runs.list(agent="odd").runs
    assert (run.state, run.graded) == ("finished", 25)
    assert run.card is not None
    assert run.card.model is not None
    assert run.card.model.name == "canned"
    assert evaluate.outcome()["spending"]["input_tokens"] is None
    assert run.card.tokens is None or run.card.tokens.input is None
    kept = "".join(path.read_text() for path in evaluate.folder.rglob("*") if path.is_file())
    assert "sk-test" not in kept


def test_requests_without_an_answer_are_counted(evaluate: Evaluate, endpoint: Any, answers: dict[str, str]) -> None:
    model = endpoint(lambda messages: Reply(body=b'{"choices": []}'))
    prices = ["--price-input", "2", "--price-output", "10", "--prices-as-of", "2026-11-01"]
    done = evaluate(model, "--suite", "mineceraft-lite", "--concurrency", "1", "--max-requests", "3", *prices, code=3)
    spending = evaluate.outcome()["spending"]
    assert (spending["requests"], spending["cost"], spending["input_tokens"]) == (3, None, None)
    assert "cost: unknown" in done.stdout


def test_a_request_that_broke_counts_as_the_largest_in_a_budget(
    evaluate: Evaluate, endpoint: Any, answers: dict[str, str]
) -> None:
    broken = [3, 5]

    def answer(messages: Messages) -> Reply:
        is_broken = len(model.seen) in broken
        return Reply("bad gateway", status=502) if is_broken else Reply(answers[asked(messages)])

    model = endpoint(answer)
    arguments = ["--suite", "mineceraft-lite", "--agent", "broken", "--concurrency", "1"]
    # 110 tokens each.
    done = evaluate(model, *arguments, "--max-total-tokens", "1100", code=3)
    assert "1100 tokens were used (requests without an answer counted as the largest: 2)" in done.stderr
    assert (len(model.seen), evaluate.outcome()["spending"]["input_tokens"]) == (10, None)
    evaluate(model, *arguments)


@pytest.mark.parametrize(("status", "tokens"), [(500, None), (429, 0)])
def test_each_try_is_a_request_of_the_budget(
    evaluate: Evaluate, endpoint: Any, status: int, tokens: int | None
) -> None:
    model = endpoint(lambda messages: Reply("not now", status=status, retry_after="0"))
    done = evaluate(model, "--suite", "mineceraft-lite", "--concurrency", "2", "--max-requests", "3", code=3)
    spending = evaluate.outcome()["spending"]
    assert (len(model.seen), spending["requests"], spending["input_tokens"]) == (3, 3, tokens)
    assert "the budget of 3 requests is used up" in done.stderr
    assert "problems without an answer: 25 of 25" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--epoch", "e", "--task", "x"], "leave those options out"),
        (["--tier", "official"], "name its --epoch"),
        (["--steps", "2"], "--mode episodes"),
        (["--mode", "episodes", "--profile", "published"], "rules of mindcraft"),
        (["--extra", '{"model": "other"}'], "use the option for it"),
        (["--model-key-env", "NOBODY_SET_THIS"], "NOBODY_SET_THIS is empty; set it"),
        (["--suite", "none"], "none"),
        (["--folder", "/proc/none"], "cannot be written"),
        (["--base-url", "127.0.0.1:9/v1"], "begins with http"),
    ],
)
def test_what_would_not_do_what_it_says_is_refused_at_once(
    evaluate: Evaluate, endpoint: Any, arguments: list[str], told: str
) -> None:
    model = endpoint(lambda messages: Reply("x"))
    done = evaluate(model, *arguments, code=1)
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert model.seen == []


def test_another_plan_in_the_same_folder_is_refused(evaluate: Evaluate, endpoint: Any, answers: dict[str, str]) -> None:
    model = endpoint(lambda messages: Reply("", status=401))
    evaluate(model, "--suite", "mineceraft-lite", code=3)
    done = evaluate(model, "--suite", "mineceraft-lite", "--temperature", "1", code=1)
    assert "differs in sampling" in done.stderr


@pytest.mark.parametrize("mode", ["one-shot", "episodes"])
def test_hidden_instances_are_answered_with_the_hash_of_the_transcript(
    tmp_path: Path, endpoint: Any, mode: str
) -> None:
    running = Running(tmp_path, "--open")
    try:
        running.run("epochs", "create", "e1", "--closes", "2099-01-01")
        model = endpoint(
            lambda messages: Reply("DONE" if "Placed" in asked(messages) else "bot.chat('/setblock 0 0 3 stone');")
        )
        evaluate = Evaluate(running, tmp_path / "evaluation")
        done = evaluate(model, "--epoch", "e1", "--agent", "hidden", "--mode", mode)
        assert "is finalized" in done.stdout
        entry = Client(running.url).entries.get(evaluate.outcome()["entry"])
        assert entry.answered == entry.issued > 0
        instance = next(path.stem for path in (evaluate.folder / "transcripts").rglob("*.json"))
        shown = Client(running.url).instances.get(instance)
        transcript = (evaluate.folder / "transcripts/1" / f"{instance}.json").read_bytes()
        assert shown.transcript_sha256 is not None
        assert shown.transcript_sha256 == hashlib.sha256(transcript).hexdigest()
        told = verified_afterwards(running, "e1", evaluate.folder / "journal.jsonl", entry.issued)
        assert f"{entry.issued} of {entry.issued} draws" in told
    finally:
        running.stop()
