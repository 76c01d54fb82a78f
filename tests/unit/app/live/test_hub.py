import asyncio

from app.live.hub import Hub


def test_a_listener_gets_what_is_published():
    async def run():
        hub: Hub[int] = Hub()
        hub.attach(asyncio.get_running_loop())
        got: asyncio.Queue[int] = asyncio.Queue()
        hub.listen(got.put_nowait)
        hub.publish_threadsafe(1)
        first = await got.get()
        hub.publish_threadsafe(2)
        return first, await got.get()

    assert asyncio.run(run()) == (1, 2)


def test_a_loop_that_is_busy_finds_only_the_newest():
    async def run():
        hub: Hub[int] = Hub()
        hub.attach(asyncio.get_running_loop())
        got: asyncio.Queue[int] = asyncio.Queue()
        hub.listen(got.put_nowait)
        for value in range(1000):
            hub.publish_threadsafe(value)
        return await got.get(), got.empty(), hub.latest

    assert asyncio.run(run()) == (999, True, 999)


def test_without_a_loop_it_only_becomes_the_latest():
    hub: Hub[int] = Hub()
    hub.publish_threadsafe(3)
    assert hub.latest == 3
