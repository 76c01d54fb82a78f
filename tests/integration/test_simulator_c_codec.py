"""The virtual master against the C reference codec: what it puts on a bad line decodes alike in C and in Python."""

import subprocess

import pytest

from firmware_protocol.framing import BadFrame, Frame, FrameDecoder
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.c_programs import build_program
from tests.campaign import campaign, of_size

SECONDS = of_size(20, 40, 240, 1200)

PIECE = 3000  # the driver reads lines of limited length


@pytest.fixture(scope="module")
def program():
    return build_program("host_test")


def recorded(noise_per_byte: float) -> bytes:
    line = bytearray()
    player = ScenarioPlayer(find_scenario("clean-endurance"))
    player.simulation.line.noise_per_byte = noise_per_byte
    player.simulation.serial_out = line.extend
    player.run(0.5)
    player.simulation.receive(b"x")
    player.run(SECONDS)
    return bytes(line)


def in_words(item: Frame | BadFrame) -> str:
    if isinstance(item, BadFrame):
        return f"bad:{item.reason}"
    return f"frame:{item.type:02x}:{item.sequence:02x}:{item.uptime_ms:08x}:{item.body.hex() or '-'}"


@campaign(240, 300, 900)
@pytest.mark.parametrize("noise_per_byte", [0.0, 1e-3])
def test_c_and_python_see_the_same_stream(program, noise_per_byte, tell):
    raw = recorded(noise_per_byte)
    pieces = [raw[at : at + PIECE] for at in range(0, len(raw), PIECE)]  # each a decoder's first look at the line
    lines = "".join(f"feed host 0 64 {piece.hex()}\n" for piece in pieces)
    done = subprocess.run([program, "driver"], input=lines, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    answers = [line.split()[:-1] for line in done.stdout.splitlines()]  # the last word counts dropped bytes
    expected = [[in_words(item) for item in FrameDecoder().feed(piece)] for piece in pieces]
    assert answers == expected
    words = [word for answer in answers for word in answer]
    assert len(words) > 300
    assert any(word.startswith("bad:") for word in words) == (noise_per_byte > 0)
    bad = sum(word.startswith("bad:") for word in words)
    tell(f"noise: {noise_per_byte:g} of all bytes damaged, {len(words)} frames, C and Python refuse the same {bad}")
