from firmware_protocol.errors import DecodeError, EncodeError, ProtocolError


def test_an_error_says_what_does_not_fit_and_keeps_it():
    error = EncodeError("v_cell_max", "4.6", "3..4.5 V")
    assert str(error) == "v_cell_max = '4.6': 3..4.5 V"
    assert (error.field, error.value, error.limit) == ("v_cell_max", "4.6", "3..4.5 V")


def test_an_error_of_the_peer_says_where_it_is():
    error = DecodeError("DATA", "window header cut", 0)
    assert str(error) == "DATA at byte 0: window header cut"
    assert (error.what, error.reason, error.offset) == ("DATA", "window header cut", 0)
    assert str(DecodeError("REPLY", "4 bytes, at least 5")) == "REPLY: 4 bytes, at least 5"
    assert DecodeError("REPLY", "").offset is None


def test_one_root_catches_both():
    assert issubclass(EncodeError, ProtocolError)
    assert issubclass(DecodeError, ProtocolError)
