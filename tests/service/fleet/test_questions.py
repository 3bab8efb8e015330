"""What a gateway asks a shard: nothing is computed for a client that has gone, and errors are those of the zone."""

import asyncio
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import pytest
from support.waiting import until

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Fenced, LeaseHeld, NoLaw, RequestError, ServiceError, StateMismatch
from service.fleet import peers
from service.fleet.gateways import views as views_module
from service.fleet.gateways.views import RemoteZone, ShardView
from service.fleet.shards import shard as module
from service.fleet.shards.shard import Shard
from service.records.asker import Asker, asked_by
from service.zone.questions import THREADS, Questions


class Pondering:
    """A zone whose forecasts take for ever, unless nobody waits for them."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self.at_work, self.ended = threading.Event(), threading.Event()

    async def skill(self) -> Any:
        def computed(given_up: Any) -> None:
            self.at_work.set()
            while not given_up():
                pass
            self.ended.set()

        return await self._questions.ask(computed)


class Direct:
    """The shard as the gateway asks it."""

    def __init__(self, shard: Shard) -> None:
        self._shard, self.name = shard, "shard-0"

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None, give_up: bool = False) -> Any:
        # In Ray it is another process, which knows nothing of the asker here, and whose task is cancelled with this.
        assert give_up
        asked_by(Asker())
        return await getattr(self._shard, method)(*arguments)


async def test_a_question_is_given_up_with_its_client(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "own_node", lambda: "0123456789abcdef")
    monkeypatch.setattr(module, "Crashes", lambda site, name: SimpleNamespace(suspects=()))
    monkeypatch.setattr(views_module, "LOOK", 0.05)
    stopping = threading.Event()
    with ThreadPoolExecutor(THREADS) as pool:
        try:
            shard: Any = Shard("campus", "shard-0")
            room = Pondering(Questions(pool, stopping))
            shard._work = SimpleNamespace(zones={"room": room})
            zone: Any = SimpleNamespace(id="room", shard=ShardView(Direct(shard)))
            client = Asker("key heat")
            asked_by(client)
            asking = asyncio.create_task(RemoteZone._ask(zone, "skill"))
            assert await asyncio.to_thread(room.at_work.wait, 5)
            client.gone.set()
            with pytest.raises(ServiceError, match="given up"):
                await asking
            await until(room.ended.is_set)
        finally:
            stopping.set()


ERRORS = [
    NoLaw("no set-point has been measured yet"),
    RequestError(["horizon: is too long", "plans: there are none"]),
    StateMismatch("room", "the database"),
    Fenced("it has gone", ["room"]),
    LeaseHeld("shard-0", "node-1", 3.0),
]


@pytest.mark.parametrize("error", ERRORS)
def test_an_error_of_a_shard_is_the_same_at_the_gateway(error: ServiceError) -> None:
    travelled = pickle.loads(pickle.dumps(error))
    assert (type(travelled), str(travelled), vars(travelled)) == (type(error), str(error), vars(error))
