import asyncio

import service.daemon.tasks
from service.daemon.tasks import end


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
