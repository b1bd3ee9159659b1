"""NeMo Gym's resources server for plumbline: passes each request on to the service, which does the grading.

The framework knows neither https, nor keys, nor a status that may be tried again; this server does. A failure that does
not pass is no reward: the framework files the row among those to be verified again.
"""

import os
from typing import Any, ClassVar

from nemo_gym.base_resources_server import (
    BaseResourcesServerConfig,
    BaseVerifyRequest,
    BaseVerifyResponse,
    ReverifyMode,
    SimpleResourcesServer,
)
from nemo_gym.judge import JudgeError
from pydantic import ConfigDict, PrivateAttr

from plumbline_client import AsyncClient, errors


class PlumblineConfig(BaseResourcesServerConfig):
    """`url` is the address of the service, `key_var` the name of the variable with the key."""

    REVERIFY_MODE: ClassVar[ReverifyMode] = ReverifyMode.STATELESS
    url: str
    key_var: str = "PLUMBLINE_KEY"


class PlumblineVerifyRequest(BaseVerifyRequest):
    """A row with the model's response; the row's own members say which task it is about."""

    model_config = ConfigDict(extra="allow")


class PlumblineVerifyResponse(BaseVerifyResponse):
    """The row with its reward and `reward_…`, a number for each criterion."""

    model_config = ConfigDict(extra="allow")


class PlumblineResourcesServer(SimpleResourcesServer):
    """The server."""

    config: PlumblineConfig
    _client: AsyncClient | None = PrivateAttr(default=None)

    async def verify(self, body: PlumblineVerifyRequest) -> PlumblineVerifyResponse:
        """Grades a response."""
        if self._client is None:
            self._client = AsyncClient(self.config.url, os.environ.get(self.config.key_var))
        try:
            row: Any = body.model_dump(mode="json")
            answer = await self._client.request("POST", "/verify", row, is_repeatable=True)
        except (errors.Unauthorized, errors.Forbidden):
            # True of every row: the run is to stop.
            raise
        except errors.PlumblineError as error:
            raise JudgeError(f"plumbline: {error}") from error
        return PlumblineVerifyResponse.model_validate(answer)


if __name__ == "__main__":
    PlumblineResourcesServer.run_webserver()
