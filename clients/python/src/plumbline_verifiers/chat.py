"""A harness that asks the model within this process: no shell, no sandbox, nothing to install."""

from __future__ import annotations

import httpx
import verifiers.v1 as vf
from verifiers.v1.dialects.chat import message_to_wire


class PlainChatConfig(vf.HarnessConfig):
    """No settings."""


class PlainChat(vf.Harness[PlainChatConfig]):
    """One answer of the model for each turn."""

    APPENDS_SYSTEM_PROMPT = True
    SUPPORTS_RESUME = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    async def launch(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
    ) -> vf.ProgramResult:
        """Sends the conversation so far, and leaves the answer in the trace."""
        system, prompt = self.resolve_prompt(data)
        messages = [vf.UserMessage(content=prompt)] if isinstance(prompt, str) else list(prompt or [])
        sent = [message_to_wire(message) for message in messages]
        if system:
            sent = [{"role": "system", "content": system}, *sent]
        headers = {"authorization": f"Bearer {secret}"}
        async with httpx.AsyncClient(timeout=None) as client:
            body = {"model": ctx.model, "messages": sent}
            answer = await client.post(f"{endpoint}/chat/completions", headers=headers, json=body)
        failed = "" if answer.is_success else answer.text
        return vf.ProgramResult(exit_code=1 if failed else 0, stdout="", stderr=failed)
