"""The line is cut in the middle of a write, the power in the middle of a store, the firmware is another one: the page
says what is in force, and trying again is safe.
"""

import os
import select
import socket
import threading
from contextlib import suppress

import pytest
from playwright.sync_api import expect

from firmware_protocol.config_image import default_image
from firmware_protocol.eeprom import plan_store
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.messages import MessageType
from tests.failing_car import FailingCar


class Cable:
    """A line over TCP to the car; cut at a WRITE, nothing passes either way until it is mended."""

    def __init__(self, link) -> None:
        self._link = link
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self.cut_at_write: str | None = None  # before, after
        self._is_cut = False
        self._is_closed = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def repair(self) -> None:
        self.cut_at_write, self._is_cut = None, False

    def close(self) -> None:
        self._is_closed = True
        with suppress(OSError):  # wakes the thread that waits for a connection
            socket.create_connection(self._server.getsockname()).close()
        self._thread.join(5)
        self._server.close()

    def _serve(self) -> None:
        while not self._is_closed:
            host, _ = self._server.accept()
            port = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
            with host, suppress(OSError):
                self._pass(host, port)
            os.close(port)

    def _pass(self, host: socket.socket, port: int) -> None:
        decoder = FrameDecoder()
        while not self._is_closed:
            ready, _, _ = select.select([host, port], [], [], 0.1)
            if port in ready:
                answer = os.read(port, 4096)
                if not self._is_cut:
                    host.sendall(answer)
            if host in ready:
                data = host.recv(4096)
                if not data:
                    return
                found = any(isinstance(item, Frame) and item.type == MessageType.WRITE for item in decoder.feed(data))
                cut = self.cut_at_write if found else None
                self._is_cut |= cut == "before"
                if not self._is_cut:
                    os.write(port, data)
                self._is_cut |= cut == "after"


@pytest.fixture
def failing(tmp_path):
    """A car that fails on request."""
    car = FailingCar(tmp_path)
    yield car
    car.stop()


@pytest.fixture
def car(failing, make_service):
    """A service on a car behind a cable, and the cable."""
    cable = Cable(failing.start().link)
    service = make_service("--serial", cable.url)
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    yield service, cable
    service.stop()
    cable.close()


def field(page, name):
    return page.get_by_role("textbox", name=name, exact=True)


@pytest.mark.parametrize(
    ("cut", "said", "in_force"),
    [
        ("before", "Not written: the old configuration is active", "4.2000"),
        ("after", "Written: the new configuration is active", "4.1900"),
    ],
)
def test_the_line_is_cut_at_the_write_and_the_page_says_which_is_in_force(car, open_page, cut, said, in_force):
    service, cable = car
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(page, "v_cell_max").fill("4.19")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("write-dialog")).to_be_visible()
    cable.cut_at_write = cut
    page.get_by_test_id("confirm").click()
    outcome = page.get_by_test_id("outcome")
    expect(outcome).to_contain_text("Active configuration unknown")
    cable.repair()
    expect(outcome).to_contain_text(said)
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text(in_force)
    if cut == "before":
        expect(page.get_by_test_id("draft-state")).to_have_text("1 value changed")
        page.get_by_test_id("write").click()
        page.get_by_test_id("confirm").click()
        expect(outcome).to_contain_text("Written and verified")
    expect(page.get_by_test_id("draft-state")).to_have_text("none")


N_WRITTEN = sum(len(page.data) for page in plan_store(b"\xff" * 1024, default_image()))


@pytest.mark.parametrize(
    ("cut_after", "said"),
    [
        (100, "Not stored: the EEPROM still contains the old configuration"),
        (N_WRITTEN - 40, "Stored: the EEPROM contains the active configuration"),
    ],
    ids=["old", "new"],
)
def test_the_power_is_cut_in_a_store_and_the_page_says_what_the_eeprom_holds(
    failing, make_service, open_page, cut_after, said
):
    service = make_service("--serial", str(failing.start("--cut-after", str(cut_after)).link))
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    page.get_by_test_id("store").click()
    page.get_by_test_id("confirm").click()
    outcome = page.get_by_test_id("outcome")
    expect(outcome).to_contain_text("Stored configuration unknown")
    failing.stop()
    failing.start()
    expect(outcome).to_contain_text(said, timeout=60_000)  # another process starts, and the service finds it
    page.get_by_test_id("store").click()
    page.get_by_test_id("confirm").click()
    expect(outcome).to_contain_text("Stored in EEPROM")
    expect(page.get_by_test_id("stored-state")).to_have_text("none")


def test_another_memory_map_is_said_and_nothing_can_be_written(failing, make_service, open_page):
    service = make_service("--serial", str(failing.start("--other-map").link))
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"] is False)
    page = open_page(f"{service.base_url}/#/parameters")
    expect(page.get_by_text("The firmware uses another memory map than this service")).to_be_visible()
    field(page, "v_cell_max").fill("4.19")
    for button in ("check", "write", "store"):
        expect(page.get_by_test_id(button)).to_be_disabled()
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.2000")
