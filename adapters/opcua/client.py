"""The connection to an OPC UA server: asyncua behind a few verbs, its errors as ours. It can only read."""

import logging
import struct
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from typing import Any, TypeVar

from asyncua import Client, Node, ua
from asyncua.common.subscription import DataChangeNotif, Subscription
from asyncua.crypto import security_policies
from cryptography.exceptions import InvalidSignature

from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.opcua.config import ServerConfig
from adapters.opcua.identity import identity
from adapters.opcua.values import Seen

Item = TypeVar("Item")

TOGETHER = 100
"""Nodes in one request: some servers take no more."""

_POLICIES: dict[str, Callable[..., Any]] = {
    "Basic256Sha256": security_policies.SecurityPolicyBasic256Sha256,
    "Aes128Sha256RsaOaep": security_policies.SecurityPolicyAes128Sha256RsaOaep,
    "Aes256Sha256RsaPss": security_policies.SecurityPolicyAes256Sha256RsaPss,
}
_MODES = {"sign": ua.MessageSecurityMode.Sign, "encrypt": ua.MessageSecurityMode.SignAndEncrypt}
_SESSION = 120_000
"""ms after which the server forgets a session that went away without a word: it has few of them."""

_UNREADABLE = (ValueError, TypeError, LookupError, AttributeError, struct.error, InvalidSignature)
"""What the library raises where an answer is not what it expects."""

_LOGIN = (ua.uaerrors.BadIdentityTokenRejected, ua.uaerrors.BadIdentityTokenInvalid, ua.uaerrors.BadUserAccessDenied)
_OBJECTS = "i=85"
_SERVER = ua.NodeId.from_string("i=2253")

# What it has to say is said here, in one sentence each.
logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)


