"""The tasks of a suite, their reward, and the conversation of a task with several turns."""

from __future__ import annotations

import os
from collections.abc import Iterator

import verifiers.v1 as vf

from plumbline_client import AsyncClient, Client


class GradingConfig(vf.TaskConfig):
    """How builds are graded."""

    url: str | None = None
    """Address of the service; by default that in `PLUMBLINE_SERVER`."""
    key_var: str = "PLUMBLINE_KEY"
    """Name of the variable that holds the key; a key itself would be written beside the results."""
    scheme: str = "shaped"
    """Reward scheme."""
    profile: str = "mindcraft"
    """Rules under which code becomes a build."""


class TaskOfSuite(vf.TaskData):
    """A task. Nothing in it tells its checks."""

    task: str
    suite: str
    turns: list[str] = []  # noqa: RUF012


class Building(vf.Task[TaskOfSuite, vf.State, GradingConfig]):
    """A task with its reward."""

    @property
    def key(self) -> str:
        """Identifies the task in results."""
        return f"{self.data.suite}/{self.data.task}"

    @vf.reward(weight=1.0)
    async def plumbline(self, trace: vf.Trace) -> float:
        """Grades what the model wrote. A failure of the service raises, so that the sample has no reward."""
        config = self.config
        texts = [message.content or "" for message in trace.assistant_messages] or [""]
        async with AsyncClient(config.url, os.environ.get(config.key_var)) as client:
            graded = await client.rewards.grade(
                task=self.data.task,
                suite=self.data.suite,
                profile=config.profile,
                answer=texts,
                reward=config.scheme,
            )
        told = graded.components.model_dump(exclude_none=True)
        trace.record_metrics({name: float(value) for name, value in told.items()})
        trace.info["plumbline"] = graded.model_dump(mode="json", exclude_none=True)
        return graded.reward


class SuiteConfig(vf.TasksetConfig):
    """Which tasks there are."""

    suite: str = "mineceraft"
    """Name, or name@version."""
    track: str = "specified"
    """Track of the prompts: specified or brief."""
    task: GradingConfig = GradingConfig()


class Mineceraft(vf.Taskset[Building, SuiteConfig]):
    """The tasks of a suite, as the service has it."""

    def load(self) -> Iterator[Building]:
        """Yields the tasks."""
        config = self.config
        with Client(config.task.url, os.environ.get(config.task.key_var)) as client:
            found = client.suites.get(config.suite)
            system = client.tasks.system_prompt(found.id, config.track, config.task.profile)
            tasks = list(client.tasks.all(found.id, track=config.track))
        for one in tasks:
            data = TaskOfSuite(
                id=one.id,
                name=one.id,
                prompt=one.prompts[0],
                system_prompt=system,
                task=one.id,
                suite=found.id,
                turns=one.prompts,
            )
            yield Building(data, config.task)


class ConversationConfig(vf.EnvConfig):
    """Runs the harness in this process's machine, not in a cloud."""

    agent: vf.AgentConfig = vf.AgentConfig(runtime=vf.SubprocessConfig())


class Conversation(vf.Env[ConversationConfig]):
    """Gives the turns of a task one after another, in one conversation."""

    async def run(self, task: Building, agents: vf.Agents) -> None:
        """Goes through the turns."""
        if len(task.data.turns) == 1:
            await agents.agent.run(task)
            return
        async with agents.agent.interaction(task) as talk:
            segment = await talk.turn()
            for prompt in task.data.turns[1:]:
                if segment.terminated:
                    break
                segment = await talk.turn(prompt)
