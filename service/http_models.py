"""[http] as it is written in the configuration: where REST is served, and who may ask."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator

from service.config_types import FilePath, LoopbackHost, whole
from service.network_models import TABLE

Port = Annotated[int, BeforeValidator(whole(0, 65535))]


class HttpConfig(BaseModel):
    """[http]: where REST is served; port 0 is any free one."""

    model_config = TABLE

    host: LoopbackHost = "127.0.0.1"
    port: Port = 8080
    keys_file: FilePath | None = None
