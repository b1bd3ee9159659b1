"""Solvers: one answer a turn, or tools that act in an episode."""

from __future__ import annotations

import base64
import json

from inspect_ai.model import ChatMessageUser, ContentImage
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.tool import Tool, ToolError, ToolResult, tool
from inspect_ai.util import store_as

from ..async_client import AsyncClient
from ..errors import Conflict, Faulty
from ..evaluate.attempts import words
from .boards import must_have_key, run_of
from .state import Build


@solver
def one_shot() -> Solver:
    """Asks for each turn once, in one conversation."""

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        build = state.store_as(Build)
        prompts: list[str] = state.metadata["prompts"]
        async with AsyncClient() as client:
            await must_have_key(client, state)
        for number in range(len(prompts)):
            if number > 0:
                state.messages.append(ChatMessageUser(content=prompts[number]))
            state = await generate(state, tool_calls="none")
            build.texts = [*build.texts, state.output.completion]
        return state

    return solve


@solver
def turn_by_turn(pictures: bool = True) -> Solver:
    """Lets the model build with tools in an episode: code runs at once, and the world can be looked at.

    A turn ends when the model answers without a call. `message_limit` of the evaluation bounds it.
    """

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        build = state.store_as(Build)
        prompts: list[str] = state.metadata["prompts"]
        async with AsyncClient() as client:
            await must_have_key(client, state)
            if state.metadata.get("instance") is not None:
                episode = await client.episodes.open(instance=state.metadata["instance"])
            else:
                build.run = await run_of(client, state)
                episode = await client.episodes.open(
                    task=state.metadata["task"], run=build.run, suite=None if build.run else state.metadata["suite"]
                )
            build.episode = str(episode.id)
            tools = [act(), look()] + ([picture()] if pictures else [])
            for number in range(len(prompts)):
                if number > 0:
                    await client.episodes.next_turn(build.episode)
                    build.turn, build.step = number + 1, build.step + 1
                    state.messages.append(ChatMessageUser(content=prompts[number]))
                state.tools = tools
                state = await generate(state, tool_calls="loop")
        return state

    return solve


@tool
def act() -> Tool:
    """Runs code in the world."""

    async def execute(code: str) -> str:
        """Run code in the world. What it builds stays; you are told what it did.

        Args:
          code: JavaScript, as the instructions describe it.
        """
        build = current()
        async with AsyncClient() as client:
            try:
                done = await client.episodes.step(str(build.episode), action_code=code, step=build.step + 1)
            except Faulty as refused:
                raise ToolError(f"The code was refused, and changed nothing.\n{refused}") from refused
        build.step += 1
        return words(done)

    return execute


@tool
def look() -> Tool:
    """Shows the blocks of a box."""

    async def execute(from_position: str, to_position: str) -> str:
        """Look at the blocks in a box of the world.

        Args:
          from_position: One corner, as "x,y,z".
          to_position: The opposite corner, as "x,y,z".
        """
        async with AsyncClient() as client:
            try:
                view = await client.episodes.view(str(current().episode), from_=from_position, to=to_position)
            except Faulty as refused:
                raise ToolError(str(refused)) from refused
        return json.dumps(view.model_dump(mode="json", by_alias=True, exclude_none=True))

    return execute


@tool
def picture() -> Tool:
    """Draws what was built."""

    async def execute(from_direction: str = "south-east") -> ToolResult:
        """Draw what was built so far.

        Args:
          from_direction: Where to look from: south-east, south-west, north-east or north-west.
        """
        async with AsyncClient() as client:
            try:
                image = await client.episodes.picture(str(current().episode), from_=from_direction)  # type: ignore[arg-type]
            except (Faulty, Conflict) as refused:
                raise ToolError(str(refused)) from refused
        return [ContentImage(image=f"data:image/png;base64,{base64.b64encode(image).decode()}")]

    return execute


def current() -> Build:
    """Returns what the sample of this call has built."""
    return store_as(Build)
