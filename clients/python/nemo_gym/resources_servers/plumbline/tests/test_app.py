"""The server with the framework's own shapes. Needs a service at `PLUMBLINE_SERVER` (`plumbline serve --open`)."""

import json
import os
import urllib.request
from typing import Any

from fastapi.testclient import TestClient
from nemo_gym.server_utils import ServerClient
from pytest import fixture
from resources_servers.plumbline.app import PlumblineConfig, PlumblineResourcesServer

URL = os.environ.get("PLUMBLINE_SERVER", "http://127.0.0.1:7586")
WALL = "for (let x = 0; x < 5; x++) {\n  await skills.placeBlock(bot, 'stone', x, 0, 0);\n}"


def server(url: str) -> TestClient:
    config = PlumblineConfig(host="", port=0, entrypoint="", name="plumbline", domain="games", url=url)
    made = PlumblineResourcesServer(config=config, server_client=ServerClient.model_construct())
    return TestClient(made.setup_webserver())


@fixture
def row() -> dict[str, Any]:
    with urllib.request.urlopen(f"{URL}/v1/tasks?suite=mineceraft-lite&format=nemo-gym&scheme=mean") as answer:
        rows = [json.loads(line) for line in answer]
    row = next(row for row in rows if row["verifier_metadata"]["task"].startswith("walls/"))
    content = [{"type": "output_text", "text": f"```js\n{WALL}\n```", "annotations": []}]
    message = {"type": "message", "id": "m", "role": "assistant", "status": "completed", "content": content}
    response = {"id": "r", "created_at": 0.0, "model": "m", "object": "response", "output": [message]}
    return {**row, "response": {**response, "parallel_tool_calls": False, "tool_choice": "auto", "tools": []}}


def test_a_response_is_verified_by_the_service(row: dict[str, Any]) -> None:
    answer = server(URL).post("/verify", json=row)
    assert answer.status_code == 200, answer.text
    verified = answer.json()
    assert 0.0 < verified["reward"] < 1.0
    assert verified["reward_material"] > 0.0
    assert verified["verifier_metadata"] == row["verifier_metadata"]


def test_a_failure_is_filed_and_is_no_reward(row: dict[str, Any]) -> None:
    # Refused at once, as the service refuses a row that names no task.
    row["verifier_metadata"]["task"] = "walls/none"
    filed = server(URL).post("/verify", json=row).json()
    assert filed["_ng_failure_class"] == "judge_failed", filed


def test_the_service_says_that_rows_may_be_verified_again() -> None:
    assert server(URL).get("/reverify_mode").json() == "stateless"
