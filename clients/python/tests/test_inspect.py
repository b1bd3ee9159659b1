"""The tasks for Inspect, run by the real package against a real service."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest
from conftest import Running, build, verified_afterwards, without_settings
from endpoint import code_of

from plumbline_client import Client

pytest.importorskip("inspect_ai")

from inspect_ai import eval as inspect_eval
from inspect_ai import eval_retry
from inspect_ai._util.error import PrerequisiteError
from inspect_ai.log import EvalLog, read_eval_log
from inspect_ai.model import ModelOutput, ModelUsage, get_model

from plumbline_client.inspect_plugin.tasks import mineceraft_lite

BIN = Path(sys.executable).parent


@pytest.fixture
def inspect(service: Running, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("PLUMBLINE_SERVER", service.url)
    return tmp_path / "logs"


@pytest.fixture(scope="session")
def texts(lite: None) -> dict[str, str]:
    """A good answer to each prompt of the small suite but the walls', which are left half done."""
    found = {}
    for task in LITE:
        good = build(task["id"])
        for prompt, turn in zip(task["prompts"], good["turns"], strict=True):
            if task["id"].startswith("walls/"):
                turn = {**turn, "rows": turn["rows"][: len(turn["rows"]) // 2]}
            found[prompt] = code_of(turn)
    return found


LITE: list[dict[str, Any]] = []


@pytest.fixture(autouse=True, scope="session")
def lite(service: Running) -> None:
    with Client(service.url) as client:
        LITE.extend(one.model_dump() for one in client.tasks.all("mineceraft-lite"))


def answering(texts: dict[str, str]) -> Any:
    def answer(messages: list[Any], tools: Any, choice: Any, config: Any) -> ModelOutput:
        output = ModelOutput.from_content("mockllm/model", texts[messages[-1].text])
        # Otherwise the mock counts tokens with a vocabulary from the network.
        output.usage = ModelUsage(input_tokens=5, output_tokens=7, total_tokens=12)
        return output

    return get_model("mockllm/model", custom_outputs=answer)


def metrics(log: EvalLog) -> dict[str, dict[str, float]]:
    assert log.results is not None
    return {score.name: {name: one.value for name, one in score.metrics.items()} for score in log.results.scores}


def test_the_numbers_are_those_of_the_board(inspect: Path, texts: dict[str, str], client: Client) -> None:
    arguments = {"board": "inspected"}
    [log] = inspect_eval(
        "plumbline_client/mineceraft_lite",
        model=answering(texts),
        task_args=arguments,
        log_dir=str(inspect),
        display="none",
    )
    assert log.status == "success", log.error
    [run] = client.runs.list(agent="inspected").runs
    run = client.runs.wait(run.id)
    assert run.summary is not None
    found = metrics(log)
    level = run.summary.problem_level
    assert level.overall.rate == found["passes"]["mean"]
    assert 0.5 < found["passes"]["mean"] < 1.0
    for name in ("material", "shape", "size", "physical_plausibility", "efficiency"):
        assert getattr(level, name).rate == pytest.approx(found[name]["mean"]), name
    assert found["passes"]["family/walls"] == 0.0
    assert found["passes"]["category/civil-engineering"] == 1.0
    assert log.samples is not None
    walls = next(one for one in log.samples if str(one.id).startswith("walls/"))
    assert walls.scores is not None
    explanation = walls.scores["passes"].explanation or ""
    page = explanation.split("](", 1)[1].split(")", 1)[0]
    assert httpx.get(page, headers={"accept": "text/html"}).status_code == 200
    assert "scores 0" in explanation


def test_without_a_key_that_submits_no_model_is_asked(
    tmp_path: Path, texts: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    keyed = Running(tmp_path)
    try:
        monkeypatch.setenv("PLUMBLINE_SERVER", keyed.url)
        reads = keyed.run("keys", "create", "--name", "lab", "--scopes", "grade").strip()
        for key, what, has_asked in [("", "401", False), ("plk_abc_wrong", "401", False), (reads, "403", True)]:
            monkeypatch.setenv("PLUMBLINE_KEY", key)
            [log] = inspect_eval(
                "plumbline_client/mineceraft_lite",
                model=answering(texts),
                log_dir=str(tmp_path / "logs"),
                display="none",
            )
            assert log.status == "error" and log.error is not None and what in log.error.message, log.error
            assert bool(log.stats.model_usage) == has_asked
    finally:
        keyed.stop()


def test_an_evaluation_that_is_tried_again_goes_on_with_its_run(
    inspect: Path, texts: dict[str, str], client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The second time the mock has its own answers, and would count their tokens with a vocabulary from the network.
    monkeypatch.setattr("inspect_ai.model._model.count_text_tokens", lambda text: len(text))
    asked = iter(range(1000))

    def answer(messages: list[Any], tools: Any, choice: Any, config: Any) -> ModelOutput:
        if next(asked) == 6:
            raise RuntimeError("the endpoint broke")
        # A model without an end is scored 0 like any that fails, on the board and here.
        text = "while (true) {}" if messages[-1].text == LITE[0]["prompts"][0] else texts[messages[-1].text]
        return always(text)(messages, tools, choice, config)  # type: ignore[no-any-return]

    model = get_model("mockllm/model", custom_outputs=answer)
    [failed] = inspect_eval(
        "plumbline_client/mineceraft_lite",
        model=model,
        task_args={"board": "retried"},
        log_dir=str(inspect),
        display="none",
    )
    assert failed.status == "error"
    [log] = eval_retry(failed, log_dir=str(inspect), display="none")
    assert log.status == "success", log.error
    [run] = client.runs.list(agent="retried").runs
    run = client.runs.wait(run.id)
    assert (run.state, run.graded) == ("finished", 25)
    assert run.summary is not None
    assert run.summary.problem_level.overall.rate == metrics(log)["passes"]["mean"]
    assert log.results is not None
    assert log.results.scores[0].unscored_samples == 0


def test_a_service_that_is_gone_scores_nothing(inspect: Path, texts: dict[str, str], tmp_path: Path) -> None:
    running = Running(tmp_path, "--open")
    try:
        os.environ["PLUMBLINE_SERVER"] = running.url

        def leaving(messages: list[Any], tools: Any, choice: Any, config: Any) -> ModelOutput:
            running.process.kill()
            os.environ["PLUMBLINE_SERVER"] = "http://127.0.0.1:1"
            return always("nothing")(messages, tools, choice, config)  # type: ignore[no-any-return]

        model = get_model("mockllm/model", custom_outputs=leaving)
        from plumbline_client.inspect_plugin import scorers

        real = scorers.AsyncClient
        from plumbline_client import Retries

        scorers.AsyncClient = lambda: real(retries=Retries(most=1, first_s=0.01))  # type: ignore[assignment,misc]
        try:
            [log] = inspect_eval(
                "plumbline_client/mineceraft_lite", model=model, limit=2, log_dir=str(inspect), display="none"
            )
        finally:
            scorers.AsyncClient = real  # type: ignore[misc]
    finally:
        running.stop()
    assert log.status == "success", log.error
    assert log.results is not None
    passes = log.results.scores[0]
    assert (passes.scored_samples, passes.unscored_samples) == (0, 2)


def test_tools_act_in_an_episode(inspect: Path, client: Client) -> None:
    task = next(one for one in client.tasks.all("mineceraft") if one.turns == 2)
    codes = dict(zip(task.prompts, [code_of(turn) for turn in build(task.id)["turns"]], strict=True))
    calls = [("look", {"from_position": "-2,0,-2", "to_position": "2,2,2"}), ("picture", {})]

    def answer(messages: list[Any], tools: Any, choice: Any, config: Any) -> ModelOutput:
        last = messages[-1]
        if last.role == "user" and last.text in codes:
            output = ModelOutput.for_tool_call("mockllm/model", "act", {"code": codes[last.text]})
        elif last.role == "user":
            # An image comes to the model as a message of its own.
            output = ModelOutput.from_content("mockllm/model", "Done with picture.")
        elif last.function == "act" and "Placed" in last.text:
            output = ModelOutput.for_tool_call("mockllm/model", *calls[0])
        elif last.function == "look" and last.error is None:
            output = ModelOutput.for_tool_call("mockllm/model", *calls[1])
        else:
            output = ModelOutput.from_content("mockllm/model", f"Done with {last.function}.")
        output.usage = ModelUsage(input_tokens=5, output_tokens=7, total_tokens=12)
        return output

    model = get_model("mockllm/model", custom_outputs=answer)
    [log] = inspect_eval(
        "plumbline_client/mineceraft",
        model=model,
        task_args={"mode": "episodes"},
        sample_id=task.id,
        log_dir=str(inspect),
        display="none",
    )
    assert log.status == "success", log.error
    assert log.samples is not None
    messages = [(message.role, message.text) for message in log.samples[0].messages]
    assert metrics(log)["passes"]["mean"] == 1.0, messages
    assert sum("Done with picture" in text for _, text in messages) == 2


def test_the_command_leaves_a_log_that_the_viewer_opens(inspect: Path, service: Running, tmp_path: Path) -> None:
    # The mock model would download a vocabulary to count its tokens.
    stub = tmp_path / "stub/tiktoken"
    stub.mkdir(parents=True)
    counting = "class Words:\n    def encode(self, text, **_):\n        return text.split()\n"
    (stub / "__init__.py").write_text(f"{counting}\ndef get_encoding(name):\n    return Words()\n")
    environment = {**without_settings(), "PLUMBLINE_SERVER": service.url, "PYTHONPATH": str(stub.parent)}
    environment["XDG_DATA_HOME"] = str(tmp_path / "data")
    command = [str(BIN / "inspect"), "eval", "plumbline_client/mineceraft_lite", "--model", "mockllm/model"]
    command += ["--limit", "2", "--display", "none", "--log-dir", str(inspect)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment, cwd=tmp_path)
    [path] = inspect.glob("*.eval")
    log = read_eval_log(str(path))
    assert log.status == "success", (log.error, done.stderr)
    assert metrics(log)["passes"]["mean"] == 0.0
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    view = [str(BIN / "inspect"), "view", "start", "--log-dir", str(inspect), "--port", str(port)]
    viewer = subprocess.Popen(view, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        shown = opened(f"http://127.0.0.1:{port}")
    finally:
        viewer.terminate()
        viewer.wait(20)
    assert shown["eval"]["task"] == "plumbline_client/mineceraft_lite"
    assert shown["status"] == "success"


def opened(url: str) -> dict[str, Any]:
    for _ in range(300):
        try:
            files = httpx.get(f"{url}/api/logs").json()["files"]
            break
        except httpx.TransportError:
            time.sleep(0.1)
    else:
        raise AssertionError("the viewer did not start")
    shown: dict[str, Any] = json.loads(httpx.get(f"{url}/api/logs/{quote(files[0]['name'], safe='')}").text)
    return shown


def test_a_mode_that_does_not_exist_is_refused(inspect: Path) -> None:
    with pytest.raises(PrerequisiteError, match="did you mean episodes"):
        mineceraft_lite(mode="episode")  # type: ignore[arg-type]


def test_a_hidden_evaluation_is_answered_and_finalized(inspect: Path, tmp_path: Path) -> None:
    running = Running(tmp_path, "--open")
    try:
        running.run("epochs", "create", "e1", "--closes", "2099-01-01")
        os.environ["PLUMBLINE_SERVER"] = running.url
        model = get_model("mockllm/model", custom_outputs=always("bot.chat('/setblock 0 0 3 stone');"))
        [log] = inspect_eval(
            "plumbline_client/mineceraft_hidden",
            model=model,
            task_args={"epoch": "e1", "agent": "hidden"},
            log_dir=str(inspect),
            display="none",
        )
        assert log.status == "success", log.error
        assert log.eval.metadata is not None
        entry = Client(running.url).entries.get(log.eval.metadata["entry"])
        assert entry.answered == entry.issued
        assert entry.state in ("finalized", "complete")
        assert log.results is not None
        assert log.results.scores[0].unscored_samples == entry.issued
        assert log.samples is not None
        answered = [score.metadata for sample in log.samples for score in (sample.scores or {}).values()]
        kept = tmp_path / "kept.json"
        kept.write_text(json.dumps([log.eval.metadata, answered]))
        verified_afterwards(running, "e1", kept, entry.issued)
    finally:
        running.stop()


def always(text: str) -> Any:
    def answer(messages: list[Any], tools: Any, choice: Any, config: Any) -> ModelOutput:
        output = ModelOutput.from_content("mockllm/model", text)
        output.usage = ModelUsage(input_tokens=5, output_tokens=7, total_tokens=12)
        return output

    return answer
