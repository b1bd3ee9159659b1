"""Rewards for trainers: the functions as the frameworks call them, and the frameworks themselves where they install."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import math
from pathlib import Path
from typing import Any

import datasets
import httpx
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from conftest import WALL, Running, build
from endpoint import Endpoint, Reply, code_of

from plumbline_client import Client, Retries, errors
from plumbline_client.trainers import labels, trl, verl


@pytest.fixture
def good() -> str:
    return code_of(build(WALL)["turns"][0])


@pytest.fixture(autouse=True)
def at_service(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLUMBLINE_SERVER", service.url)


def rows(service: Running, form: str, **query: str) -> list[dict[str, Any]]:
    answer = httpx.get(f"{service.url}/v1/tasks", params={"suite": "mineceraft-lite", "format": form, **query})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/x-ndjson"
    return [json.loads(line) for line in answer.text.splitlines()]


def batch(service: Running, good: str) -> dict[str, Any]:
    """What TRL passes: a column is a list, and what a row lacks is null."""
    row = next(row for row in rows(service, "trl", scheme="mean") if row["task"].startswith("walls/"))
    good = code_of(build(row["task"])["turns"][0])
    said = ["I can't do that.", good, None, [{"type": "text", "text": good}]]
    completions = [[{"role": "assistant", "content": text}] for text in said]
    columns = {name: [value] * 4 for name, value in row.items() if name != "prompt"}
    return {
        "prompts": [row["prompt"]] * 4,
        "completions": completions,
        "completion_ids": [[1]] * 4,
        **columns,
        "other": [None] * 4,
    }


async def test_trl_gets_rewards_of_conversations(service: Running, good: str) -> None:
    extra: dict[str, list[Any]] = {}
    metric: dict[str, float] = {}
    rewards = await trl.plumbline(
        **batch(service, good), trainer_state=None, log_extra=extra.__setitem__, log_metric=metric.__setitem__
    )
    assert [reward == 1.0 for reward in rewards] == [False, True, False, True]
    assert extra["plumbline/overall"] == [0.0, 1.0, 0.0, 1.0]
    assert metric == {"plumbline/failed": 0.0}
    # The asynchronous trainer passes no extras, and a plain data set has plain texts.
    plain = await trl.plumbline(prompts=["x"], completions=[good], task=[WALL], profile=["mindcraft"])
    assert plain == [1.0]
    # A draft in a thought that never ends is no answer, also where the prompt opened the thought.
    for prompt in ("Raise a wall.\n<think>\n", [{"role": "assistant", "content": "[THINK]"}]):
        draft = await trl.plumbline(prompts=[prompt], completions=[good], task=[WALL], profile=["mindcraft"])
        assert draft == [0.0], prompt
        ended = await trl.plumbline([prompt], [f"Plan.</think>[/THINK]{good}"], [WALL], profile=["mindcraft"])
        assert ended == [1.0], prompt


async def test_trl_finds_the_scheme_under_its_other_names(service: Running) -> None:
    one = [{"action": "place", "material": "stone", "x": 0, "y": 0, "z": 0}]
    sent: dict[str, Any] = {"prompts": ["x"], "completions": [json.dumps({"events": one})], "task": [WALL]}
    assert await trl.plumbline(**sent) == [0.0]
    for name in ("scheme", "reward", "reward_scheme"):
        [reward] = await trl.plumbline(**sent, **{name: ["mean"]})
        assert reward, name
    # A column of rewards is the data set's own.
    assert await trl.plumbline(**sent, reward=[0.5]) == [0.0]
    with pytest.raises(ValueError, match="did you mean reward"):
        await trl.plumbline(**sent, rewards=["shaped"])


async def test_trl_gets_none_where_the_service_failed_and_an_error_where_the_data_set_is_wrong(
    monkeypatch: pytest.MonkeyPatch, good: str, service: Running
) -> None:
    with pytest.raises(errors.Faulty):
        await trl.plumbline(prompts=["x"], completions=[good], task=["walls/none"])
    with pytest.raises(ValueError, match="names no task"):
        await trl.plumbline(prompts=["x"], completions=[good], task=[""])
    for wrong, meant in {"rewrad": "reward", "Reward": "reward", "profle": "profile", "suit": "suite"}.items():
        with pytest.raises(ValueError, match=f"did you mean {meant}"):
            labels.request({"task": WALL, wrong: "mean"}, [good])
    with pytest.raises(ValueError, match="two schemes, reward and scheme"):
        labels.request({"task": WALL, "reward": "mean", "scheme": "strict"}, ["no"])
    with pytest.raises(ValueError, match="did you mean reward"):
        labels.request({"task": WALL, "weights": {"material": 1}}, ["no"])
    with pytest.raises(ValueError, match="did you mean scheme"):
        await trl.plumbline(prompts=["x"], completions=[good], task=[WALL], schme=["mean"])
    others = dict.fromkeys(
        ["rewards", "reward_model", "reward_fn", "schema", "site", "profile_id", "data_source", "tasks"], 1
    )
    assert labels.request({"task": WALL, "reward": "mean", **others}, [good])["reward"] == "mean"
    monkeypatch.setenv("PLUMBLINE_SERVER", "http://127.0.0.1:1")
    monkeypatch.setenv("PLUMBLINE_DEADLINE_S", " 0.3 ")

    def elsewhere() -> list[float | None]:
        # Not asyncio.run: where Inspect has run before, it goes on with the loop that the thread had, and its client.
        with contextlib.closing(asyncio.new_event_loop()) as loop:
            return loop.run_until_complete(trl.plumbline(prompts=["x"] * 2, completions=[good] * 2, task=[WALL] * 2))

    assert await asyncio.to_thread(elsewhere) == [None, None]
    for wrong in ("soon", "-1", "nan"):
        monkeypatch.setenv("PLUMBLINE_DEADLINE_S", wrong)
        with pytest.raises(errors.PlumblineError, match=r"PLUMBLINE_DEADLINE_S is .* expected seconds"):
            await asyncio.to_thread(elsewhere)


async def test_tables_of_data_name_tasks_as_their_libraries_hold_them(service: Running, good: str) -> None:
    number = Client(service.url).tasks.get(WALL).number
    series = pd.Series([number, None])
    assert series.dtype == np.float64
    for task in (series[0], np.int64(number), str(number), f"{number}.0", pa.scalar(number), WALL, np.str_(WALL)):
        request = labels.request({"task": task, "reward": None, "suite": math.nan, "profile": pd.NA}, [good])
        assert request == {"task": WALL if str(task) == WALL else number, "answer": [good]}, task
    # Rows of the service's own lists have a number of turns.
    assert labels.request({"task": WALL, "turns": 1, "prompt": "A wall."}, [good]) == {"task": WALL, "answer": [good]}
    # Rows of another data set have no task; Arrow gives each row the members of all.
    wall = {"fn": "size.is_equal", "args": {"xz": [5, 1], "y": 5}}
    made = {"fn": "material.is_all_material_equal_to", "args": {"expected_material": "stone"}}
    table = datasets.Dataset.from_list(
        [
            {
                "task": {"turns": [{"prompt": "A wall.", "checks": [wall, made]}]},
                "scheme": {"weights": {"size": 1, "shape": None}},
            },
            {"task": None, "scheme": {"weights": {"size": None, "shape": 1}}},
            {"task": {"turns": [{"prompt": "Stone.", "checks": [made]}]}, "scheme": None},
        ]
    )
    assert "xz" in table[2]["task"]["turns"][0]["checks"][0]["args"]
    metric: dict[str, float] = {}
    rewards = await trl.plumbline(
        ["x"] * 3,
        [good] * 3,
        table["task"][:],
        scheme=table["scheme"][:],
        profile=["mindcraft"] * 3,
        log_metric=metric.__setitem__,
    )
    assert rewards == [1.0, None, 1.0] and metric == {"plumbline/failed": 0.0}
    column = pa.array([number, None])
    assert await trl.plumbline(["x"] * 2, [good] * 2, column, suite=pa.array([None, None], pa.string())) == [1.0, None]
    label = {**table[0], "profile": "mindcraft"}
    text = json.dumps(label)
    assert (await verl.compute_score("x", good, text))["score"] == 1.0
    # The service's own doors read the same rows.
    sent = {"query": [good], "prompts": [""], "labels": [label]}
    async with httpx.AsyncClient() as http:
        answer = await http.post(f"{service.url}/get_reward", json=sent)
    assert answer.json()["rewards"] == [1.0]
    with Client(service.url) as client:
        assert client.rewards.grade(task=table[2]["task"], answer=[good], profile="mindcraft").reward == 1.0
        log = {"turns": [{"palette": ["stone"], "rows": np.zeros((1, 4), dtype=np.int32)}]}
        assert client.rewards.grade(task=WALL, turns=log["turns"], reward="mean").reward > 0.0
        with pytest.raises(errors.Unwritable, match=r"builtins\.object"):
            client.rewards.grade(task=WALL, turns=object())


async def test_what_is_no_completion_is_an_error_and_no_reward_of_0(good: str) -> None:
    for completion, why in [
        ([{"from": "gpt", "value": good}], "row 1: a message has a role"),
        ([{"role": "assistant", "content": 5}], "row 1: the content"),
        (b"bytes", "row 1: a completion is a text or messages"),
        (7, "row 1: a completion is a text or messages"),
    ]:
        with pytest.raises(ValueError, match=why):
            await trl.plumbline(["x"] * 2, [good, completion], [WALL] * 2)
    with pytest.raises(ValueError, match="an answer is a text, and this is 5"):
        await verl.compute_score("x", 5, WALL)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="2 completions and 1 tasks"):
        await trl.plumbline(["x"] * 2, [good] * 2, [WALL])
    said = {"role": "Assistant", "content": [good]}
    assert trl.texts_of(said) == trl.texts_of((said,)) == trl.texts_of(good) == [good]


def test_loops_that_have_ended_keep_no_connection(good: str) -> None:
    def descriptors() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    def grade() -> None:
        assert asyncio.run(trl.plumbline(["x"], [good], [WALL])) == [1.0]

    for _ in range(2):
        grade()
    before = descriptors()
    for _ in range(10):
        grade()
    gc.collect()
    assert descriptors() <= before + 3


def test_an_address_that_is_none_is_told_at_once() -> None:
    for wrong in ("ftp://service", "http://service:port", "http://", "https://"):
        with pytest.raises(errors.PlumblineError, match="is no address of a service"):
            Client(wrong)
    assert Client(" http://service:1/v1/ ").url == "http://service:1"


async def test_verl_gets_scores_with_the_same_members(service: Running, good: str) -> None:
    row = next(row for row in rows(service, "verl") if row["extra_info"]["task"].startswith("walls/"))
    good = code_of(build(row["extra_info"]["task"])["turns"][0])
    assert row["reward_model"]["style"] == "rule"
    truth = row["reward_model"]["ground_truth"]
    texts = [good, "no", "", good.replace("stone", "dirt")] * 30
    calls = [
        verl.compute_score(
            row["data_source"], text, truth, {**row["extra_info"], "num_turns": 2}, reward_router_address="x"
        )
        for text in texts
    ]
    scores = await asyncio.gather(*calls)
    assert len({tuple(score) for score in scores}) == 1
    assert [score["acc"] for score in scores[:3]] == [1.0, 0.0, 0.0]
    assert 0.0 < scores[3]["score"] < 1.0
    assert all(isinstance(value, float) for value in scores[0].values())
    with pytest.raises(errors.PlumblineError):
        await verl.compute_score("x", good, "walls/none")
    assert await asyncio.to_thread(verl.compute_score_sync, "x", texts[0], truth) == scores[0]


def test_the_rows_for_openrlhf_are_rewarded_by_the_service(service: Running, good: str) -> None:
    row = next(row for row in rows(service, "openrlhf") if WALL.split("/")[0] in row["label"])
    assert [message["role"] for message in row["input"]] == ["system", "user"]
    good = code_of(build(json.loads(row["label"])["task"])["turns"][0])
    prompt = "<|im_start|>" + row["input"][1]["content"]
    sample = {"query": [f"{prompt}{good}<|im_end|>"], "prompts": [prompt], "labels": [row["label"]]}
    answer = httpx.post(f"{service.url}/get_reward", json=sample).json()
    assert answer["rewards"] == [1.0]


def test_the_rows_for_nemo_gym_are_verified_by_the_service(service: Running) -> None:
    row = next(row for row in rows(service, "nemo-gym") if row["verifier_metadata"]["task"].startswith("walls/"))
    good = code_of(build(row["verifier_metadata"]["task"])["turns"][0])
    content = [{"type": "output_text", "text": good, "annotations": []}]
    message = {"type": "message", "id": "m", "role": "assistant", "status": "completed", "content": content}
    # As version 0.5.1 sends it: parameters with all their defaults, indices, and a prefix if it observes.
    sent = {
        **row,
        "_ng_task_index": 0,
        "_ng_rollout_index": 0,
        "response": {"id": "r", "output": [message], "usage": None},
    }
    sent["responses_create_params"] |= {"temperature": None, "tools": []}
    answer = httpx.post(f"{service.url}/verify", json=sent).json()
    assert answer["reward"] == 1.0
    assert answer["reward_shape"] == 1.0
    assert answer["responses_create_params"] == sent["responses_create_params"]
    assert httpx.post(f"{service.url}/seed_session", json=row).status_code == 200
    assert httpx.get(f"{service.url}/reverify_mode").json() == "stateless"
    told = httpx.post(f"{service.url}/aggregate_metrics", json={"verify_responses": [answer]}).json()
    assert told["agent_metrics"]["mean/reward"] == 1.0


def test_rows_know_neither_checks_nor_tasks_of_several_turns(service: Running) -> None:
    with Client(service.url) as client:
        single = [task.id for task in client.tasks.all("mineceraft-lite") if task.turns == 1]
    for form in ("trl", "verl", "openrlhf", "nemo-gym", "lm-eval"):
        found = rows(service, form)
        assert len(found) == len(single)
        assert not any("checks" in json.dumps(row) for row in found)
    assert len(rows(service, "trl", limit="3")) == 3
    refused = httpx.get(f"{service.url}/v1/tasks", params={"format": "parquet"})
    assert refused.status_code == 400
    assert "trl" in refused.json()["faults"][0]["detail"]


def test_lm_eval_runs_the_task(service: Running, good: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("lm_eval")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    monkeypatch.setenv("OPENAI_API_KEY", "x")
    import lm_eval
    from lm_eval.tasks import TaskManager

    import plumbline_client.lm_eval as ours

    with Client(service.url) as client:
        tasks = {one.prompts[0]: one.id for one in client.tasks.all("mineceraft-lite") if one.turns == 1}

    def answer(messages: list[dict[str, Any]]) -> Reply:
        prompt = messages[-1]["content"]
        task = next(task for text, task in tasks.items() if prompt.endswith(text))
        return Reply("no" if task.startswith("walls/") else code_of(build(task)["turns"][0]))

    model = Endpoint(answer)
    try:
        found = lm_eval.simple_evaluate(
            model="local-chat-completions",
            model_args={"model": "m", "base_url": f"{model.url}/chat/completions"},
            tasks=["mineceraft_lite_one_turn"],
            task_manager=TaskManager(include_path=str(Path(ours.__file__).parent), include_defaults=False),
            apply_chat_template=True,
            bootstrap_iters=0,
            log_samples=True,
        )
    finally:
        model.close()
    results = found["results"]["mineceraft_lite_one_turn"]
    walls = sum(task.startswith("walls/") for task in tasks.values())
    assert results["overall,none"] == pytest.approx(1.0 - walls / len(tasks))
    # One of the two tasks with this criterion is a wall.
    assert results["efficiency,none"] == 0.5


async def test_verifiers_runs_tasks_of_one_turn_and_of_several(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    vf = pytest.importorskip("verifiers.v1")
    with Client(service.url) as client:
        several = next(one for one in client.tasks.all("mineceraft") if one.turns == 2)
        single = client.tasks.get(WALL)
    codes = dict(zip(several.prompts, [code_of(turn) for turn in build(several.id)["turns"]], strict=True))
    codes[single.turns[0].prompt] = code_of(build(WALL)["turns"][0])
    model = Endpoint(lambda messages: Reply(codes[messages[-1]["content"]]))
    monkeypatch.setenv("STUB_KEY", "x")
    config = vf.resolve_env_config({"taskset": {"id": "plumbline-verifiers", "suite": "mineceraft"}})
    env = vf.load_environment(config)
    client_config = vf.EvalClientConfig(base_url=model.url, api_key_var="STUB_KEY")
    context = vf.ModelContext(model="stub", client=client_config)
    try:
        async with env.serving():
            for task in env.taskset.include(ids=[WALL, several.id]):
                episode = await env.run_episode(task, context)
                assert episode.ok, episode
                assert episode.traces[0].rewards["plumbline"].score == 1.0
                assert episode.traces[0].metrics["shape"] == 1.0
            # A service that is gone gives no reward, not a reward of 0.
            [task] = env.taskset.include(ids=[WALL])
            monkeypatch.setenv("PLUMBLINE_SERVER", "http://127.0.0.1:1")
            monkeypatch.setattr("plumbline_client.async_client.Retries", lambda: Retries(most=1, first_s=0.01))
            episode = await env.run_episode(task, context)
            assert not episode.ok
            assert episode.traces[0].rewards["plumbline"] is None
    finally:
        model.close()
