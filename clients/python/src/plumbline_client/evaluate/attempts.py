"""Answering one problem: all turns in one conversation, or turn by turn in a world that answers."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

from .. import errors
from ..async_client import AsyncClient
from ..models import StepDone
from .journal import Journal
from .model import Completion, Message
from .plan import Plan
from .problems import Attempt

EPISODE_RULES = (
    "\n\n## Steps\n\nYour code runs as soon as you answer, and you are told what it did. You may then correct or "
    "continue the build with more code; what stands stays. When the turn's instruction is carried out, answer with the "
    "single word DONE and no code. You have {steps} answers a turn."
)


def system_of(plan: Plan, system: str) -> str:
    """Returns the system prompt that the model gets."""
    return system + EPISODE_RULES.format(steps=plan.steps) if plan.mode == "episodes" else system


class Asks(Protocol):
    """Asks the model, or returns the answer that the journal already has."""

    async def __call__(self, attempt: Attempt, messages: list[Message], number: int) -> Completion: ...


async def one_shot(ask: Asks, attempt: Attempt, system: str) -> tuple[list[str], list[Message]]:
    """Asks for each turn in one conversation. Returns the text of each turn, and the conversation."""
    messages: list[Message] = [{"role": "system", "content": system}]
    texts = []
    for number, prompt in enumerate(attempt.problem.prompts):
        messages.append({"role": "user", "content": prompt})
        completion = await ask(attempt, messages, number)
        messages.append({"role": "assistant", "content": completion.text})
        texts.append(completion.text)
    return texts, messages


async def by_episode(
    client: AsyncClient, plan: Plan, journal: Journal, ask: Asks, attempt: Attempt, system: str
) -> tuple[str, list[Message]]:
    """Goes through an episode, as far as the journal has not. Returns its identifier, and the conversation."""
    episode = await opened(client, journal, attempt)
    messages: list[Message] = [{"role": "system", "content": system_of(plan, system)}]
    asked = answered = 0
    for turn, prompt in enumerate(attempt.problem.prompts):
        if turn > 0 and len(journal.all(episode, "turn")) < turn:
            await client.episodes.next_turn(episode, step=next_number(journal, episode))
            journal.add(episode, "turn", turn=turn + 1)
        messages.append({"role": "user", "content": prompt})
        for left in reversed(range(plan.steps)):
            completion = await ask(attempt, messages, asked)
            asked += 1
            messages.append({"role": "assistant", "content": completion.text})
            if is_done(completion.text):
                break
            told = await stepped(client, plan, journal, episode, answered, completion.text)
            answered += 1
            if left > 0:
                messages.append({"role": "user", "content": told})
    return episode, messages


async def opened(client: AsyncClient, journal: Journal, attempt: Attempt) -> str:
    """Returns the episode of an attempt, opened if there is none yet."""
    known = journal.last(attempt.name, "episode")
    if known is not None and known["episode"] is not None:
        return str(known["episode"])
    if attempt.problem.is_hidden:
        episode = await client.episodes.open(instance=attempt.problem.id)
    else:
        episode = await client.episodes.open(task=attempt.problem.id, run=attempt.run)
    journal.add(attempt.name, "episode", episode=str(episode.id))
    return str(episode.id)


async def stepped(client: AsyncClient, plan: Plan, journal: Journal, episode: str, index: int, code: str) -> Any:
    """Makes a step, unless the journal has what it did, and returns what the model is told of it."""
    entries = journal.all(episode, "step")
    if len(entries) > index:
        return entries[index]["told"]
    number = next_number(journal, episode)
    told: Any
    try:
        told = words(await client.episodes.step(episode, action_code=code, step=number))
        is_made = True
    except errors.Faulty as refused:
        # Code that reaches a limit changes nothing, and its number is still to be used.
        told = f"The code was refused, and changed nothing.\n{refused}"
        is_made = False
    if plan.pictures:
        told = [{"type": "text", "text": told}, *await picture_of(client, episode)]
    journal.add(episode, "step", told=told, is_made=is_made)
    return told


def next_number(journal: Journal, episode: str) -> int:
    """Returns the number of the next step; going on to the next turn is one too."""
    made = sum(1 for entry in journal.all(episode, "step") if entry["is_made"])
    return 1 + made + len(journal.all(episode, "turn"))


async def picture_of(client: AsyncClient, episode: str) -> list[dict[str, Any]]:
    """Returns the picture of a build as a part of a message; nothing if there is nothing to draw."""
    try:
        image = base64.b64encode(await client.episodes.picture(episode)).decode()
    except (errors.Faulty, errors.Conflict):
        return []
    return [{"type": "image_url", "image_url": {"url": f"data:image/png;base64,{image}"}}]


def is_done(text: str) -> bool:
    """Whether the whole answer is the word DONE, whatever marks surround it."""
    return "".join(filter(str.isalpha, text)).upper() == "DONE"


def words(done: StepDone) -> str:
    """Says what a step did, for the model."""
    placed = sum(event.action == "place" for event in done.events)
    lines = [f"Placed {placed} and removed {len(done.events) - placed} blocks; {done.blocks} of yours stand now."]
    if done.events_left_out:
        lines[0] += f" {done.events_left_out} more changes are not counted here."
    code = done.code
    if code is not None:
        if code.error is not None:
            line = f" (line {code.error.line})" if code.error.line else ""
            lines.append(f"The code ended early{line}: {code.error.message}")
        lines += [dropped_words(dropped.count, dropped.reason) for dropped in code.dropped or []]
        lines += [f"Note: {note}" for note in code.notes or []]
        printed = "\n".join(code.log or [])
        if printed:
            lines.append(f"It printed:\n{printed[:4000]}")
    lines.append("You stand at ({:g}, {:g}, {:g}).".format(*done.position))
    return "\n".join(lines)


def dropped_words(count: int, reason: str) -> str:
    """Says why calls did nothing, for the model."""
    return f"{count} {'call' if count == 1 else 'calls'} did nothing: {reason}"


def counts(journal: Journal) -> dict[str, int | None]:
    """Counts the answers of the model, and those that most likely build nothing, each by one reason."""
    reasons = [reason_of(Completion.of_json(entry["completion"])) for entry in journal.of_kind("completion")]
    names = ("refused", "tool_calls", "cut_off", "empty")
    found: dict[str, int | None] = {"answers": len(reasons)}
    found |= {name: reasons.count(name) for name in names}
    results = [entry["result"] for entry in journal.of_kind("submitted")]
    found["code_stopped"] = sum(len(result.get("refused") or ()) for result in results)
    # The service tells it of code that was posted to a public suite.
    for name in ("code_failed", "code_idle"):
        told = [result.get(name) for result in results]
        found[name] = sum(told) if all(count is not None for count in told) else None
    return found


def reason_of(answer: Completion) -> str | None:
    """Returns why an answer most likely builds nothing."""
    if answer.refusal is not None:
        return "refused"
    if answer.finish_reason in ("tool_calls", "function_call"):
        return "tool_calls"
    if answer.finish_reason == "length":
        return "cut_off"
    return None if answer.text.strip() else "empty"


def transcript_of(messages: list[Message], completions: list[dict[str, Any]]) -> bytes:
    """Returns a conversation as JSON, with what the model told beside its text."""
    told = [{name: value for name, value in entry["completion"].items() if name != "text"} for entry in completions]
    text = json.dumps({"messages": messages, "completions": told}, ensure_ascii=False, indent=1)
    return text.encode()


def keep_transcript(folder: Path, attempt: Attempt, transcript: bytes) -> Path:
    """Writes a transcript beside the run."""
    parts = [quote(part, safe=" ").replace("..", "%2E%2E") for part in attempt.name.split("/")]
    path = folder.joinpath("transcripts", *parts[:-1], f"{parts[-1]}.json")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(transcript)
    return path
