"""What an adapter's controller says is taken; what it does not say stays unknown, never zero or well."""

import can
import pytest

from app.sources.links.can import ControllerWatch, reported_state


def frame(can_id, *data):
    return can.Message(arbitration_id=can_id, is_error_frame=True, data=bytes(data))


@pytest.mark.parametrize(
    ("message", "state"),
    [
        (frame(0x40), "off"),
        (frame(0x04, 0, 0x20), "passive"),
        (frame(0x04, 0, 0x10), "passive"),
        (frame(0x04, 0, 0x08), "warning"),
        (frame(0x04, 0, 0x40), "active"),
        (frame(0x100), "active"),
        (frame(0x04), None),
        (frame(0x88, 0, 0, 4), None),
        (frame(0x20), None),
    ],
    ids=["bus-off", "passive tx", "passive rx", "warning", "active", "restarted", "no data", "stuff error", "no ack"],
)
def test_an_error_frame_tells_the_state_or_nothing_of_it(message, state):
    assert reported_state(message) == state


def test_an_error_that_says_nothing_of_the_state_leaves_it():
    watch = ControllerWatch("socketcan")
    assert (watch.errors, watch.state) == (0, None)
    watch.on_error_frame(frame(0x04, 0, 0x20))
    watch.on_error_frame(frame(0x88, 0, 0, 4))
    assert (watch.errors, watch.state) == (2, "passive")
    watch.on_error_frame(frame(0x100))
    assert watch.state == "active"


def test_the_controllers_counters_are_taken_where_the_frame_has_them():
    watch = ControllerWatch("socketcan")
    watch.on_error_frame(frame(0x04, 0, 0x08, 0, 0, 0, 0, 3, 97))
    assert (watch.tx_errors, watch.rx_errors) == (None, None)
    watch.on_error_frame(frame(0x204, 0, 0x08, 0, 0, 0, 0, 3, 97))
    assert (watch.tx_errors, watch.rx_errors) == (3, 97)


def test_an_adapter_that_passes_no_errors_on_has_an_unknown_number_of_them():
    assert ControllerWatch("slcan").errors is None


def test_error_frames_of_another_form_are_counted_and_not_read():
    watch = ControllerWatch("pcan")
    watch.on_error_frame(frame(0x04, 0, 0x30))  # to PCAN, 4 is a stuff error, and this its place in the frame
    assert (watch.errors, watch.state) == (1, None)


class Adapter:
    """What can be asked of an adapter."""

    def __init__(self, answer):
        self._answer = answer

    def status(self):
        return self.state

    @property
    def state(self):
        if isinstance(self._answer, Exception):
            raise self._answer
        return self._answer


@pytest.mark.parametrize(
    ("interface", "answer", "state"),
    [
        ("pcan", 0, "active"),
        ("pcan", 0x08, "warning"),
        ("pcan", 0x40000, "passive"),
        ("pcan", 0x40010, "off"),
        ("pcan", OSError("gone"), None),
        ("ixxat", can.BusState.ERROR, "off"),
        ("ixxat", can.BusState.PASSIVE, "active"),
        ("etas", can.BusState.PASSIVE, "passive"),
        ("slcan", can.BusState.ACTIVE, None),
    ],
)
def test_an_adapter_that_can_be_asked_is_asked(interface, answer, state):
    watch = ControllerWatch(interface)
    assert watch.ask(Adapter(answer)) is (state is not None)
    assert watch.state == state
    assert watch.ask(Adapter(answer)) is False
