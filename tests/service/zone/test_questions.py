"""Questions of many clients: fair shares, bounds, and nothing computed for clients that have gone."""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

import pytest
from fastapi import FastAPI
from support.served import Client, config, serving
from support.waiting import until

from service.errors import ServiceError, TooManyQuestions
from service.records.asker import Asker, asked_by, current_asker
from service.zone import questions as module
from service.zone.questions import THREADS, WAITING, WAITING_OF_ONE, Questions


@asynccontextmanager
async def asking():
    stopping = threading.Event()
    with ThreadPoolExecutor(THREADS) as executor:
        try:
            yield Questions(executor, stopping)
        finally:
            stopping.set()


async def ask(questions, asker, question):
    asked_by(asker)
    return await questions.ask(question)


class Long:
    """A question that is computed until nobody waits for it any more."""

    def __init__(self):
        self.begun = 0

    def __call__(self, given_up):
        self.begun += 1
        while not given_up():
            threading.Event().wait(0.001)
        raise ServiceError("given up")


async def test_a_client_that_has_gone_is_computed_nothing_for():
    async with asking() as questions:
        asker, long = Asker("gone"), Long()
        asked = [asyncio.create_task(ask(questions, asker, long)) for _ in range(10)]
        await until(lambda: long.begun == module.THREADS_OF_ONE)
        asker.gone.set()
        results = await asyncio.gather(*asked, return_exceptions=True)
        assert all(isinstance(result, ServiceError) for result in results)
        assert long.begun == module.THREADS_OF_ONE, "those that waited were not begun"


async def test_many_questions_of_one_client_leave_a_thread_to_the_others():
    async with asking() as questions:
        greedy, long = Asker("greedy"), Long()
        asked = [asyncio.create_task(ask(questions, greedy, long)) for _ in range(WAITING_OF_ONE)]
        await until(lambda: long.begun)
        assert await ask(questions, Asker("other"), lambda given_up: "answered") == "answered"
        with pytest.raises(TooManyQuestions, match="limit for one client"):
            await ask(questions, greedy, lambda given_up: None)
        greedy.gone.set()
        await asyncio.gather(*asked, return_exceptions=True)
        assert await ask(questions, Asker("greedy"), lambda given_up: "again") == "again"


async def test_all_clients_together_are_bounded_but_not_the_daemon():
    async with asking() as questions:
        askers, long = [Asker(f"client {index}") for index in range(WAITING)], Long()
        asked = [asyncio.create_task(ask(questions, asker, long)) for asker in askers]
        await until(lambda: long.begun)
        with pytest.raises(TooManyQuestions, match="try again later"):
            await ask(questions, Asker("one more"), lambda given_up: None)
        own = asyncio.create_task(ask(questions, Asker(), lambda given_up: "own"))
        for asker in askers:
            asker.gone.set()
        assert await own == "own"
        await asyncio.gather(*asked, return_exceptions=True)


async def test_the_server_says_when_a_client_has_gone():
    app = FastAPI()
    seen: list[Asker] = []

    @app.get("/long")
    async def long():
        asker = current_asker()
        seen.append(asker)
        await until(asker.gone.is_set)

    async with serving(app, config()) as server:
        client = await Client.to(server)
        await client.send(b"GET /long HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await until(lambda: bool(seen))
        assert not seen[0].gone.is_set()
        await client.close()
        await until(seen[0].gone.is_set)


async def test_what_a_request_has_left_behind_goes_on_when_its_client_goes():
    app = FastAPI()
    seen: list[Asker] = []

    @app.get("/short")
    async def short():
        seen.extend(filter(None, [current_asker()]))

    async with serving(app, config()) as server:
        client = await Client.to(server)
        assert (await client.ask("/short")).status == 200
        await client.close()
        await until(lambda: not server.open_connections)
        assert not seen[0].gone.is_set()
