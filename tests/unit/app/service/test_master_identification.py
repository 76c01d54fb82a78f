"""A master that appears, starts again or stored is asked once; one that does not answer, every ten seconds."""

from concurrent.futures import Executor, Future
from dataclasses import dataclass, field

import pytest

from app.errors import MasterSilent
from app.service.master import AGAIN_S, MasterIdentification
from app.sources.items import CanItem, LinkChange
from firmware_protocol.messages import EventCode, MessageType


class AtOnce(Executor):
    """Does what it is given before `submit` returns."""

    def submit(self, work, /, *arguments, **named):
        work(*arguments, **named)
        return Future()


@dataclass
class FakeMaster:
    asked: list[str] = field(default_factory=list)
    answers: bool = True

    def identify(self) -> None:
        self.asked.append("identity")
        if not self.answers:
            raise MasterSilent("no reply")

    def read_stored(self) -> None:
        self.asked.append("stored")


@pytest.fixture
def asked_master():
    return FakeMaster()


@pytest.fixture
def identification(asked_master, clock):
    return MasterIdentification(asked_master, asked_master, clock, AtOnce())


def test_the_first_frame_asks_and_the_next_ones_do_not(identification, asked_master, master):
    for _ in range(3):
        identification.on_item(master.frame())
    assert asked_master.asked == ["identity", "stored"]


def test_can_frames_ask_nobody(identification, asked_master):
    identification.on_item(CanItem(1, 1, 1, b""))
    assert asked_master.asked == []


@pytest.mark.parametrize("code", [EventCode.BOOT, EventCode.CONFIG_STORED])
def test_a_start_or_a_store_asks_again(identification, asked_master, master, code):
    identification.on_item(master.frame())
    identification.on_item(master.item(MessageType.EVENT, bytes([code])))
    assert asked_master.asked == ["identity", "stored"] * 2


@pytest.mark.parametrize("state", ["lost", "open"])
def test_behind_another_connection_may_be_another_master(identification, asked_master, master, state):
    identification.on_item(master.frame())
    identification.on_item(LinkChange(1, 1, "rs232", state))
    identification.on_item(master.frame())
    assert asked_master.asked == ["identity", "stored"] * 2


def test_a_master_that_does_not_answer_is_asked_again_after_a_while(identification, asked_master, master, clock):
    asked_master.answers = False
    identification.on_item(master.frame())
    clock.advance(AGAIN_S - 0.1)
    identification.on_item(master.frame())
    assert asked_master.asked == ["identity"]
    clock.advance(0.2)
    asked_master.answers = True
    identification.on_item(master.frame())
    identification.on_item(master.frame())
    assert asked_master.asked == ["identity", "identity", "stored"]