class OpcuaLink:
    """A session with one server. Made inside the event loop that uses it."""

    def __init__(self, server: ServerConfig) -> None:
        """SourceConfigError if a file of `server` cannot be used."""
        self._told: dict[str, Seen] = {}
        self._server = server
        self._namespaces: list[str] = []
        self._names: dict[ua.NodeId, list[str]] = {}
        """Subscribed nodes as the configuration writes them."""
        self._subscription: Subscription | None = None
        self._client = client = Client(server.url, server.timeout, watchdog_intervall=server.timeout)
        client.name = client.description = "Thermogate"
        client.application_uri = "urn:thermogate"
        client.session_timeout = _SESSION
        user, secret = server.credentials()
        if user is not None:
            client.set_user(user)
            client.set_password(secret or "")
        if server.security is not None:
            wanted = server.security
            own = identity(wanted.certificate, wanted.private_key, wanted.server_certificate)
            client.application_uri = own.uri
            client.security_policy = _POLICIES[wanted.policy](own.server, own.certificate, own.key, _MODES[wanted.mode])
            client.uaclient.set_security(client.security_policy)

    async def open(self) -> None:
        """Connect. Raises SourceUnavailable with the remedy."""
        async with self._translated():
            await self._client.connect()
            self._namespaces = await self._client.get_namespace_array()

    async def close(self) -> None:
        """End the session; safe to call twice."""
        with suppress(ua.UaError, OSError, TimeoutError):
            await self._client.disconnect()

    async def read(self, nodes: Sequence[str]) -> dict[str, Seen]:
        """What the server says of each of `nodes` now. Raises SourceUnavailable."""
        found: dict[str, Seen] = {}
        async with self._translated():
            ids = self._ids(nodes)
            found |= {node: Seen(None, "BadNodeIdUnknown") for node in nodes if node not in ids}
            for names in _pieces(list(ids)):
                answers = await self._client.uaclient.read_attributes(
                    [ids[name] for name in names], ua.AttributeIds.Value
                )
                found |= {name: _seen(answer) for name, answer in zip(names, answers, strict=True)}
        return found

    async def subscribe(self, nodes: Sequence[str], every: float) -> dict[str, str]:
        """Have changes of `nodes`, and of no others, told every `every` s (`taken`); those that the server does not
        offer, with its reason. Raises SourceUnavailable."""
        refused: dict[str, str] = {}
        async with self._translated():
            if self._subscription is not None:
                await self._subscription.delete()
                self._subscription = None
            ids = self._ids(nodes)
            self._names = {}
            for node, id in ids.items():
                self._names.setdefault(id, []).append(node)
            if not self._names:
                return refused
            try:
                self._subscription = subscription = await self._client.create_subscription(1000 * every, self)
            except ua.UaStatusCodeError as error:
                return dict.fromkeys(ids, _name(error))
            for some in _pieces(list(self._names)):
                watched = [self._client.get_node(id) for id in some]
                every_ms = ua.Duration(1000 * every)
                handles = await subscription.subscribe_data_change(watched, queuesize=1, sampling_interval=every_ms)
                for id, handle in zip(some, handles, strict=True):
                    if isinstance(handle, ua.StatusCode):
                        refused |= dict.fromkeys(self._names[id], handle.name)
        return refused

    def datachange_notification(self, node: Node, value: object, data: DataChangeNotif) -> None:
        """Take in what a subscription brings; called by the library."""
        seen = _seen(data.monitored_item.Value)
        self._told |= dict.fromkeys(self._names.get(node.nodeid, ()), seen)

    def taken(self) -> dict[str, Seen]:
        """What subscriptions brought since the last call, by node."""
        told, self._told = self._told, {}
        return told

    async def units(self, nodes: Sequence[str]) -> dict[str, str]:
        """The engineering units that the server states of `nodes`, for a person. Raises SourceUnavailable."""
        found: dict[str, str] = {}
        path = ua.RelativePath.from_string("/0:EngineeringUnits")
        async with self._translated():
            ids = self._ids(nodes)
            for names in _pieces(list(ids)):
                paths = [ua.BrowsePath(ids[name], path) for name in names]
                answers = await self._client.uaclient.translate_browsepaths_to_nodeids(paths)
                for name, answer in zip(names, answers, strict=True):
                    if answer.StatusCode.is_good() and answer.Targets:
                        # What a server does not tell of a unit says nothing against the value.
                        with suppress(ua.UaStatusCodeError):
                            unit = await self._client.get_node(answer.Targets[0].TargetId).read_value()
                            if isinstance(unit, ua.EUInformation) and unit.DisplayName.Text:
                                found[name] = unit.DisplayName.Text
        return found

    async def variables(self, most: int) -> dict[str, str]:
        """The variables below the folder of objects, `most` of them: their nodes, and the names on the way there. What
        every server has (namespace 0) is left out. Raises SourceUnavailable."""
        found: dict[str, str] = {}
        known: set[ua.NodeId] = {_SERVER}
        waiting = deque([(self._client.get_node(_OBJECTS), "")])
        async with self._translated():
            while waiting and len(found) < most:
                node, path = waiting.popleft()
                for child in await node.get_children_descriptions():
                    id, name = child.NodeId, f"{path}{child.DisplayName.Text}"
                    if id in known:
                        continue
                    known.add(id)
                    if child.NodeClass == ua.NodeClass.Variable and id.NamespaceIndex != 0:
                        found[id.to_string()] = name
                    elif child.NodeClass == ua.NodeClass.Object:
                        waiting.append((self._client.get_node(id), f"{name}/"))
        return found

    async def history(self, node: str, begin: float, end: float) -> list[Seen]:
        """What the server has recorded of `node` in [begin, end), UTC s, in the order of time. Raises
        SourceUnavailable, and SourceConfigError if it has no history of it."""
        details = ua.ReadRawModifiedDetails(
            IsReadModified=False, StartTime=_written(begin), EndTime=_written(end), NumValuesPerNode=0
        )
        values: list[Seen] = []
        async with self._translated():
            ids = self._ids([node])
            if node not in ids:
                raise SourceConfigError(f"{self._server.url} does not know the namespace of {node}; check node")
            at, more = self._client.get_node(ids[node]), None
            while True:
                answer = await at.history_read(details, more)
                if answer.StatusCode.is_bad():
                    raise SourceConfigError(
                        f"{self._server.url} gives no history of {node} ({answer.StatusCode.name}); check node, and "
                        "that the server records it"
                    )
                if answer.HistoryData is not None:
                    values += map(_seen, answer.HistoryData.DataValues)
                if answer.ContinuationPoint in (None, b"", more):
                    return values
                more = answer.ContinuationPoint

    def _ids(self, nodes: Sequence[str]) -> dict[str, ua.NodeId]:
        """The ids of those of `nodes` whose namespaces the server knows."""
        found: dict[str, ua.NodeId] = {}
        for node in nodes:
            uri, _, local = node.removeprefix("nsu=").partition(";") if node.startswith("nsu=") else ("", "", node)
            if uri and uri not in self._namespaces:
                continue
            space = f"ns={self._namespaces.index(uri)};" if uri else ""
            found[node] = ua.NodeId.from_string(f"{space}{local}")
        return found

    @asynccontextmanager
    async def _translated(self) -> AsyncIterator[None]:
        """Errors of the library as ours."""
        url, timeout = self._server.url, self._server.timeout
        remedy = "check url and the server" + ("" if self._server.security is None else ", and security on both sides")
        try:
            yield
        except _LOGIN as error:
            raise SourceUnavailable(f"{url} refuses this client ({_name(error)}); check user and password") from error
        except TimeoutError as error:
            raise SourceUnavailable(f"{url} does not answer within {timeout:g} s; {remedy}") from error
        except OSError as error:
            reason = error.strerror or str(error) or "it has closed the connection"
            raise SourceUnavailable(f"{url} cannot be reached ({reason}); {remedy}") from error
        except ua.UaStatusCodeError as error:
            raise SourceUnavailable(f"{url} answers {_name(error)}; {remedy}") from error
        except (ua.UaError, *_UNREADABLE) as error:
            raise SourceUnavailable(f"{url} does not answer as it should ({error}); {remedy}") from error


def _seen(answer: ua.DataValue) -> Seen:
    value = None if answer.Value is None else answer.Value.Value
    status = "Good" if answer.StatusCode is None else answer.StatusCode.name
    when = answer.SourceTimestamp
    return Seen(value, status, None if when is None else when.replace(tzinfo=UTC).timestamp())


def _written(time: float) -> datetime:
    """UTC s as the library writes them, without a time zone."""
    return datetime.fromtimestamp(time, UTC).replace(tzinfo=None)


def _name(error: ua.UaStatusCodeError) -> str:
    return str(ua.status_codes.get_name_and_doc(error.code)[0])


def _pieces(items: list[Item]) -> Iterator[list[Item]]:
    for begin in range(0, len(items), TOGETHER):
        yield items[begin : begin + TOGETHER]
