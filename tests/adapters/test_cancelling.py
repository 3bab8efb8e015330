"""A task that is cancelled while a library waits ends, also where the result comes in the same moment."""

import asyncio

from support.modbus_plant import plant, serving
from support.sources import source_table

from adapters.cancelling import cancellable
from adapters.modbus.client import ModbusLink

MOMENTS = 12
"""More turns of the event loop than an answer takes from the socket to whoever has asked."""


async def test_a_result_that_comes_with_the_cancellation_does_not_undo_it():
    result: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(cancellable(asyncio.wait_for(result, 5.0)))
    await asyncio.sleep(0.01)
    result.set_result(1)
    task.cancel()
    await asyncio.wait([task])
    assert task.cancelled()


async def test_a_modbus_read_is_cancelled_whenever_its_answer_comes():
    ended = []
    async with serving(site := plant(holding=list(range(10)))):
        link = ModbusLink(source_table("modbus", host="127.0.0.1", port=site.port, first_register=0))
        await link.open()
        for moment in range(MOMENTS):
            asked = len(site.asked)
            reading = asyncio.create_task(link.read(1, "holding", 0, 5))
            while len(site.asked) == asked:
                await asyncio.sleep(0)
            for _ in range(moment):
                await asyncio.sleep(0)
            if reading.cancel():
                await asyncio.wait([reading])
                ended.append(reading.cancelled())
        await link.close()
    assert ended
    assert all(ended)
