"""How the BACnet network is reached. Pure."""

from __future__ import annotations

from dataclasses import dataclass

PORT = 47808


@dataclass(frozen=True)
class Network:
    """The network as this machine sees it.

    `interface` is this machine's address there, with the length of its prefix where broadcasts are wanted
    ("192.168.1.10/24"). As a foreign device it registers with the BBMD at `bbmd` ("host:port") for `ttl` s at a time,
    and broadcasts through that. `timeout` (s) holds for every answer; a request is repeated `retries` times.
    """

    interface: str
    port: int = PORT
    bbmd: str | None = None
    ttl: float = 300.0
    timeout: float = 3.0
    retries: int = 1

    @property
    def place(self) -> str:
        """Where it leads to."""
        through = f" through the BBMD {self.bbmd}" if self.bbmd else ""
        return f"{self.interface} port {self.port}{through}"

    @property
    def broadcasts(self) -> bool:
        """Whether devices can be asked for by their numbers alone."""
        return self.bbmd is not None or ("/" in self.interface and not self.interface.endswith("/32"))
