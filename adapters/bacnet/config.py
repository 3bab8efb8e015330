"""The tables of kind "bacnet": devices of a BACnet/IP network, subscribed to and polled."""

from __future__ import annotations

import ipaddress
import re
from contextlib import suppress
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from adapters.bacnet.objects import LARGEST_INSTANCE, parse_object
from adapters.channel import LiveConfig, WatchedChannelConfig
from adapters.fields.durations import format_duration
from adapters.fields.values import Flag, Port, PositiveDuration, Retries, Timeout, check, whole
from adapters.fields.words import shown

PORT = 47808

_ROUTED = re.compile(r"(?P<net>[0-9]{1,5}):(?:0x[0-9a-fA-F]{2,14}|[0-9]{1,3})")
_LARGEST_NETWORK = 65534
_LONGEST_LIFETIME = 86_400.0


def _interface(value: object) -> str | None:
    """An IPv4 address of this machine, with or without the length of its prefix."""
    with suppress(ValueError):
        if isinstance(value, str):
            return str(ipaddress.IPv4Interface(value)) if "/" in value else str(ipaddress.IPv4Address(value))
    return None


def _with_port(value: object) -> str | None:
    """An IPv4 address and a port, which is BACnet's own where there is none."""
    host, _, port = value.partition(":") if isinstance(value, str) else ("", "", "")
    with suppress(ValueError):
        return f"{ipaddress.IPv4Address(host)}:{whole(1, 65535)(int(port) if port else PORT)}"
    return None


def _address(value: object) -> str | None:
    """Where a device is: an IPv4 address, or a network number and an address there, behind a router."""
    routed = _ROUTED.fullmatch(value) if isinstance(value, str) else None
    behind = routed is not None and 1 <= int(routed["net"]) <= _LARGEST_NETWORK
    return str(value) if behind or _with_port(value) else None


interface = check(
    _interface,
    "must be this machine's IPv4 address on the BACnet network with the length of its prefix, such as "
    '"192.168.1.10/24", not {}',
)
with_port = check(_with_port, f'must be an IPv4 address such as "192.168.1.20:{PORT}", not {{}}')
address = check(
    _address,
    'must be an IPv4 address such as "192.168.1.20", or behind a router the number of the network and the address '
    'there, such as "2001:5", not {}',
)


def object_name(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f'must be a type and an instance in quotes, such as "analog-input,3", not {shown(value)}')
    return str(parse_object(value))


def lifetime(seconds: float) -> float:
    if not 30.0 <= seconds <= _LONGEST_LIFETIME:
        raise ValueError(f"must be from 30s to 1d, not {format_duration(seconds)}")
    return seconds


Instance = Annotated[int, BeforeValidator(whole(0, LARGEST_INSTANCE))]
Interface = Annotated[str, BeforeValidator(interface)]
HostAndPort = Annotated[str, BeforeValidator(with_port)]
Place = Annotated[str, BeforeValidator(address)]
Lifetime = Annotated[PositiveDuration, AfterValidator(lifetime)]


class BacnetChannelConfig(WatchedChannelConfig):
    """A channel of a BACnet source; what is None is taken over from the source."""

    object: Annotated[str, BeforeValidator(object_name)] = Field(
        description='the object whose present value it is, such as "analog-input,3"'
    )
    device: Instance | None = Field(default=None, description="instance of the device")
    at: Place | None = Field(
        default=None, description='its address, `"192.168.1.20"` or behind a router `"2001:5"`; none: searched for'
    )
    cov: Flag | None = Field(default=None, description="allow a subscription; false: poll")
    compare_units: Flag | None = Field(default=None, description="refuse a value whose device states another unit")

    @property
    def address(self) -> str:
        return f"device {self.device} {self.object}"

    def within(self, table: BacnetConfig) -> Self:
        channel = super().within(table)
        if self.device not in (None, table.device):
            # The source says where its own device is.
            channel = channel.model_copy(update={"at": self.at})
        if channel.device is None:
            raise ValueError(f"device is missing; give the device's instance here or in sources.{self.source}")
        return channel


class BacnetConfig(LiveConfig):
    """[sources.<name>] of kind "bacnet": devices of a BACnet/IP network, read only."""

    channel: ClassVar = BacnetChannelConfig
    example: ClassVar = 'device = 1201, object = "analog-input,3"'
    source: ClassVar = "adapters.bacnet.source:BacnetSource"

    kind: Literal["bacnet"] = "bacnet"
    interface: Interface = Field(
        description='this machine\'s address on the BACnet network with its prefix, such as "192.168.1.10/24"'
    )
    port: Port = Field(default=PORT, description="UDP port of the network")
    bbmd: HostAndPort | None = Field(default=None, description="broadcast management device to register with")
    ttl: Lifetime = Field(default=300.0, description="how long that registration lasts; it is renewed")
    poll: PositiveDuration = Field(default=10.0, description="time between two readings of a channel")
    timeout: Timeout = Field(default=3.0, description="time limit for each answer")
    retries: Retries = Field(default=1, description="repeats of a request without an answer")
    lifetime: Lifetime = Field(default=300.0, description="how long a subscription lasts; renewed half-way")
    device: Instance | None = None
    at: Place | None = None
    cov: Flag = True
    compare_units: Flag = True

    @model_validator(mode="after")
    def _addressed(self) -> Self:
        if self.at is not None and self.device is None:
            raise ValueError("at says where device is; give device too, or at in the channels")
        return self

    @property
    def described(self) -> str:
        through = f" through the BBMD {self.bbmd}" if self.bbmd else ""
        return f"BACnet/IP from {self.interface} port {self.port}{through}, polled every {format_duration(self.poll)}"

    @property
    def broadcasts(self) -> bool:
        """Whether devices can be asked for by their numbers alone."""
        return self.bbmd is not None or ("/" in self.interface and not self.interface.endswith("/32"))
