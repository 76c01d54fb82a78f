import asyncio

import pytest

from app.live.hub import Hub


def test_a_new_reader_gets_the_latest_at_once():
    async def run():
        hub: Hub[int] = Hub()
        hub.publish(1)
        hub.publish(2)
        with hub.subscribe() as slot:
            return await asyncio.wait_for(slot.next(), 1)

    assert asyncio.run(run()) == 2


def test_a_slow_reader_misses_values_and_others_do_not():
    async def run():
        hub: Hub[int] = Hub()
        with hub.subscribe() as slow, hub.subscribe() as fast:
            seen = []
            for value in range(5):
                hub.publish(value)
                seen.append(await fast.next())
            return seen, await slow.next(), slow.skipped, fast.skipped

    seen, slow_value, slow_skipped, fast_skipped = asyncio.run(run())
    assert seen == [0, 1, 2, 3, 4]
    assert (slow_value, slow_skipped, fast_skipped) == (4, 4, 0)


def test_who_left_is_not_counted():
    async def run():
        hub: Hub[int] = Hub()
        with hub.subscribe():
            inside = hub.readers
        return inside, hub.readers

    assert asyncio.run(run()) == (1, 0)


def test_a_loop_that_is_busy_finds_only_the_newest():
    async def run():
        hub: Hub[int] = Hub()
        hub.attach(asyncio.get_running_loop())
        with hub.subscribe() as slot:
            for value in range(1000):
                hub.publish_threadsafe(value)
            return await slot.next(), slot.skipped, hub.latest

    assert asyncio.run(run()) == (999, 0, 999)


def test_the_same_value_is_not_delivered_twice():
    async def run():
        hub: Hub[object] = Hub()
        hub.attach(asyncio.get_running_loop())
        value = object()
        hub.publish_threadsafe(value)
        with hub.subscribe() as slot:
            assert await slot.next() is value
            await asyncio.sleep(0)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(slot.next(), 0.01)

    asyncio.run(run())
