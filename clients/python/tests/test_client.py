"""The clients against a real service: the way of a lab, errors, retries, streams and batches."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sqlite3
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from conftest import WALL, Running

from plumbline_client import AsyncClient, Client, Coalescer, Retries, errors, models
from plumbline_client.batches import Batch
from plumbline_client.events import EventReader, Lines, Reopening

UGLY = (
    "<think>Should it be dirt?\tNo — 石.</think>\nSure! Here's the wall:\n\n```javascript\n"
    "(async (bot) => {\n\tfor (let x = -2; x <= 2; x++) {\n\t\tfor (let y = 0; y < 5; y++) {\n"
    "\t\t\tawait skills.placeBlock(bot, 'stone', x, y, 3); // строка\n\t\t}\n\t}\n})\n```\nHope that helps 🧱\n"
)


def test_a_lab_goes_the_whole_way(client: Client, wall: dict[str, Any]) -> None:
    run = client.runs.create(agent="way of a lab", suite="mineceraft-lite", metadata={"temperature": 0.7})
    task = next(task for task in client.tasks.all("mineceraft-lite") if task.family == "walls")
    assert client.tasks.get(task.id, suite="mineceraft-lite").turns
    accepted = client.submissions.create(
        run=run.id, task=task.id, profile="mindcraft", turns=[{"action_code": UGLY}] * task.turns
    )
    settled = client.submissions.wait(accepted.id)
    assert settled.state == "graded"
    report = client.submissions.report(accepted.id)
    assert report.turns[0].checks
    assert client.submissions.log(accepted.id).palette == ["stone"]
    client.runs.finish(run.id, skip="unanswered")
    assert client.runs.wait(run.id).state == "finished"
    board = client.boards.get("mineceraft-lite")
    assert "way of a lab" in [row.agent for row in board.rows]
    assert "way of a lab" in client.boards.get_as("mineceraft-lite", format="csv")
    events = list(client.events.follow(run=run.id))
    assert events[-1].state == "finished" and {event.submission for event in events} >= {accepted.id}


def test_events_are_followed_over_a_restart(tmp_path: Path, wall: dict[str, Any]) -> None:
    # Nothing grades, so the submission waits while the service stops.
    before = Running(tmp_path, "--open", "--workers", "0")
    address = before.url.removeprefix("http://")
    with Client(before.url) as client:
        accepted = client.submissions.create(task=WALL, turns=wall["turns"])
        states: list[str] = []
        follower = threading.Thread(
            target=lambda: states.extend(event.state for event in client.events.follow(submission=accepted.id))
        )
        follower.start()
        time.sleep(1)
        before.stop()
        after = Running(tmp_path, "--open", "--listen", address)
        follower.join(120)
        after.stop()
    assert states == ["graded"] and not follower.is_alive()


def test_a_stream_that_brings_nothing_is_opened_again_with_patience() -> None:
    opened: list[float] = []

    class Empty(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            opened.append(time.monotonic())
            self.send_response(200)
            self.send_header("content-type", "text/event-stream")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Empty)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    retries = Retries(first_s=0.2, longest_s=10)

    def follow() -> None:
        with Client(f"http://127.0.0.1:{server.server_port}", retries=retries) as client:
            next(client.events.follow())

    threading.Thread(target=follow, daemon=True).start()
    time.sleep(2)
    server.shutdown()
    assert 2 <= len(opened) <= 20


def test_a_stream_may_be_quiet_for_longer_than_calls_are_repeated() -> None:
    reopening = Reopening(Retries(first_s=0.01, longest_s=0.05, deadline_s=0.1), EventReader(None))
    for _ in range(2):
        reopening.opens()
        reopening.hears()
        time.sleep(0.2)
        assert reopening.delay(errors.NotReached("it broke off")) <= 0.05
    # A service that is away is not asked forever, also where each attempt takes its time to fail.
    for takes_s in (0.0, 0.1):
        with pytest.raises(errors.NotReached):
            for _ in range(30):
                reopening.opens()
                time.sleep(takes_s)
                time.sleep(reopening.delay(errors.NotReached("nobody listens")))


def test_a_model_of_the_package_can_be_sent_back(client: Client, wall: dict[str, Any]) -> None:
    accepted = client.submissions.create(task=WALL, turns=wall["turns"])
    client.submissions.wait(accepted.id)
    stored = client.submissions.log(accepted.id)
    assert client.rewards.grade(task=WALL, log=stored, reward="shaped").reward == 1.0
    assert client.submissions.structure(accepted.id, format="schem")[:2] == b"\x1f\x8b"


def test_half_a_character_spoils_no_batch(client: Client, wall: dict[str, Any]) -> None:
    answer = json.dumps({"turns": wall["turns"]})
    items = [{"task": WALL, "answer": answer + end} for end in ("", "\nDone \ud83d")]
    assert [result.reward for result in client.rewards.many(items)] == [1.0, 1.0]
    with pytest.raises(errors.Unwritable):
        client.rewards.grade(task=WALL, answer="\ud83d", reward={"weights": object()})


def test_faults_are_told_with_their_places(client: Client) -> None:
    with pytest.raises(errors.Faulty) as caught:
        client.rewards.grade(
            task=WALL, turns=[{"events": [{"action": "place", "x": 0.5, "y": 0, "z": 0, "material": "stone"}]}]
        )
    assert caught.value.kind == "invalid-body"
    assert caught.value.faults[0].pointer == "/turns/0/events/0/x"
    assert "/turns/0/events/0/x" in str(caught.value)
    with pytest.raises(errors.NotFound):
        client.tasks.get("walls/none")


def test_an_episode_turn_by_turn(client: Client) -> None:
    episode = client.episodes.open(task=WALL)
    view = {"from": [-3, 0, 3], "to": [3, 5, 3]}
    done = client.episodes.step(episode.id, action_code=UGLY, step=1, view=view)
    assert len(done.events) == 25
    assert client.episodes.step(episode.id, action_code=UGLY, step=1, view=view) == done
    assert client.episodes.picture(episode.id).startswith(b"\x89PNG")
    assert client.submissions.wait(client.episodes.submit(episode.id).submission).state == "graded"


def test_many_logs_in_one_call(client: Client, wall: dict[str, Any]) -> None:
    good = {"task": WALL, "turns": wall["turns"]}
    requests = [good, {"task": "walls/none", "turns": []}, {"task": WALL, "answer": UGLY, "profile": "mindcraft"}] * 3
    results = client.rewards.many(requests)
    assert [result.index for result in results] == list(range(9))
    assert [result.reward is None for result in results] == [False, True, False] * 3
    assert results[0].reward == 1.0 and results[1].error is not None and results[1].error.faults
    assert client.rewards.many([]) == []


def test_a_result_may_hold_characters_at_which_python_splits_lines(client: Client) -> None:
    said = "a\u2028b\u2029c\u0085d"
    answer = f"```js\nawait skills.placeBlock(bot, 'stone', 0, 0, 0);\nthrow new Error('{said}');\n```"
    results = client.rewards.many([{"task": WALL, "answer": answer, "profile": "mindcraft"}] * 3)
    assert [result.status for result in results] == [200] * 3
    assert results[0].result is not None and said in results[0].result.model_dump_json()


async def test_concurrent_calls_go_as_batches(service: Running, wall: dict[str, Any]) -> None:
    async with AsyncClient(service.url) as client, Coalescer(client, most=64) as grader:
        good = [grader.reward(task=WALL, turns=wall["turns"]) for _ in range(150)]
        bad = [grader.grade(task="walls/none", turns=[])]
        results = await asyncio.gather(*good, *bad, return_exceptions=True)
        assert results[:150] == [1.0] * 150
        assert isinstance(results[150], errors.Faulty)
    metrics = Client(service.url).service.metrics()
    batches = [line for line in metrics.splitlines() if "grade:batch" in line and "count" in line]
    assert batches


async def test_the_asynchronous_client_goes_the_whole_way(service: Running, wall: dict[str, Any]) -> None:
    async with AsyncClient(service.url) as client:
        run = await client.runs.create(agent="asynchronous", suite="mineceraft")
        accepted = await client.submissions.create(run=run.id, task=WALL, turns=wall["turns"])
        assert (await client.submissions.wait(accepted.id)).overall
        await client.runs.finish(run.id, skip="unanswered")
        assert (await client.runs.wait(run.id)).graded == 1
        assert [event.state async for event in client.events.follow(run=run.id)] == ["graded", "finished"]
        assert len([task async for task in client.tasks.all("mineceraft-lite")]) == 25


class Flaky:
    """A server that fails in the ways of the given steps before it answers; what no real service does on demand."""

    def __init__(self, steps: list[str], body: bytes) -> None:
        self.seen: list[dict[str, str]] = []
        flaky = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                length = int(self.headers.get("content-length") or 0)
                self.rfile.read(length)
                flaky.seen.append({name.lower(): value for name, value in self.headers.items()})
                step = steps.pop(0) if steps else "ok"
                if step == "cut":
                    self.connection.close()
                    return
                status, kind = {
                    "ok": (200, ""),
                    "busy": (503, "busy"),
                    "many": (429, "too-many-requests"),
                    "in-flight": (409, "idempotency-in-flight"),
                    "proxy": (502, ""),
                    "late": (504, "deadline"),
                }[step]
                problem = f'{{"type":"urn:plumbline:problem:{kind}","title":"t","status":{status},"detail":"d","retryable":true}}'
                text = body if status == 200 else b"<html>Bad gateway" if step == "proxy" else problem.encode()
                self.send_response(status)
                self.send_header("content-length", str(len(text)))
                if step == "many":
                    self.send_header("retry-after", "1")
                self.end_headers()
                self.wfile.write(text)

            do_GET = do_DELETE = do_POST

            def log_message(self, *arguments: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"


RUN = (
    b'{"id":"0198c0de-0000-7000-8000-000000000000","agent":"a","suite":"mineceraft@4","state":"open","tasks":1,"pending":0,'
    b'"graded":0,"grader_errors":0,"skipped":0,"metadata":{},"created_at":"2026-01-01T00:00:00Z","provenance":"self-reported",'
    b'"track":"specified","new":"member of a newer service"}'
)


@pytest.fixture
def flaky() -> Iterator[Any]:
    made: list[Flaky] = []

    def make(*steps: str, body: bytes = RUN) -> Flaky:
        made.append(Flaky(list(steps), body))
        return made[-1]

    yield make
    for one in made:
        one.server.shutdown()


def test_one_call_has_one_key_however_often_it_is_sent(flaky: Any) -> None:
    server = flaky("cut", "busy", "proxy", "in-flight", "many")
    client = Client(server.url, "plk_x", retries=Retries(first_s=0.01))
    assert client.runs.create(agent="a", suite="mineceraft").agent == "a"
    keys = [request["idempotency-key"] for request in server.seen]
    assert len(keys) == 6 and len(set(keys)) == 1
    client.runs.create(agent="a", suite="mineceraft")
    assert server.seen[-1]["idempotency-key"] != keys[0]
    assert server.seen[-1]["authorization"] == "Bearer plk_x"


def test_the_address_is_that_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLUMBLINE", "grader:1/")
    assert Client().url == "http://grader:1"
    monkeypatch.setenv("PLUMBLINE_SERVER", "https://grader/v1")
    assert Client().url == "https://grader"
    assert Client("http://grader:3").url == "http://grader:3"


def test_what_may_not_happen_twice_is_not_sent_twice(flaky: Any) -> None:
    server = flaky("cut")
    client = Client(server.url, retries=Retries(first_s=0.01))
    with pytest.raises(errors.NotReached):
        client.runs.delete("0198c0de-0000-7000-8000-000000000000")
    assert len(server.seen) == 1
    # The service says that it did nothing.
    server = flaky("busy")
    assert Client(server.url, retries=Retries(first_s=0.01)).runs.delete("x").state == "open"


def test_work_that_takes_too_long_is_sent_once_more(flaky: Any) -> None:
    server = flaky("late", "late", "late")
    with Client(server.url) as client, pytest.raises(errors.ApiError, match="504"):
        client.rewards.grade(task=WALL, answer="while (true) {}", deadline_ms=100)
    assert len(server.seen) == 2


def test_retries_end_at_the_deadline_and_the_last_failure_is_told(flaky: Any) -> None:
    server = flaky(*["many"] * 50)
    client = Client(server.url, retries=Retries(deadline_s=0.5))
    with pytest.raises(errors.TooMany) as caught:
        client.runs.get("x")
    assert caught.value.retry_after_s == 1.0 and len(server.seen) == 1
    with pytest.raises(errors.NotReached):
        Client("http://127.0.0.1:1", retries=Retries(deadline_s=0.2, first_s=0.01)).service.health()


def test_a_batch_that_cannot_be_sent_has_no_rewards_and_loses_no_log(flaky: Any) -> None:
    server = flaky(*["busy"] * 50)
    client = Client(server.url, retries=Retries(most=2, first_s=0.01))
    results = client.rewards.many([{"task": WALL, "turns": []}] * 3)
    assert [result.reward for result in results] == [None] * 3
    assert all(result.error is not None and result.error.retryable for result in results)


def test_a_log_that_always_fails_is_told_with_its_reason() -> None:
    batch = Batch([{"task": WALL, "turns": []}])
    batch.body()
    problem = '{"type":"urn:plumbline:problem:internal","title":"t","status":500,"detail":"its own","retryable":true}'
    assert batch.take(f'{{"index":0,"status":500,"reward":null,"error":{problem}}}'.encode()) is None
    assert [left["error"]["detail"] for left in batch.give_up(errors.PlumblineError("busy"))] == ["its own"]
    with pytest.raises(errors.UnreadableAnswer):
        batch.take(b'{"index":')


def test_lines_end_at_line_feeds_wherever_chunks_end() -> None:
    text = "a\u2028b\r\n\nc\x0bd\n\ne".encode()
    for size in range(1, len(text) + 1):
        lines = Lines()
        taken = [line for at in range(0, len(text), size) for line in lines.take(text[at : at + size])]
        assert [*taken, *lines.rest()] == ["a\u2028b".encode(), b"", b"c\x0bd", b"", b"e"], size


def test_the_answer_of_a_newer_service_is_read(flaky: Any) -> None:
    assert isinstance(Client(flaky().url).runs.get("x"), models.RunBody)
    with pytest.raises(errors.UnreadableAnswer):
        Client(flaky(body=b"<html>a captive portal</html>").url).runs.get("x")


def test_a_run_whose_grading_failed_is_told_and_not_waited_for(tmp_path: Path, wall: dict[str, Any]) -> None:
    idle = Running(tmp_path, "--open", "--workers", "0")
    with Client(idle.url) as client:
        run = client.runs.create(agent="unlucky", suite="mineceraft")
        client.submissions.create(run=run.id, task=WALL, turns=wall["turns"])
        client.runs.finish(run.id, skip="unanswered")
    idle.stop()
    with contextlib.closing(sqlite3.connect(idle.database)) as rows, rows:
        rows.execute("UPDATE submissions SET log = x'00'")
    again = Running(tmp_path, "--open")

    async def waits() -> None:
        async with AsyncClient(again.url) as client:
            await client.runs.wait(run.id)

    try:
        with Client(again.url) as client, pytest.raises(errors.GradingFailed, match=r"failed to grade 1 submission of"):
            client.runs.wait(run.id)
        with pytest.raises(errors.GradingFailed):
            asyncio.run(waits())
        # Its owner may give the task up by naming it.
        with Client(again.url) as client:
            client.runs.finish(run.id, skip=[WALL])
            assert client.runs.wait(run.id).state == "finished"
    finally:
        again.stop()
