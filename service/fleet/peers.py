"""The members of a fleet as they ask each other, and what Ray says of one that cannot be asked.

Every member is an actor with a name in the namespace of its site, restarted by Ray wherever there is room. It holds one
body, whose coroutines are what can be asked of it. No other module knows Ray's errors.
"""

import asyncio
import logging
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import ray
from ray import cloudpickle
from ray.actor import ActorHandle
from ray.exceptions import RayError, RayTaskError
from ray.experimental.internal_kv import _internal_kv_del, _internal_kv_get, _internal_kv_put
from ray.util import list_named_actors
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from service.errors import Away, ServiceError
from service.fleet.plan import Plan

GATEWAY = "gateway-"
"""What the name of every gateway begins with."""
ANSWER_SECONDS = 5.0
"""How long a sign of life may take."""
_PLAN = b"plan"
_SHARD = "service.fleet.shards.shard:Shard"
_GATEWAY = "service.fleet.gateways.gateway:Gateway"


class Actor:
    async def __init__(self, body: str, site: str, name: str) -> None:  # type: ignore[misc]  # as Ray has it
        # Before anything imports Numba, so here and not at the top.
        from service.daemon.process import prepare_process

        prepare_process()
        module, _, kind = body.partition(":")
        self._body = getattr(import_module(module), kind)(site, name)
        await self._body.wake()

    async def ask(self, method: str, arguments: tuple[Any, ...]) -> Any:
        """What the coroutine `method` of the body returns, or the ServiceError that it raises."""
        try:
            return await getattr(self._body, method)(*arguments)
        except ServiceError as error:
            return error


class Peer:
    """The member `name` of the fleet of `site`, whichever process it is in."""

    def __init__(self, site: str, name: str) -> None:
        self.name = name
        self._namespace = namespace(site)
        self._handle: ActorHandle | None = None

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None, give_up: bool = False) -> Any:
        """What the member answers; with `give_up` it stops at it once nobody waits any more. Raises Away, or the
        ServiceError that it raised."""
        asked: Any = None
        try:
            async with asyncio.timeout(timeout):
                handle: Any = self._handle
                if handle is None:
                    handle = self._handle = await asyncio.to_thread(ray.get_actor, self.name, self._namespace)
                asked = handle.ask.remote(method, arguments)
                answer = await asked
        except (TimeoutError, asyncio.CancelledError) as error:
            if give_up and asked is not None:
                ray.cancel(asked)
            if isinstance(error, TimeoutError):
                raise Away(f"{self.name} has not answered for {timeout:g} s") from None
            raise
        except RayTaskError as error:
            raise ServiceError(f"{self.name} failed: {error.cause!r}") from error
        except (RayError, ValueError) as error:
            # Under this name there may be another actor by now.
            self._handle = None
            raise Away(f"{self.name} cannot be reached now; it is being started or moved") from error
        if isinstance(answer, ServiceError):
            raise answer
        return answer


def namespace(site: str) -> str:
    return f"thermogate-{site}"


@contextmanager
def joined(address: str) -> Iterator[None]:
    """This process is a driver of the Ray cluster at `address`. Raises ServiceError."""
    # Ray would tell its makers that it is used.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        ray.init(address=address, log_to_driver=False, configure_logging=False, logging_level=logging.ERROR)
    except (ConnectionError, ValueError, RuntimeError) as error:
        first = str(error).splitlines()[0]
        raise ServiceError(
            f"the Ray cluster {address} cannot be joined ({first}); start one with `ray start --head`, or name another "
            "with --address"
        ) from error
    try:
        yield
    finally:
        ray.shutdown()
        sys.stdout.flush()


def wanted(plan: Plan, nodes: Iterable[str]) -> dict[str, str | None]:
    """The members that there should be, and of a gateway its machine."""
    return {f"{GATEWAY}{node[:8]}": node for node in nodes} | dict.fromkeys(plan.shards)


def create(site: str, name: str, cpus: float = 0.0, node: str | None = None) -> None:
    """Let there be a member, on any machine with so many processors to spare or on `node` alone; without effect if
    there is one of this name already. It outlives its creator."""
    strategy = "SPREAD" if node is None else NodeAffinitySchedulingStrategy(node, soft=False)
    ray.remote(Actor).options(
        name=name,
        namespace=namespace(site),
        get_if_exists=True,
        lifetime="detached",
        max_restarts=-1,
        num_cpus=cpus,
        scheduling_strategy=strategy,
        max_concurrency=1000,
    ).remote(_GATEWAY if node else _SHARD, site, name)


def remove(site: str, name: str, for_good: bool = True) -> None:
    """End a member, or have Ray start it anew in another process; without effect if there is none."""
    try:
        ray.kill(ray.get_actor(name, namespace(site)), no_restart=for_good)
    except (RayError, ValueError):
        return


def members(site: str) -> set[str]:
    own = namespace(site)
    return {each["name"] for each in list_named_actors(all_namespaces=True) if each["namespace"] == own}


def remember(site: str, plan: Plan) -> None:
    """Keep `plan` where the cluster keeps its actors, and in the form in which Ray keeps them there. Whoever can write
    there runs what they like on every machine of the cluster: Ray keeps the code of its actors there."""
    _internal_kv_put(_PLAN, cloudpickle.dumps(plan), overwrite=True, namespace=namespace(site).encode())


def remembered(site: str) -> Plan | None:
    """The plan that was kept last; None if none was."""
    kept = _internal_kv_get(_PLAN, namespace=namespace(site).encode())
    return None if kept is None else cloudpickle.loads(kept)


def forget(site: str) -> None:
    """Keep no plan any longer."""
    _internal_kv_del(_PLAN, namespace=namespace(site).encode())


def nodes() -> dict[str, str]:
    """The machines of the cluster that live: id and address."""
    return {node["NodeID"]: node["NodeManagerAddress"] for node in ray.nodes() if node["Alive"]}


def own_node() -> str:
    """The id of the machine that this process is on."""
    return ray.get_runtime_context().get_node_id()


def end_process() -> None:
    """End this process at once, without a word to anybody; Ray starts the member anew."""
    os._exit(1)
