"""Messages to webhooks, verified by the package of Standard Webhooks."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from conftest import Running
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

from plumbline_client import Client

Message = tuple[dict[str, str], bytes]


@pytest.fixture
def endpoint() -> Iterator[tuple[str, list[Message]]]:
    received: list[Message] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            length = int(self.headers["content-length"])
            received.append(({name.lower(): value for name, value in self.headers.items()}, self.rfile.read(length)))
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/", received
    server.shutdown()


def wait_for(received: list[Message], count: int) -> Message:
    for _ in range(300):
        if len(received) >= count:
            return received[count - 1]
        time.sleep(0.1)
    raise AssertionError(received)


def test_messages_verify_with_the_package_of_standard_webhooks(
    tmp_path: Path, endpoint: tuple[str, list[Message]]
) -> None:
    url, received = endpoint
    running = Running(tmp_path, "--webhooks-to-private-addresses")
    try:
        key = running.run("keys", "create", "--name", "lab").strip()
        with Client(running.url, key=key) as client:
            made = client.webhooks.create(url=url, events=["submission.graded"])
            assert made.secret is not None
            client.submissions.create(task=113, turns=[{"events": []}])
            headers, body = wait_for(received, 1)
            message = Webhook(made.secret).verify(body, headers)
            assert message["type"] == "submission.graded"
            assert message["data"]["task"] == "walls/5x1x5-raise"
            with pytest.raises(WebhookVerificationError):
                Webhook(made.secret).verify(body + b" ", headers)
            with pytest.raises(WebhookVerificationError):
                Webhook(made.secret).verify(body, headers | {"webhook-id": "msg_other"})

            # For a while, both secrets sign.
            changed = client.webhooks.change_secret(made.id)
            assert changed.secret not in (None, made.secret)
            delivery = client.webhooks.test(made.id)
            headers, body = wait_for(received, 2)
            assert headers["webhook-id"] == delivery.id
            for secret in (made.secret, changed.secret):
                assert Webhook(str(secret)).verify(body, headers)["type"] == "webhook.test"
            assert client.webhooks.list().webhooks[0].secret is None
            assert [item.event for item in client.webhooks.deliveries(made.id).deliveries] == [
                "webhook.test",
                "submission.graded",
            ]
    finally:
        running.stop()
