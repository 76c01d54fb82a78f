"""A host that missed the reply asks again, up to ten seconds later; nothing is done twice."""

import pytest

from firmware_protocol.messages import REPEAT_WINDOW_S, Command, CommandId, EventCode, Store


def count(host, code: EventCode) -> int:
    return sum(event.code == code for event in host.events)


@pytest.mark.parametrize(
    ("pause_s", "times"), [(0.5, 1), (REPEAT_WINDOW_S - 3, 1), (REPEAT_WINDOW_S + 1, 2)], ids=["soon", "late", "new"]
)
def test_a_repeated_command_is_done_once(host, pause_s, times):
    command = Command(CommandId.SET_SOC, 4321)
    host.send(command, sequence=7)
    host.run(pause_s)
    host.send(command, sequence=7)
    host.run(0.5)
    assert count(host, EventCode.SOC_SET) == times
    assert [reply.result for reply in host.replies] == [0, 0]


def test_a_store_that_is_under_way_is_not_begun_again(host):
    host.send(Store(), sequence=9)
    host.run(0.01)
    host.send(Store(), sequence=9)
    host.run(2.0)
    assert count(host, EventCode.CONFIG_STORED) == 1
    assert [(reply.request_sequence, reply.result) for reply in host.replies] == [(9, 0)]
    host.send(Store(), sequence=9)
    host.run(2.0)
    assert count(host, EventCode.CONFIG_STORED) == 1
    assert len(host.replies) == 2
