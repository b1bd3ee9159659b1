"""A small endpoint with OpenAI's Chat Completions, which answers from a script and fails on purpose."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Reply:
    """What the endpoint does with one request."""

    text: str | None = "DONE"
    status: int = 200
    finish_reason: str = "stop"
    refusal: str | None = None
    retry_after: str | None = None
    delay_s: float = 0.0
    usage: dict[str, Any] | None = field(
        default_factory=lambda: {"prompt_tokens": 100, "completion_tokens": 10, "total_tokens": 110}
    )
    body: bytes | None = None


class Endpoint:
    """The endpoint. `answer` gets the messages of a request and says what to do; `seen` keeps all requests."""

    def __init__(self, answer: Callable[[list[dict[str, Any]]], Reply]) -> None:
        self.seen: list[dict[str, Any]] = []
        self.keys: list[str | None] = []
        endpoint = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                request = json.loads(self.rfile.read(int(self.headers["content-length"])))
                if self.path != "/v1/chat/completions":
                    self._send(404, b'{"error": {"message": "no such path"}}')
                    return
                endpoint.seen.append(request)
                endpoint.keys.append(self.headers.get("authorization"))
                try:
                    reply = answer(request["messages"])
                except Exception as error:  # noqa: BLE001
                    reply = Reply(f"the test failed: {error!r}", status=400)
                time.sleep(reply.delay_s)
                if reply.status != 200:
                    error = {"error": {"message": reply.text, "code": "x"}}
                    self._send(reply.status, json.dumps(error).encode(), reply.retry_after)
                    return
                message = {"role": "assistant", "content": reply.text, "refusal": reply.refusal}
                choice = {"index": 0, "message": message, "finish_reason": reply.finish_reason}
                told = {
                    "id": "c",
                    "object": "chat.completion",
                    "created": 1,
                    "model": "canned-0614",
                    "choices": [choice],
                    "usage": reply.usage,
                }
                self._send(200, reply.body or json.dumps(told).encode())

            def _send(self, status: int, text: bytes, retry_after: str | None = None) -> None:
                try:
                    self.send_response(status)
                    self.send_header("content-type", "application/json")
                    self.send_header("content-length", str(len(text)))
                    if retry_after is not None:
                        self.send_header("retry-after", retry_after)
                    self.end_headers()
                    self.wfile.write(text)
                except (BrokenPipeError, ConnectionResetError):
                    pass

            def log_message(self, *arguments: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/v1"

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()


def code_of(turn: dict[str, Any]) -> str:
    """Returns what a model would write for the rows of a turn: prose, a script of many lines, and more prose."""
    lines = ["const stone = 'ignored';\t// 石"]
    for x, y, z, *placed in turn["rows"]:
        if placed:
            lines.append(f"await skills.placeBlock(bot, '{turn['palette'][placed[0]]}', {x}, {y}, {z});")
        else:
            lines.append(f"await skills.breakBlockAt(bot, {x}, {y}, {z});")
    script = "\n".join(lines)
    return f"Here is the plan — first the base.\n\n```javascript\n{script}\n```\n\nDone! 🧱"
