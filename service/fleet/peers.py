"""The members of a fleet as they ask each other, and what Ray says of one that cannot be asked.

Every member is an actor with a name in the namespace of its site, restarted by Ray wherever there is room. It holds one
body, whose coroutines are what can be asked of it. No other module knows Ray's errors.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple

import ray
from ray import cloudpickle
from ray.actor import ActorHandle
from ray.exceptions import RayError, RayTaskError
from ray.experimental.internal_kv import _internal_kv_del, _internal_kv_get, _internal_kv_put
from ray.util import list_named_actors
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from service.errors import Away, NoModel, ReloadRefused, ServiceError, TooManyQuestions
from service.fleet.plan import Plan

STEWARD = "steward"

_PLAN = "plan"

_BODIES = {
    "steward": "service.fleet.steward:Steward",
    "shard": "service.fleet.shards.shard:Shard",
    "gateway": "service.fleet.gateways.gateway:Gateway",
}


_PLAIN: Mapping[str, type[ServiceError]] = {error.__name__: error for error in (Away, NoModel, TooManyQuestions)}


class Refusal(NamedTuple):
    """An error of ours on its way to who asked: the name of its class, and its sentences."""

    kind: str
    sentences: list[str]


class Member:
    """The actor around every body."""

    async def __init__(self, role: str, site: str, name: str) -> None:  # type: ignore[misc]  # as Ray has it
        # Before anything imports Numba, so here and not at the top.
        from service.daemon.process import prepare_process

        prepare_process()
        module, _, kind = _BODIES[role].partition(":")
        self._body = getattr(import_module(module), kind)(site, name)
        await self._body.wake()

    async def ask(self, method: str, arguments: tuple[Any, ...]) -> Any:
        """What the coroutine `method` of the body returns."""
        try:
            return await getattr(self._body, method)(*arguments)
        except ReloadRefused as error:
            return Refusal("ReloadRefused", error.problems)
        except ServiceError as error:
            # Not every class of ours can be pickled with what it was made of.
            return Refusal(type(error).__name__, [str(error)])


class Peer:
    """The member `name` of the fleet of `site`, whichever process it is in."""

    def __init__(self, site: str, name: str) -> None:
        self.name = name
        self._namespace = namespace(site)
        self._handle: ActorHandle | None = None

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        """What the member answers. Raises Away, or the ServiceError that it raised."""
        try:
            async with asyncio.timeout(timeout):
                handle: Any = self._handle
                if handle is None:
                    handle = self._handle = await asyncio.to_thread(ray.get_actor, self.name, self._namespace)
                answer = await handle.ask.remote(method, arguments)
        except TimeoutError:
            raise Away(f"{self.name} has not answered for {timeout:g} s") from None
        except RayTaskError as error:
            raise ServiceError(f"{self.name} failed: {error.cause!r}") from error
        except (RayError, ValueError) as error:
            # Under this name there may be another actor by now.
            self._handle = None
            raise Away(f"{self.name} cannot be reached now; it is being started or moved") from error
        if isinstance(answer, Refusal):
            raise _error(answer)
        return answer


def _error(refusal: Refusal) -> ServiceError:
    if refusal.kind == "ReloadRefused":
        return ReloadRefused(refusal.sentences)
    return _PLAIN.get(refusal.kind, ServiceError)(" ".join(refusal.sentences))


def namespace(site: str) -> str:
    """Where the members of a site have their names."""
    return f"thermogate-{site}"


def create(role: str, site: str, name: str, cpus: float = 0.0, node: str | None = None) -> None:
    """Let there be a member, on any machine with so many processors to spare or on `node` alone; without effect if
    there is one of this name already. It outlives its creator."""
    strategy = "SPREAD" if node is None else NodeAffinitySchedulingStrategy(node, soft=False)
    ray.remote(Member).options(
        name=name,
        namespace=namespace(site),
        get_if_exists=True,
        lifetime="detached",
        max_restarts=-1,
        num_cpus=cpus,
        scheduling_strategy=strategy,
        max_concurrency=1000,
    ).remote(role, site, name)


async def keep_a_spare() -> bool:
    """Let there be an idle process on this machine that has imported what a shard needs; whether there was one. Ray
    takes it for the next member that starts here. Raises Away."""
    here = NodeAffinitySchedulingStrategy(own_node(), soft=False)
    task = ray.remote(_import_what_shards_need).options(num_cpus=0, max_retries=0, scheduling_strategy=here)
    try:
        # It asks the head of the cluster, which may be away.
        there: bool = await (await asyncio.to_thread(task.remote))
    except RayError as error:
        raise Away("no process can be started on this machine now") from error
    return there


def _import_what_shards_need() -> bool:
    """Whether this process had imported it before."""
    from service.daemon.process import prepare_process
    from service.store.postgres.database import driver

    name = _BODIES["shard"].partition(":")[0]
    there = name in sys.modules
    prepare_process()
    import_module(name)
    driver()
    return there


def remove(site: str, name: str) -> None:
    """End a member for good; without effect if there is none."""
    try:
        ray.kill(ray.get_actor(name, namespace(site)), no_restart=True)
    except (RayError, ValueError):
        return


def members(site: str) -> set[str]:
    """The names of all members that there are."""
    own = namespace(site)
    return {each["name"] for each in list_named_actors(all_namespaces=True) if each["namespace"] == own}


def remember(site: str, plan: Plan) -> None:
    """Keep `plan` where the cluster keeps its actors, and in the form in which Ray keeps them there.

    Whoever can write there runs what they like on every machine of the cluster: Ray keeps the code of its actors there.
    """
    _internal_kv_put(_PLAN.encode(), cloudpickle.dumps(plan), overwrite=True, namespace=namespace(site).encode())


def remembered(site: str) -> Plan | None:
    """The plan that was kept last; None if none was. A process that is started anew goes on with it at once: the
    steward, which would tell it, may have been on the same machine."""
    kept = _internal_kv_get(_PLAN.encode(), namespace=namespace(site).encode())
    plan: Plan | None = None if kept is None else cloudpickle.loads(kept)
    return plan


async def go_on(site: str, adopt: Callable[[Plan], Awaitable[None]]) -> None:
    """`adopt` the plan that was kept last, if one was."""
    if (plan := await asyncio.to_thread(remembered, site)) is not None:
        await adopt(plan)


def forget(site: str) -> None:
    """Keep no plan any longer."""
    _internal_kv_del(_PLAN.encode(), namespace=namespace(site).encode())


def nodes() -> dict[str, str]:
    """The machines of the cluster that live: id and address."""
    return {node["NodeID"]: node["NodeManagerAddress"] for node in ray.nodes() if node["Alive"]}


def own_node() -> str:
    """The id of the machine that this process is on."""
    node: str = ray.get_runtime_context().get_node_id()
    return node


def end_process() -> None:
    """End this process at once, without a word to anybody; Ray starts the member anew."""
    os._exit(1)
