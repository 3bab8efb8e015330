import asyncio
import gc
import os

import pytest

import service.daemon.tasks
from adapters.cancelling import in_thread
from service.daemon.tasks import done_before, end


def test_a_task_ends_even_if_a_cancellation_meets_an_answer(monkeypatch):
    monkeypatch.setattr(service.daemon.tasks, "_AGAIN_SECONDS", 0.01)

    async def polls():
        while True:
            begun.set()
            # What wait_for of Python 3.11 does with a cancellation in the moment in which its answer arrives.
            try:
                await asyncio.Event().wait()
            except asyncio.CancelledError:
                if missed:
                    raise
                missed.append(True)

    async def fails():
        raise ValueError("no longer of interest")

    async def main():
        tasks = [asyncio.create_task(work) for work in (polls(), fails())]
        await begun.wait()
        await end(tasks)
        assert tasks[0].cancelled()

    missed, begun = [], asyncio.Event()
    asyncio.run(main())
    assert missed


async def test_what_a_stop_overtakes_is_ended_and_leaves_no_complaint():
    loop, complaints = asyncio.get_running_loop(), []
    loop.set_exception_handler(lambda loop, context: complaints.append(context["message"]))
    stop = loop.create_future()
    loop.call_soon(stop.set_result, None)
    # Several things at once, as the sinks that settle.
    parts = [asyncio.create_task(asyncio.Event().wait()) for _ in range(2)]
    assert not await done_before(stop, asyncio.gather(*parts))
    assert all(part.cancelled() for part in parts)
    gc.collect()
    await asyncio.sleep(0)
    assert complaints == []


async def test_what_is_done_before_the_stop_says_how_it_went():
    async def fails():
        raise ValueError("cannot")

    stop = asyncio.get_running_loop().create_future()
    assert await done_before(stop, asyncio.ensure_future(asyncio.sleep(0)))
    with pytest.raises(ValueError, match="cannot"):
        await done_before(stop, asyncio.ensure_future(fails()))


async def test_what_blocks_for_ever_holds_up_no_end(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = asyncio.create_task(in_thread(pipe.read_bytes))
    await asyncio.sleep(0.05)
    await end([reading])
    assert reading.cancelled()
    assert await in_thread(lambda: 7) == 7
    with pytest.raises(ValueError, match="cannot"):
        await in_thread(lambda: int("cannot"))
    # asyncio.run would wait for the threads of the loop's own executor.
    pipe.open("wb").close()
